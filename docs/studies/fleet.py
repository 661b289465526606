"""What a second aircraft brings: runs of one to four, and the tables of docs/fleet.md.

    python docs/studies/fleet.py runs RUNS --jobs 2            # a table for each seed, not flown
    python docs/studies/fleet.py cells RUNS --jobs 2           # one to four aircraft, flown
    python docs/studies/fleet.py joules RUNS --jobs 2          # the same within joules
    python docs/studies/fleet.py data RUNS --data-dir DATA     # one and three, MNIST and CIFAR-10
    python docs/studies/fleet.py flown RUNS --jobs 2           # three aircraft in wind, flown
    python docs/studies/fleet.py tables RUNS --out docs/data/fleet

docs/data/PLAN-fleet.md says what is run. Seeds that are done are kept.
"""

import argparse
from collections.abc import Callable, Iterable
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd
from study import csv, finished, in_parallel, markdown, mean_of, parts, write

import aerofed
from mission.base.run_folder import write_atomically
from mission.config.loading import load_config

SEEDS, IN_WIND = range(401, 417), range(501, 585)
SHARED, OWN = "shared", "own"
CORNERS_M = ((150.0, 150.0), (650.0, 650.0), (650.0, 150.0), (150.0, 650.0))
IN_ALL, EACH = "800 m in all", "400 m each"
JOULES = "12 kJ in all"
JOINT, IN_TURN, DIVIDED = "jointly", "one after another", "by division"
STRATEGIES = {JOINT: "cov", IN_TURN: "one_after_another:make", DIVIDED: "partition:make"}
LIMITS = {IN_ALL: (800.0, None), EACH: (400.0, None), JOULES: (800.0, 12e3)}  # metres, joules
KEYS = ["homes", "metres", "aircraft", "planned"]
FLOWN_GAP = 0.05  # within joules, closer proofs take minutes
Cell: TypeAlias = tuple[str, str, int, str]
COMMUNITIES = ("digits", "colour-shapes")
SEPARATION_M = 10.0
WIND = {"speed_mps": 6.0, "from_deg": 270.0, "turbulence_severity": 3}


def config_of(
    seed: int,
    homes: str,
    metres: str,
    aircraft: int,
    planned: str,
    like: str = "quickstart",
    **more: Any,
) -> aerofed.RunConfig:
    """The configuration of a run."""
    own = [{"home_m": list(at)} for at in CORNERS_M[:aircraft]]
    metres_m, joules = LIMITS[metres]
    shared_by = 1 if metres == EACH else aircraft
    return load_config(
        Path(like),
        {
            "seed": seed,
            "vehicles": aircraft if homes == SHARED else own,
            "mission.flight": "none",
            "mission.path_budget_m": metres_m / (1 if joules else shared_by),
            "mission.round_energy_j": joules and joules / shared_by,
            "channel.extra_gain_db": -10.0,
            "mission.strategy": STRATEGIES[planned],
            **{key.replace("__", "."): value for key, value in more.items()},
        },
    )


def _rounds(
    seed: int, cells: Iterable[Cell], data_dir: Path | None = None, **more: Any
) -> pd.DataFrame:
    """The rounds of the runs of some cells."""
    found = []
    for cell in cells:
        config, name = config_of(seed, *cell, **more), f"{seed} {cell}"
        with finished(config, name, data_dir=data_dir, code=Path(__file__).parent) as path:
            rounds = pd.read_csv(path / "rounds.csv")
        found.append(rounds.assign(seed=seed, **dict(zip(KEYS, cell, strict=True))))
    return pd.concat(found)


def one_seed(out: Path, seed: int) -> str:
    """Write the rounds of all unflown runs of a seed."""
    cells = [*product((SHARED, OWN), (IN_ALL, EACH), (1, 2, 3, 4), (JOINT,))]
    cells += product((SHARED, OWN), (EACH,), (3,), (IN_TURN, DIVIDED))
    write_atomically(out / f"{seed}.csv", csv(_rounds(seed, cells)))
    return f"seed {seed}"


def one_seed_flown(out: Path, seed: int, limit: str = EACH, name: str = "cells") -> str:
    """Write the rounds of the runs of a seed that are flown within a limit, in calm air."""
    cells = product((SHARED, OWN), (limit,), (1, 2, 3, 4), (JOINT,))
    found = _rounds(seed, cells, mission__flight="flown", planner__gap=FLOWN_GAP)
    write_atomically(out / f"{name}-{seed}.csv", csv(found))
    return f"seed {seed}, {limit} flown"


