"""The best known plan of each round problem: those published, or new ones where they are better.

    aerofed plan --problem docs/data/problems/problems.json --out new.json
    python docs/studies/best_plans.py docs/data/problems/plans.json new.json "Aerofed, 28 Nov. 2026"

Values are those of the evaluator beside the problems, which knows nothing of our code. A bound
holds for the problem, whichever plan it was proven with: the tighter one stays. `origin` says who
made a plan.
"""

import argparse
import importlib.util
import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "data" / "problems"
BETTER = 1e-9  # relative: less is rounding
Plans = dict[str, dict[str, Any]]


def best_known(problems: list[dict[str, Any]], known: Plans, new: Plans, origin: str) -> Plans:
    """Return the better plan of each problem with the tighter bound; a problem may lack a new one.

    Raises:
        ValueError: a plan is worth more than a bound.
    """
    spec = importlib.util.spec_from_file_location("evaluate", FOLDER / "evaluate.py")
    assert spec is not None
    assert spec.loader is not None
    evaluator = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(evaluator)
    best = {}
    for problem in problems:
        name = problem["id"]
        old, other = known[name], new.get(name, known[name])
        value = evaluator.evaluate(problem, other)[0]
        better = value > evaluator.evaluate(problem, old)[0] * (1.0 + BETTER)
        plan = dict(other, origin=origin) if better else dict(old)
        bound = min(old["upper_bound"], other["upper_bound"])
        if plan["value"] > bound * (1.0 + BETTER):
            raise ValueError(f"{name}: a plan is worth {plan['value']}, and a bound says {bound}")
        plan["upper_bound"] = max(bound, plan["value"])
        plan["gap"] = 1.0 - plan["value"] / plan["upper_bound"] if bound else 0.0
        if {"deadline_s", "energy_j"} & {*problem}:
            takes = map(float, evaluator.evaluate(problem, plan))
            _, plan["duration_s"], plan["energy_j"] = takes
        best[name] = plan
    return best


def main() -> None:
    """Write them in the place of those published."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("known", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("origin")
    asked = parser.parse_args()
    problems, known, new = (
        json.loads(path.read_text(encoding="utf-8"))
        for path in (FOLDER / "problems.json", asked.known, asked.new)
    )
    content = best_known(problems, known, new, asked.origin)
    lines = ",\n ".join(f"{json.dumps(name)}: {json.dumps(plan)}" for name, plan in content.items())
    asked.known.write_text(f"{{{lines}}}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
