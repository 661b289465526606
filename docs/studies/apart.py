"""Where weights can move anything: rounds planned for communities that live apart or mixed.

    python docs/studies/apart.py --out docs/data/apart-screen --figures docs/images --jobs 2

Nothing is flown or learnt. `--out` gets screen.csv, a row a setting, seed and importance ratio, and
README.md with its tables; rows that are there already are kept. What is planned, why, and what
follows from it was written before: docs/data/PLAN.md, stage 1.
"""

import argparse
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import apart_picture
import apart_shift
import numpy as np
import pandas as pd
from study import Floats

import aerofed
from mission.figures.render import save_all

Row = dict[str, object]

SEEDS = range(101, 117)
ROUNDS, LEFT_OUT = 16, 4  # a draw, and the first of them, which the start shapes
AREA_M = 800.0
EACH = 6  # devices of a community; CIFAR-10's come first


def _mixed(u: Floats, _: Floats) -> Floats:
    return AREA_M * u


def _halves(u: Floats, _: Floats) -> Floats:
    return AREA_M * u * (0.5, 1.0) + np.repeat([[0.0, 0.0], [AREA_M / 2, 0.0]], EACH, axis=0)


def _corners(u: Floats, _: Floats) -> Floats:
    return 250.0 * u + np.repeat([[0.0], [550.0]], EACH, axis=0)


def _rim(u: Floats, _: Floats) -> Floats:
    side, along_m, deep_m = 4.0 * u[:EACH, 0] // 1.0, AREA_M * (4.0 * u[:EACH, 0] % 1.0), 100.0
    a, b = along_m, deep_m * u[:EACH, 1]
    x = np.choose(side.astype(int), [a, AREA_M - b, AREA_M - a, b])
    y = np.choose(side.astype(int), [b, a, AREA_M - b, AREA_M - a])
    return np.vstack([np.column_stack([x, y]), 200.0 + 400.0 * u[EACH:]])


def _clusters(u: Floats, w: Floats) -> Floats:
    return np.repeat(40.0 + 600.0 * w, EACH // 2, axis=0) + 120.0 * u


LAYOUTS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "mixed": _mixed,
    "halves": _halves,
    "corners": _corners,
    "rim": _rim,
    "clusters": _clusters,
}


def positions_m(layout: str, seed: int) -> Floats:
    """(12, 2) where the devices of a draw stand; all layouts of a seed share their luck."""
    rng = np.random.default_rng(seed)
    u, w = rng.uniform(size=(2 * EACH, 2)), rng.uniform(size=(4, 2))
    return LAYOUTS[layout](u, w)


@dataclass(frozen=True)
class Setting:
    """What rounds are planned with; the defaults are the base."""

    layout: str
    steps: int = 2  # N
    per_step: int = 3  # K_bar
    channel: str = "suburban"
    planner: str = "certified"
    path_budget_m: float = 800.0  # L_max
    boost: float = 1.5  # lambda
    ratio: float = 1.0  # importance of CIFAR-10's devices over that of MNIST's


STEPS, PER_STEP = (2, 3, 4, 6, 10), (1, 2, 3, 4)
RATIO, OTHER_RATIOS = 3.0, (1.5, 2.0, 5.0)
CHANNELS = (
    "suburban-7dB", "suburban-4dB", "suburban+3dB", "urban", "dense-urban", "suburban-log-variance",
)  # fmt: skip


def grid() -> list[Setting]:
    """Every setting: N and K_bar in full, all else alone around the base; each at two ratios."""
    settings: list[Setting] = []
    for layout in LAYOUTS:
        base = Setting(layout)
        plain = [
            *(replace(base, steps=n, per_step=k) for n, k in product(STEPS, PER_STEP)),
            *(replace(base, channel=channel) for channel in CHANNELS),
            replace(base, planner="paper"),
            *(replace(base, path_budget_m=metres) for metres in (400.0, 1200.0)),
            replace(base, boost=3.0),
        ]
        settings += (replace(s, ratio=ratio) for s, ratio in product(plain, (1.0, RATIO)))
        settings += (replace(base, ratio=ratio) for ratio in OTHER_RATIOS)
    return settings


@cache
def _channel(name: str) -> aerofed.Channel:
    """A preset, or ours with some dB more or less."""
    if name.endswith("dB"):
        gain_db = float(name.removeprefix("suburban").removesuffix("dB"))
        return aerofed.channel("suburban", extra_gain_db=gain_db)
    return aerofed.channel(name)


def planned(setting: Setting, seed: int) -> Row:
    """Round after round, each from where the last one ended: a row of screen.csv.

    Participation: updates that arrive, in expectation, over devices. All are means of the rounds.
    """
    devices_m, start_m = positions_m(setting.layout, seed), np.full(2, AREA_M / 2)
    weight = np.repeat([setting.ratio, 1.0], EACH) / EACH
    heard, metres = np.ones((ROUNDS + 1, 2 * EACH)), np.zeros(ROUNDS)
    for index in range(ROUNDS):
        problem = aerofed.RoundProblem(
            devices_m=devices_m,
            importance=weight * (1.0 + (setting.boost - 1.0) * (1.0 - heard[index])),
            starts=(aerofed.Start(start_m, setting.path_budget_m),),
            steps=setting.steps,
            per_step=setting.per_step,
            channel=_channel(setting.channel),
        )
        plan = aerofed.plan(problem, setting.planner)
        away_m = np.linalg.norm(devices_m[None] - plan.waypoints_m[:, None], axis=2)
        per = problem.channel.per(away_m.ravel()).reshape(away_m.shape)
        heard[index + 1] = ((1.0 - per) * plan.schedule[0]).sum(axis=0)
        metres[index], start_m = plan.path_m, plan.waypoints_m[-1]
    late = heard[1 + LEFT_OUT :]
    return {
        **asdict(setting),
        "seed": seed,
        "participation_cifar10": round(float(late[:, :EACH].mean()), 5),
        "participation_mnist": round(float(late[:, EACH:].mean()), 5),
        "path_m": round(float(metres[LEFT_OUT:].mean()), 2),
    }


def _planned(task: tuple[int, Setting]) -> Row:
    seed, setting = task
    return planned(setting, seed)


def screen(target: Path, jobs: int) -> None:
    """All settings with each seed, a row after the other; goes on with a file that is there."""
    # Those that take thirty times as long last, so that all else is there early.
    tasks = sorted(product(SEEDS, grid()), key=lambda task: task[1].planner == "paper")
    done = len(pd.read_csv(target)) if target.is_file() else 0
    with ProcessPoolExecutor(jobs) as pool, target.open("a", encoding="utf-8") as file:
        for index, row in enumerate(pool.map(_planned, tasks[done:], chunksize=8), start=done):
            pd.DataFrame([row]).to_csv(file, index=False, header=index == 0, lineterminator="\n")
            file.flush()


def main() -> None:
    """Plan what was not yet; write tables; draw on demand."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--figures", type=Path, metavar="DIR", help="draw into this folder")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = options.out / "screen.csv"
    screen(rows, options.jobs)
    made = pd.read_csv(rows)
    (options.out / "README.md").write_text(apart_shift.tables(made), encoding="utf-8")
    if options.figures is not None:
        save_all({"apart-screen.png": apart_picture.picture(made)}, options.figures)


if __name__ == "__main__":
    main()