def one_seed_in_joules(out: Path, seed: int) -> str:
    """Write those within joules."""
    return one_seed_flown(out, seed, JOULES, "joules")


def one_seed_on_all_data(out: Path, seed: int, data_dir: Path) -> str:
    """Write the rounds of one and of three aircraft, not flown, that learn from all data."""
    cells = product((SHARED,), (EACH,), (1, 3), (JOINT,))
    rounds = _rounds(seed, cells, data_dir, like="paper", mission__steps=10, mission__rounds=12)
    write_atomically(out / f"data-{seed}.csv", csv(rounds))
    return f"seed {seed}, all data"


def one_flight(out: Path, seed: int) -> str:
    """Write the aircraft's rows of a flown run of three."""
    wind: dict[str, Any] = {f"vehicle__aircraft__wind__{key}": at for key, at in WIND.items()}
    config = config_of(
        seed, SHARED, EACH, 3, JOINT, mission__flight="flown", mission__rounds=12,
        mission__separation_m=SEPARATION_M, **wind,
    )  # fmt: skip
    with finished(config, f"{seed} flown") as path:
        aircraft = pd.read_csv(path / "aircraft.csv")
    write_atomically(out / f"flown-{seed}.csv", csv(aircraft.assign(seed=seed)))
    return f"seed {seed}, flown"


def _paired(rounds: pd.DataFrame, value: str) -> pd.DataFrame:
    """A value of each run: a row for each seed, a column for each cell."""
    return rounds.groupby(["seed", *KEYS])[value].mean().unstack(KEYS)


def _gains(rounds: pd.DataFrame, limits: tuple[str, ...]) -> str:
    """What each aircraft brings over one fewer. Who does not fly takes no joules."""
    updates, seconds = _paired(rounds, "delivered"), _paired(rounds, "duration_s")
    last = rounds[rounds["round"] == rounds["round"].max()]
    accuracy = [100.0 * _paired(last, f"accuracy_{name}") for name in COMMUNITIES]
    rows = []
    flown = [_paired(rounds, value) for value in ("flown_path_m", "energy_j")]
    done = [limit for limit in limits if limit in set(rounds["metres"])]
    for homes, limit, aircraft in product((SHARED, OWN), done, (1, 2, 3, 4)):
        cell = (homes, limit, aircraft, JOINT)
        more = ""
        if aircraft > 1:
            more = mean_of(updates[cell] - updates[homes, limit, aircraft - 1, JOINT], sign="+")
        rows.append([
            homes, limit, str(aircraft), mean_of(updates[cell]), more, mean_of(seconds[cell]),
            f"{flown[0][cell].mean():.0f}", f"{flown[1][cell].mean() / 1e3:.1f}".replace("nan", ""),
            *(mean_of(each[cell]) for each in accuracy),
        ])  # fmt: skip
    return markdown(
        ["homes", "limit", "A", "updates a round", "over one fewer", "s a round", "metres in all",
         "kJ in all", "digits, %", "colour-shapes, %"],
        rows,
    )  # fmt: skip


def _against(rounds: pd.DataFrame) -> str:
    """Joint plans against those made in other ways."""
    updates = _paired(rounds, "delivered")
    # Later importances are other ones: they depend on who was heard.
    value = _paired(rounds[rounds["round"] == 1], "plan_objective")
    rows = []
    for homes, planned in product((SHARED, OWN), (IN_TURN, DIVIDED)):
        cell, joint = ((homes, EACH, 3, how) for how in (planned, JOINT))
        rows.append([
            homes, planned, mean_of(value[cell], 3), mean_of(value[joint], 3),
            mean_of(100.0 * (value[joint] / value[cell] - 1.0), sign="+"),
            mean_of(updates[cell]), mean_of(updates[joint]),
            mean_of(updates[joint] - updates[cell], sign="+"),
        ])  # fmt: skip
    heads = ["homes", "planned", "value of round 1", "jointly", "jointly more, %", "updates",
             "jointly", "difference"]  # fmt: skip
    return markdown(heads, rows)


def _on_all_data(rounds: pd.DataFrame) -> str:
    """What three bring over one where all data are learned from."""
    last = rounds[rounds["round"] == rounds["round"].max()]
    values = {"updates a round": _paired(rounds, "delivered")}
    for name in ("cifar10", "mnist"):
        values[f"{name}, %"] = 100.0 * _paired(last, f"accuracy_{name}")
    one, three = ((SHARED, EACH, aircraft, JOINT) for aircraft in (1, 3))
    rows = [
        [name, mean_of(of[one]), mean_of(of[three]), mean_of(of[three] - of[one], sign="+")]
        for name, of in values.items()
    ]
    table = markdown(["", "one", "three", "difference"], rows)
    return f"{rounds['seed'].nunique()} seeds, {rounds['round'].max()} rounds.\n\n{table}"


