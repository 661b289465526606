"""What is wrong with a plug-in is one line: which plug-in, where, and what. Each kind, each way."""

import importlib
import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from cutting import cut_after
from drawing import UNDRAWN

import aerofed
from fl.plugin_code import digest_of
from mission.base.errors import UsersCodeError
from mission.cli import call
from mission.run.callbacks import CallbackContext, make_callbacks

MODULE = """
import numpy as np
import torch
from aerofed import LocalResult, Samples

class Algorithm:
    mu = momentum = 0.0
    def init(self, model, devices): return {}
    def correction(self, state, device): return None
    def apply(self, state, model, updates): return model, state

class Fails(Algorithm):
    def apply(self, state, model, updates):
        return model / updates.sum  # algorithm's slip

class Short(Algorithm):
    def apply(self, state, model, updates): return model[:3], state

class Endless(Algorithm):
    def apply(self, state, model, updates): return model * np.nan, state

class NoState(Algorithm):
    def init(self, model, devices): return None

class BadMomentum(Algorithm):
    momentum = 3.0

class Radio:
    def __init__(self, channel, devices_m): pass
    def per(self, device, place_m): return device / 1e6

class RadioFails(Radio):
    def per(self, device, place_m):
        return self.table[device]  # radio's slip

class RadioOver(Radio):
    def per(self, device, place_m): return 1.5 + 0.0 * device

class RadioShort(Radio):
    def per(self, device, place_m): return 0.5

class Belief:
    def __init__(self, prior, terms, devices_m): self.count = len(devices_m)
    def success(self, heard, place_m): return np.full((self.count, len(place_m)), 0.5)

class BeliefFails(Belief):
    def success(self, heard, place_m):
        return self.walls[place_m]  # belief's slip

class BeliefFailsLater(Belief):
    def success(self, heard, place_m):
        if len(heard.device):
            raise KeyError("later")  # belief's later slip
        return super().success(heard, place_m)

class BeliefShort(Belief):
    def success(self, heard, place_m): return super().success(heard, place_m)[0]

class BeliefNaN(Belief):
    def success(self, heard, place_m): return super().success(heard, place_m) * np.nan

class BeliefComplex(Belief):
    def success(self, heard, place_m): return super().success(heard, place_m) + 0j

class BeliefOverLater(Belief):
    def success(self, heard, place_m):
        return super().success(heard, place_m) + len(heard.device)

class BeliefOver(Belief):
    def success(self, heard, place_m): return super().success(heard, place_m) + 1.0

class BeliefWords(Belief):
    def success(self, heard, place_m): return "surely"

class Net(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.dense = torch.nn.Linear(64, 10)
        self.calls = 0
    def forward(self, x):
        self.calls += self.training
        if self.calls > 2: raise KeyError("weights")  # network's slip
        return self.dense(x.flatten(1))

def split(task): return np.array_split(np.arange(len(task.labels)), task.devices)
def split_fails(task):
    return task.label  # partition's slip
def split_twice(task): return [np.arange(5)] * task.devices
def split_few(task): return split(task)[1:]
def split_far(task): return [np.array([10**6 + i]) for i in range(task.devices)]
def split_floats(task): return [np.array([0.5])] * task.devices

X, Y = np.zeros((40, 8, 8)), np.arange(40) % 10
def data_fails(data_dir):
    return data_dir / "file"  # data set's slip
def data_other(data_dir): return X
def data_pixels(data_dir): return Samples(X + 3.0, Y, X, Y)
def data_labels(data_dir): return Samples(X, Y[:5], X, Y)
def data_owner(data_dir): return Samples(X, Y, X, Y, Y[:3])

class Tells:
    def __init__(self, context): pass
    def round_finished(self, report): pass
    def close(self): pass

class TellsBadly(Tells):
    def round_finished(self, report):
        raise OSError("no server")  # callback's slip

class ClosesBadly(Tells):
    def close(self):
        raise OSError("no server")  # callback's end

def algorithm(learning): return Algorithm()
def fails(learning): return Fails()
def short(learning): return Short()
def endless(learning): return Endless()
def no_state(learning): return NoState()
def bad_momentum(learning): return BadMomentum()
def full_momentum(learning): return type("Full", (BadMomentum,), {"momentum": 1.0})()
class TrainerFails:
    def __init__(self, learning): pass
    def train(self, device, model, data, rng):
        return device.weights  # trainer's slip

class TrainerShort(TrainerFails):
    def train(self, device, model, data, rng): return LocalResult(model[:3], 1, 0.5)

class TrainerOther(TrainerFails):
    def train(self, device, model, data, rng): return model

class TrainerIdle(TrainerFails):
    def train(self, device, model, data, rng): return LocalResult(model, 0, 0.5)

class TrainerNaN(TrainerFails):
    def train(self, device, model, data, rng): return LocalResult(model * float("nan"), 1, 0.5)

class TrainerEndless(TrainerFails):
    def train(self, device, model, data, rng): return LocalResult(model, 1, float("inf"))

def nothing(*anything): return object()
def broken(*anything): return undefined_name
"""

