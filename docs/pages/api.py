"""The Python interface: every public name as its source declares it, without the bodies."""

import ast
import inspect
from collections.abc import Iterator
from types import FunctionType

import aerofed

SECTIONS = {
    "Running and reading": "run resume load Run compare sweep load_sweep Sweep Figure",
    "Vehicles for tests": "vehicle vehicles fly",
    "Configurations, plans, channels": "config first_problem plan channel",
    "A strategy of your own": "Strategy StrategyContext Sortie ImportanceStrategy RoundInfo Area",
    "A planner of your own": "Planner RoundProblem Start RoundPlan PlannedPath finish fit_budget "
    "Airspace RoundLimits Performance Foreseen",
    "An algorithm of your own": "Algorithm StaleStart Update",
    "Local training of your own": "Trainer TrainingDevice DeviceData LocalSettings LocalResult",
    "A radio of your own": "Radio Channel",
    "A belief of your own": "Belief Heard LinkTerms",
    "Data and partitions of your own": "Samples Partition PartitionTask",
    "Callbacks": "Callback CallbackContext RoundReport RoundRecord UplinkRecord RoundLearning",
    "Errors": "AerofedError InputError LimitsNotMetError PlanError UsersCodeError",
}
FOR_C = ("CandidatePlan", "Round")  # what a method makes for the planner's own library
HEAD = """# Python interface

`aerofed` is what notebooks, scripts and code of your own import; a test pins its names, and the
rest of the code may change without notice. What follows is made from the code
(`python docs/generate.py`). `RunConfig`, `MissionConfig` and `LearningConfig` hold the keys of
[configuration](configuration.md).

```python
import aerofed

run = aerofed.run("quickstart", {"mission.rounds": 3}, out="out")
run.rounds  # also .uplinks, .learning, .track: pandas DataFrames
run.figure("map")  # shown by a notebook; .save("map.svg")
run.report()  # writes report.html, the page of `aerofed run`

other = aerofed.run(run.config, {"mission.strategy": "no_cov"}, out="other")
aerofed.compare(run, other)  # planned against flown, a row a run
aerofed.load("out")  # a run that was flown before, also by the command line

problem = aerofed.first_problem("quickstart")
aerofed.plan(problem)  # a path, a schedule, and a proven bound
aerofed.channel("suburban").per([0.0, 100.0, 200.0], 60.0)
aerofed.sweep("quickstart", strategies=["cov", "no_cov"], seeds=3).runs

with aerofed.vehicle(home="survey.plan", wind_mps=6) as vehicle:  # see "Flights in tests"
    vehicle.fly("survey.plan")
```

A run from Python has the same bytes as one from the command line, but no `report.html` before you
ask for it. It also works where an event loop is running already, as in a notebook. The notebook's
stop button interrupts it as Ctrl-C would: what was flown stays, and `aerofed.resume("out")` goes
on. A wrong value raises an `AerofedError` with the message that the command line prints; wrong
keys of a dictionary are blamed on `overrides`. A value of a wrong type may also raise Python's
`TypeError` or `AttributeError`.

Two notebooks, which CI executes: `examples/first_run.ipynb` and `examples/planning.ipynb`."""


def page() -> str:
    parts = [HEAD]
    for title, names in SECTIONS.items():
        shown = (
            f"### {n}\n\n```python\n{outline(getattr(aerofed, n))}\n```" for n in names.split()
        )
        parts += [f"## {title}", *shown]
    return "\n\n".join(parts) + "\n"


def outline(thing: type | FunctionType) -> str:
    """A class or function with its docstring; of a class also its fields and public methods."""
    source = inspect.getsource(thing)
    (node,) = ast.parse(source).body
    lines = source.splitlines()
    return "\n".join(lines[number - 1] for number in kept(node)).rstrip()


def kept(node: ast.stmt) -> Iterator[int]:
    """The numbers of the lines that are shown."""
    if isinstance(node, ast.FunctionDef):
        documented = ast.get_docstring(node) is not None
        last = node.body[0].end_lineno if documented else node.body[0].lineno - 1
        first = min([node.lineno, *(item.lineno for item in node.decorator_list)])
        yield from range(first, max(last or 0, node.lineno) + 1)
        return
    assert isinstance(node, ast.ClassDef)
    shown = node.lineno
    yield shown
    for item in node.body:
        end = item.end_lineno or item.lineno
        if isinstance(item, ast.FunctionDef):
            if not item.name.startswith("_") and getattr(item.returns, "id", "") not in FOR_C:
                yield from range(shown + 1, item.lineno - len(item.decorator_list))
                yield from kept(item)
        else:
            yield from range(shown + 1, end + 1)  # with the comments above it
        shown = end