def _apart(aircraft: pd.DataFrame) -> str:
    """How near the flown ones came."""
    rounds = aircraft.groupby(["seed", "round"]).agg(
        planned=("plan_nearest_m", "min"), flown=("nearest_m", "min")
    )
    kept = rounds[rounds["planned"] >= SEPARATION_M]
    below = int((kept["flown"] < SEPARATION_M).sum())
    less = (kept["planned"] - kept["flown"]).clip(upper=100.0)
    together = aircraft.groupby(["seed", "round"])["aircraft"].transform("size") > 1
    lost = together & aircraft["idle_s"].isna()  # who is lost does not wait for the others
    return (
        f"{len(rounds)} rounds of {aircraft['seed'].nunique()} seeds, {lost.sum()} aircraft lost; "
        f"{len(kept)} kept "
        f"{SEPARATION_M:g} m by plan, of which {below} came nearer as flown. Least planned "
        f"{kept['planned'].min():.1f} m, least flown {kept['flown'].min():.1f} m; flown at most "
        f"{less.max():.1f} m less than planned."
    )


def tables(runs: Path, out: Path) -> None:
    """Write the page and the rows of what is done."""
    done = sorted(runs.glob("4*.csv"))
    rounds = pd.concat((pd.read_csv(each) for each in done), ignore_index=True)
    flown = sorted(runs.glob("flown-*.csv"))
    gaps = (rounds["upper_bound"] - rounds["plan_objective"]) / rounds["upper_bound"]
    of = rounds[rounds["planned"] == JOINT].assign(gap=100.0 * gaps)["gap"]
    texts = {
        "What each aircraft brings": _gains(rounds, (IN_ALL, EACH)),
        "Jointly, or otherwise": _against(rounds),
        "What is proven": f"{len(of)} rounds: median {of.median():.2f} %, worst {of.max():.2f} %.",
    }
    columns = ["seed", *KEYS, "round", "plan_objective", "upper_bound", "delivered", "duration_s",
               "plan_path_m", "flown_path_m", "energy_j",
               *(f"accuracy_{name}" for name in COMMUNITIES)]  # fmt: skip
    kept = {"rounds": rounds[columns]}
    for name, limit in (("cells", EACH), ("joules", JOULES)):
        if done := sorted(runs.glob(f"{name}-*.csv")):
            kept[name] = pd.concat(map(pd.read_csv, done))[columns]
            texts[f"What each brings, {limit}, flown"] = (
                f"{len(done)} seeds.\n\n{_gains(kept[name], (limit,))}"
            )
    if learned := sorted(runs.glob("data-*.csv")):
        kept["data"] = pd.concat(map(pd.read_csv, learned), ignore_index=True)
        texts["On all data, 400 m each, not flown"] = _on_all_data(kept["data"])
    if flown:
        aircraft = pd.concat(map(pd.read_csv, flown))
        texts["Flown in wind"] = _apart(aircraft)
        kept["flown"] = aircraft
    head = (
        f"# What a second aircraft brings: figures\n\nMade by docs/studies/fleet.py, of "
        f"{rounds['seed'].nunique()} seeds; [the plan](../PLAN-fleet.md).\n"
    )
    write(out, head + parts(texts), **kept)


MADE: dict[str, tuple[Callable[..., str], str, range]] = {
    "runs": (one_seed, "", SEEDS),
    "cells": (one_seed_flown, "cells-", SEEDS),
    "joules": (one_seed_in_joules, "joules-", SEEDS),
    "data": (one_seed_on_all_data, "data-", SEEDS),
    "flown": (one_flight, "flown-", IN_WIND),
}


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("what", choices=(*MADE, "tables"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--data-dir", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/data/fleet"))
    given = parser.parse_args()
    if given.what == "tables":
        tables(given.folder, given.out)
        return
    given.folder.mkdir(parents=True, exist_ok=True)
    make, before, seeds = MADE[given.what]
    left = [seed for seed in seeds if not (given.folder / f"{before}{seed}.csv").exists()]
    more = (given.data_dir,) if given.what == "data" else ()
    in_parallel(given.jobs, [(make, (given.folder, seed, *more)) for seed in left])


if __name__ == "__main__":
    main()