SMALL = {
    "mission.flight": "none",
    "mission.steps": 4,
    "mission.rounds": 2,
    "mission.path_budget_m": 400.0,
    "planner.gap": 0.1,
    "communities.0.devices": 3,
    "communities.1.devices": 3,
    "communities.0.subset": 0.2,
    "communities.1.subset": 0.2,
    "learning.local_epochs": 1,
}
KEYS = {
    "trainer": "learning.trainer",
    "algorithm": "learning.algorithm",
    "gate": "radio.truth",
    "belief": "radio.belief",
    "network": "communities.0.network",
    "task": "communities.0.task",
    "partition": "communities.0.partition",
    "callbacks": "callbacks",
}


WALL = {"polygon_m": [[400, 300], [600, 300], [600, 310]], "height_m": 30.0}
WALLED = {"area.buildings": [WALL], "radio.truth": "buildings"}  # for a belief, that needs an SNR


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module in the working directory, which is where a researcher's stands."""
    (tmp_path / "mine.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    monkeypatch.delitem(sys.modules, "mine", raising=False)


def refused(kind: str, name: str) -> aerofed.AerofedError:
    value: Any = f"mine:{name}"
    more = {KEYS[kind]: [value] if kind == "callbacks" else value}
    more |= WALLED if kind == "belief" else {}
    with pytest.raises(aerofed.AerofedError) as caught:
        aerofed.run("quickstart", {**SMALL, **more}, out="out")
    assert str(caught.value).count("\n") == 0
    assert f"'mine:{name}'" in str(caught.value)
    assert caught.value.exit_code == 2
    return caught.value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("algorithm", "nothing", "learning.algorithm = 'mine:nothing': gives an object without mu"),
        ("algorithm", "no_state", "init() gives a NoneType as its state, not a dictionary"),
        ("algorithm", "bad_momentum", "momentum is 3.0: must be from 0 to 1"),
        ("algorithm", "full_momentum", "momentum is 1.0: must be below 1"),
        ("algorithm", "short", "the model that apply() gives is of shape (3,), not ("),
        ("algorithm", "endless", "the model that apply() gives holds nan at [0]: must be finite"),
        ("trainer", "nothing", "learning.trainer = 'mine:nothing': gives an object without train"),
        ("trainer", "TrainerShort", "gives is of shape (3,), not ("),
        (
            "trainer",
            "TrainerOther",
            "train() of device 0 in round 1 gives a ndarray, not a LocalResult",
        ),
        (
            "trainer",
            "TrainerIdle",
            "steps that train() of device 0 in round 1 gives is 0.0: must be finite and 1 or more",
        ),
        (
            "trainer",
            "TrainerNaN",
            "learning.trainer = 'mine:TrainerNaN': the model that train() of device 0 in round 1 "
            "gives holds nan at [0]: must be finite",
        ),
        (
            "trainer",
            "TrainerEndless",
            "the loss that train() of device 0 in round 1 gives is inf: must be finite",
        ),
        ("gate", "nothing", "radio.truth = 'mine:nothing': gives an object without per"),
        ("gate", "RadioOver", "what per() gives holds 1.5 at [0]: must be from 0 to 1"),
        ("gate", "RadioShort", "what per() gives is of shape (), not ("),
        ("belief", "nothing", "radio.belief = 'mine:nothing': gives an object without success"),
        (
            "belief",
            "BeliefShort",
            "radio.belief = 'mine:BeliefShort': what success() after 0 tones gives is of shape "
            "(25921,), not (6, 25921)",
        ),
        (
            "belief",
            "BeliefNaN",
            "what success() after 0 tones gives holds nan at [0, 0]: must be from 0 to 1",
        ),
        ("belief", "BeliefOver", "gives holds 1.5 at [0, 0]: must be from 0 to 1"),
        ("belief", "BeliefWords", "after 0 tones gives: ValueError: could not convert string"),
        (
            "task",
            "data_other",
            "'mine:data_other': the factory gives a ndarray, not a Samples",
        ),
        ("task", "data_pixels", "x_train holds floats outside [0, 1]"),
        ("task", "data_labels", "40 training images, but 5 training labels"),
        ("task", "data_owner", "owner is int64 (3,); wanted integers (40,)"),
        ("partition", "split_twice", "sample 0 is given 3 times"),
        ("partition", "split_few", "gives shares of 2 devices, not 3"),
        ("partition", "split_far", "device 0 gets sample 1000000; there are 0 to "),
        ("partition", "split_floats", "device 0 gets float64 (1,); wanted whole numbers"),
        ("callbacks", "nothing", "callbacks = 'mine:nothing': gives an object without round_fin"),
        *[
            (kind, "broken", "calling it fails: NameError: name 'undefined_name'")
            for kind in ("algorithm", "gate", "belief", "callbacks")
        ],
        *[(kind, "missing", "cannot be imported: AttributeError") for kind in KEYS],
        ("belief", "BelifFails", "'BelifFails'; did you mean BeliefFails?"),
        ("belief", "BeliefComplex", "what success() after 0 tones gives is complex: must be real"),
    ],
)
def test_what_breaks_the_rules(kind: str, name: str, words: str) -> None:
    assert words in str(refused(kind, name))
    if kind == "belief":  # before anything is flown: nothing is left
        assert not Path("out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name", "doing", "raised", "slip"),
    [
        ("algorithm", "fails", "apply()", "AttributeError", "# algorithm's slip"),
        (
            "trainer",
            "TrainerFails",
            "train() of device 0 in round 1",
            "AttributeError",
            "# trainer's slip",
        ),
        ("gate", "RadioFails", "per()", "AttributeError", "# radio's slip"),
        (
            "belief",
            "BeliefFails",
            "success() after 0 tones",
            "AttributeError",
            "# belief's slip",
        ),
        ("belief", "BeliefFailsLater", "success() after ", "KeyError", "# belief's later slip"),
        ("network", "Net", "training", "KeyError: 'weights'", "# network's slip"),
        ("task", "data_fails", "the factory", "TypeError", "# data set's slip"),
        ("partition", "split_fails", "the partition", "AttributeError", "# partition's slip"),
        ("callbacks", "TellsBadly", "round_finished() of round 1", "OSError", "# callback's slip"),
        ("callbacks", "ClosesBadly", "close()", "OSError", "# callback's end"),
    ],
)
def test_what_it_raises_is_named_with_its_line(
    kind: str, name: str, doing: str, raised: str, slip: str, tmp_path: Path
) -> None:
    error = refused(kind, name)
    key = KEYS[kind].replace("callbacks.0", "callbacks")
    number = next(i for i, text in enumerate(MODULE.splitlines(), 1) if slip in text)
    assert f"{key} = 'mine:{name}': {doing}" in str(error)
    assert f": {raised}" in str(error)
    assert f"({tmp_path / 'mine.py'}, line {number})" in str(error)
    # Before anything is flown: nothing is left.
    if kind in ("task", "partition") or name == "BeliefFails":
        assert not (tmp_path / "out").exists()
    else:
        assert isinstance(error, UsersCodeError)
        assert type(error.__cause__).__name__ == raised.partition(":")[0]
        assert slip in (tmp_path / "out" / "traceback.txt").read_text()
        assert aerofed.load("out").status == "failed"


def test_an_answer_that_breaks_a_rule_later_is_not_said_to_be_mended_by_going_on() -> None:
    error = str(refused("belief", "BeliefOverLater"))
    assert "tones gives holds" in error
    assert error.endswith(": must be from 0 to 1; the files are in out")


WEIRD = """
class Silent(Exception):
    def __str__(self): raise ValueError
class Worse(BaseException):
    def __str__(self): raise SystemExit(3)
class Tells:
    def __init__(self, context): pass
    def round_finished(self, report): raise {error}
    def close(self): pass
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "told"),
    [
        ("Silent()", "Silent: (a Silent, which fails to say what it is: ValueError) ("),
        ("Worse()", "Worse: (a Worse, which fails to say what it is: SystemExit) ("),
        ("GeneratorExit('over')", "GeneratorExit: over ("),
        ("ValueError('a\\ud800b' + 'x' * 10**7)", r"ValueError: a\ud800bxxxxxx"),
        ("__import__('asyncio').CancelledError('no')", "CancelledError: no ("),
    ],
)
def test_whatever_it_raises_becomes_one_short_line(
    error: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("weird.py").write_text(WEIRD.format(error=error))
    sys.modules.pop("weird", None)
    given = {**SMALL, "mission.rounds": 1, "callbacks": '["weird:Tells"]'}
    sets = [word for key, value in given.items() for word in ("--set", f"{key}={value}")]
    assert call(["run", "--out", "out", *sets, "--quiet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"callbacks = 'weird:Tells': round_finished() of round 1: {told}" in line
    assert len(line) < 1500
    assert json.loads(Path("out/summary.json").read_text())["status"] == "failed"
    assert Path("out/traceback.txt").exists()


GREEDY = """
import numpy as np
import torch
from aerofed import LocalResult, Samples, Sortie, finish

X, Y = np.random.default_rng(1).random((80, 8, 8)), np.arange(80) % 10

def scribble(*handed):
    for value in handed:
        if isinstance(value, np.ndarray):
            try:
                value *= 0
            except ValueError:
                continue
            raise AssertionError("could be written to")
        if isinstance(value, (list, tuple)):
            scribble(*value)
        elif isinstance(value, dict):
            scribble(*value.values())
            value.clear()
        elif hasattr(value, "__dataclass_fields__"):
            scribble(*getattr(value, "__dict__", {}).values())

class Strategy:
    fairness, approach_m = True, [100.0, 100.0]
    def __init__(self, context): scribble(context); self.planner = context.planner
    def importance(self, info): scribble(info); return np.array(info.p)
    def sortie(self, number, problem):
        scribble(problem)
        return Sortie(self.planner.plan(problem))

class Far(Strategy):
    approach_m = [1.0, 2.0, 3.0]

class Near(Strategy):
    approach_m = "home"

class Fair(Strategy):
    def fairness(self): return False

class Planner:
    def plan(self, problem):
        scribble(problem)
        return finish(problem, np.tile(problem.start_m, (problem.steps, 1)))

class Algorithm:
    mu, momentum = 0.0, 0.5
    def __init__(self, learning): pass
    def init(self, model, devices): scribble(model); return {"seen": np.zeros(3)}
    def correction(self, state, device): scribble(state)
    def start(self, state, model, device): scribble(model, state); return model
    def apply(self, state, model, updates):
        scribble(model, updates)
        updates.clear()
        return model, state

class Trainer:
    def __init__(self, learning): pass
    def train(self, device, model, data, rng):
        scribble(device, model, data)
        return LocalResult(model, 1, 0.5)

class Radio:
    def __init__(self, channel, devices_m): pass
    def per(self, device, place_m): scribble(device, place_m); return 0 * device

class Belief:
    def __init__(self, *given): scribble(given); self.count = len(given[2])
    def success(self, *given):
        print("in a belief")
        scribble(given)
        return np.full((self.count, len(given[1])), 0.5)

class Callback:
    def __init__(self, context): pass
    def round_finished(self, report): scribble(report)
    def close(self): pass

class Net(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.dense = torch.nn.Linear(64, 10)
    def forward(self, x):
        logits = self.dense(x.flatten(1))
        x.detach().zero_()
        return logits

def data(data_dir):
    samples = Samples(X.copy(), Y, X.copy(), Y)
    data.made = samples
    return samples

def split(task):
    data.made.x_train[:] = 0.0  # they are its own
    scribble(task)
    return np.array_split(np.arange(len(task.labels)), task.devices)
"""
EVERY_POINT = {
    "mission.strategy": "Strategy", "planner.factory": "Planner",
    "learning.algorithm": "Algorithm", "learning.trainer": "Trainer", "radio.truth": "Radio",
    "communities.0.network": "Net", "communities.0.task": "data",
    "communities.0.partition": "split", "callbacks": "Callback",
}  # fmt: skip


def at_every_point(made: Callable[[str], object]) -> dict[str, Any]:
    """Settings with code of one's own wherever there may be any; `made` of the code's names."""
    own = {key: made(name) for key, name in EVERY_POINT.items()}
    zone = {"name": "corner", "polygon_m": [[1.0, 1.0], [20.0, 1.0], [20.0, 20.0]]}
    own = {**own, "callbacks": [own["callbacks"]], "area.no_fly": [zone]}
    return {**SMALL, "planner.kind": "import", **own}


def passed(name: str) -> object:
    """An object of no module that any other process could import."""
    return SESSION[name]


SESSION: dict[str, Any] = {"__name__": "__main__"}
exec(GREEDY, SESSION)


def test_nobody_can_write_to_what_is_not_theirs_wherever_code_of_ones_own_may_be(
    tmp_path: Path,
) -> None:
    (tmp_path / "mine.py").write_text(GREEDY)
    own = at_every_point("mine:{}".format)
    by_name = aerofed.run("quickstart", own, out="out")
    assert by_name.uplinks["delivered"].all()
    assert len(by_name.summary["plugins"]) == len(EVERY_POINT)
    for name, words in (
        ("Far", r"approach_m is of shape \(3,\), not"),
        ("Near", "approach_m: ValueError: could not"),
        ("Fair", "fairness is .*method.*: must be True or False"),
    ):
        with pytest.raises(aerofed.AerofedError, match=f"'mine:{name}': {words}"):
            aerofed.run("quickstart", {**own, "mission.strategy": f"mine:{name}"}, out=name)


@pytest.mark.slow
def test_an_object_may_stand_for_its_name_wherever_code_of_ones_own_may_be(
    tmp_path: Path,
) -> None:
    (tmp_path / "mine.py").write_text(GREEDY)
    by_name = aerofed.run("quickstart", at_every_point("mine:{}".format), out="out")
    own = at_every_point(passed)
    by_object = aerofed.run("quickstart", own, strategy=own.pop("mission.strategy"), out="passed")
    assert by_object.learning.equals(by_name.learning)
    assert by_object.rounds.equals(by_name.rounds)
    assert all(by_object.summary["plugins"].values())
    with cut_after(1), pytest.raises(aerofed.AerofedError):
        aerofed.run("quickstart", at_every_point(passed), out="cut")
    command = [*UNDRAWN, "run", "--resume", "cut"]
    elsewhere = subprocess.run(command, capture_output=True, text=True, check=False)
    assert elsewhere.returncode == 2
    (line,) = elsewhere.stderr.splitlines()
    assert "cut: cannot be resumed: nothing tells whether plug-in 'python:" in line
    assert "passed from Python" in line
    assert aerofed.resume("cut").rounds.equals(by_name.rounds)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["joblib", "ray"])
def test_workers_get_the_objects_that_stand_for_names(engine: Any) -> None:
    own = at_every_point(passed)
    strategy = own.pop("mission.strategy")
    alone = aerofed.run("quickstart", own, strategy=strategy, out="alone")
    strategies = [strategy, partial(strategy), "cov"]
    swept = aerofed.sweep(
        "quickstart", strategies=strategies, seeds=1, overrides=own, out="out", engine=engine,
        jobs=1,
    )  # fmt: skip
    for name in swept.runs["run"][:2]:
        assert swept.run(name).learning.equals(alone.learning)
    lock = threading.Lock()
    with pytest.raises(aerofed.InputError, match=r"'python:lambda_.*: it cannot be pickled"):
        aerofed.sweep(strategies=[lambda context: (lock, context)], seeds=1, out="none")
    assert not Path("none").exists()


TALKS = """
print("imported")
class Radio:
    def __init__(self, channel, devices_m): pass
    def per(self, device, place_m):
        print("in a round")
        return 0 * device
"""


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "sweep"])
def test_what_code_of_ones_own_prints_goes_to_standard_error(
    command: str, capfd: pytest.CaptureFixture[str]
) -> None:
    Path("talks.py").write_text(TALKS)
    own = {**SMALL, "radio.truth": "talks:Radio"}
    sets = [f"--set={key}={value}" for key, value in own.items() if key != "mission.rounds"]
    sweep = ["quickstart", "--strategies=cov", "--seeds=1", "--jobs=1", "--no-run-figures"]
    more = sweep if command == "sweep" else []
    assert call([command, *more, "--json", "--no-report", "--rounds=1", "--out=out", *sets]) == 0
    printed = capfd.readouterr()
    assert json.loads(printed.out)["folder"] == "out"
    assert {"imported", "in a round"} <= {*printed.err.splitlines()}


def test_code_that_was_edited_runs_as_it_is_now(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text("momentum = 3.0")
    text = MODULE.replace("import torch", "import torch; from helper import momentum")
    (tmp_path / "mine.py").write_text(text.replace("momentum = 3.0", "momentum = momentum"))
    bad = {**SMALL, "learning.algorithm": "mine:bad_momentum"}
    for now in ("3.0", "2.25", "0.125"):
        (tmp_path / "helper.py").write_text(f"momentum = {now}")
        if now == "0.125":
            aerofed.run("quickstart", bad, out="out")
        else:
            with pytest.raises(UsersCodeError, match=f"momentum is {now}"):
                aerofed.run("quickstart", bad, out="out")


def test_a_run_goes_on_with_the_code_it_began_with_and_no_other(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text("momentum = 0.5")
    text = MODULE.replace("momentum = 0.0", "momentum = helper.momentum")
    (tmp_path / "mine.py").write_text(f"import helper\n{text}")
    more = {**SMALL, "learning.algorithm": "mine:algorithm", "callbacks": ["mine_too:Tells"]}
    (tmp_path / "mine_too.py").write_text(MODULE)
    with cut_after(1), pytest.raises(aerofed.AerofedError):
        aerofed.run("quickstart", more, out="out")
    told = aerofed.load("out").summary["plugins"]
    assert told == {name: digest_of(name) for name in ("mine:algorithm", "mine_too:Tells")}
    (tmp_path / "helper.py").write_text("momentum = 0.6")
    with pytest.raises(aerofed.InputError, match=r"^out: .* the code of plug-in 'mine:algorithm'"):
        aerofed.resume("out")
    (tmp_path / "helper.py").write_text("momentum = 0.5")
    (tmp_path / "mine_too.py").write_text(f"{MODULE}# a callback alters nothing")
    assert len(aerofed.resume("out").rounds) == 2


@pytest.mark.slow
def test_a_sweep_keeps_no_run_of_other_code() -> None:
    def sweep(*algorithms: str) -> aerofed.Sweep:
        settings = {"learning.algorithm": list(algorithms)}
        return aerofed.sweep(
            "quickstart", strategies=["cov"], seeds=1, settings=settings, overrides=SMALL,
            out="out", jobs=1,
        )  # fmt: skip

    light = MODULE.replace("import torch", "").partition("class Net")[0]
    light += "def algorithm(learning): return Algorithm()\n"
    Path("mine.py").write_text(light)
    before = sweep("mine:algorithm", "fedavg")
    assert json.loads(Path("out/sweep.json").read_text())["plugins"].keys() == {"mine:algorithm"}
    Path("mine.py").write_text(f"{light}# edited")
    names = before.runs["run"]
    with pytest.raises(aerofed.InputError, match=rf"^out/runs/{names[0]}: finished, but the code"):
        sweep("mine:algorithm", "fedavg")
    shutil.rmtree(f"out/runs/{names[0]}")
    kept = Path(f"out/runs/{names[1]}/summary.json").stat().st_mtime_ns
    assert sweep("mine:algorithm", "fedavg").runs.equals(before.runs)
    assert Path(f"out/runs/{names[1]}/summary.json").stat().st_mtime_ns == kept


def test_a_callback_that_failed_is_passed_when_the_run_goes_on() -> None:
    more = {**SMALL, "callbacks": ["mine:TellsBadly"]}
    with pytest.raises(UsersCodeError):
        aerofed.run("quickstart", more, out="out")
    module = Path("mine.py")
    module.write_text(MODULE.replace('raise OSError("no server")', "pass"))
    assert len(aerofed.resume("out").rounds) == 2


@pytest.mark.parametrize("kind", KEYS)
def test_a_module_that_is_not_there_is_found_out_at_once(kind: str) -> None:
    value: Any = "nowhere.at_all:make"
    with pytest.raises(aerofed.InputError, match="nowhere"):
        aerofed.config("quickstart", {KEYS[kind]: [value] if kind == "callbacks" else value})


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("learning.algorithm", "must be one of 'fedprox', .* did you mean fedavg?"),
        ("learning.trainer", "must be an import path"),
        ("radio.truth", "must be one of 'channel', 'buildings', 'map' or the import path"),
        ("radio.belief", "must be one of 'channel', 'buildings', 'map', 'learned', 'truth' or the"),
        ("communities.0.task", "must be one of 'digits', "),
        ("communities.0.partition", "must be one of 'labels', "),
        ("communities.0.network", "must be one of 'lenet', 'mcmahan', 'convnet' or the import"),
        ("planner.factory", "must be an import path"),
        ("callbacks", r"callbacks\.0 = .fedvag.: must be an import path"),
    ],
)
def test_a_name_that_is_none(key: str, words: str) -> None:
    value: Any = ["fedvag"] if key == "callbacks" else "fedvag"
    with pytest.raises(aerofed.InputError, match=words):
        aerofed.config("quickstart", {key: value})


def test_owners_and_buffers_that_are_not_there() -> None:
    with pytest.raises(aerofed.InputError, match="the data of digits do not tell any owners"):
        aerofed.run("quickstart", {**SMALL, "communities.0.partition": "owners"}, out="out")
    with pytest.raises(aerofed.InputError, match="buffers belongs to a torch module of your own"):
        aerofed.config("quickstart", {"communities.0.buffers": "local"})
    more = {"communities.0.network": "mine:Net", "communities.0.buffers": "local"}
    with pytest.raises(aerofed.InputError, match="buffers = 'local': its network has none"):
        aerofed.run("quickstart", {**SMALL, **more}, out="out")


def test_callbacks_before_one_that_cannot_be_made_are_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "half_made.py").write_text(
        "closed = []\n"
        "class Told:\n"
        "    def round_finished(self, report): ...\n"
        "    def close(self): closed.append(True)\n"
        "def first(context): return Told()\n"
        "def second(context): raise RuntimeError('no')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    config = aerofed.config("quickstart", {"callbacks": ["half_made:first", "half_made:second"]})
    with pytest.raises(aerofed.AerofedError, match="half_made:second"):
        make_callbacks(CallbackContext(tmp_path, config))
    assert importlib.import_module("half_made").closed == [True]


@pytest.mark.parametrize("name", ["config.toml", "checkpoint/rounds.json", "devices.csv"])
@pytest.mark.parametrize("closes", ["well", "badly"])
def test_callbacks_are_closed_once_where_the_run_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, closes: str
) -> None:
    module = f"closed_{closes}_{Path(name).stem}"
    (tmp_path / f"{module}.py").write_text(
        "closed = []\n"
        "class InTheWay:\n"
        f"    def __init__(self, context): (context.folder / {name!r}).mkdir()\n"
        "    def round_finished(self, report): ...\n"
        "    def close(self):\n"
        "        closed.append(True)\n"
        f"        assert {closes!r} == 'well'\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    more = {**SMALL, "callbacks": [f"{module}:InTheWay"]}
    with pytest.raises(aerofed.InputError, match=f"{name}: cannot write: Is a directory"):
        aerofed.run("quickstart", more, out=tmp_path / "out")
    assert importlib.import_module(module).closed == [True]


def test_a_belief_is_given_what_it_cannot_write_to_and_prints_to_standard_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("greedy.py").write_text(GREEDY)
    sys.modules.pop("greedy", None)
    given = {**SMALL, **WALLED, "radio.belief": "greedy:Belief"}
    given["area.buildings"] = "[{polygon_m = [[400, 300], [600, 300], [600, 310]], height_m = 30}]"
    sets = [f"--set={key}={value}" for key, value in given.items()]
    assert call(["run", "--out=out", "--json", "--no-report", *sets]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["folder"] == "out"
    assert told.err.count("in a belief") == 3
    assert aerofed.load("out").summary["plugins"] == {"greedy:Belief": digest_of("greedy:Belief")}


def test_a_belief_of_other_code_is_not_gone_on_with(monkeypatch: pytest.MonkeyPatch) -> None:
    more = {**SMALL, **WALLED, "radio.belief": "mine:Belief"}
    with cut_after(1), pytest.raises(aerofed.AerofedError):
        aerofed.run("quickstart", more, out="out")
    Path("mine.py").write_text(f"{MODULE}# edited")
    with pytest.raises(aerofed.InputError, match=r"^out: .* the code of plug-in 'mine:Belief'"):
        aerofed.resume("out")
    Path("mine.py").unlink()
    monkeypatch.delitem(sys.modules, "mine")
    with pytest.raises(
        aerofed.InputError, match=r"^out: .* 'mine:Belief' cannot be imported: .*No "
    ):
        aerofed.resume("out")
    Path("mine.py").write_text(MODULE)
    assert len(aerofed.resume("out").rounds) == 2
