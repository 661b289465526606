"""What a second aircraft brings: runs of one to four, and the tables of docs/fleet.md.

    python docs/studies/fleet.py runs RUNS --jobs 2            # a table for each seed, not flown
    python docs/studies/fleet.py flown RUNS --jobs 2           # three aircraft in wind, flown
    python docs/studies/fleet.py tables RUNS --out docs/data/fleet

docs/data/PLAN-fleet.md says what is run. Seeds that are done are kept.
"""

import argparse
from itertools import product
from pathlib import Path

import pandas as pd
from study import csv, finished, in_parallel, markdown, mean_of, parts, write

import aerofed
from mission.base.run_folder import write_atomically
from mission.config.loading import load_config

SEEDS = range(401, 417)
SHARED, OWN = "shared", "own"
CORNERS_M = ((150.0, 150.0), (650.0, 650.0), (650.0, 150.0), (150.0, 650.0))
IN_ALL, EACH = "800 m in all", "400 m each"
JOINT, IN_TURN = "jointly", "one after another"
KEYS = ["homes", "metres", "aircraft", "planned"]
COMMUNITIES = ("digits", "colour-shapes")
SEPARATION_M = 10.0
WIND = {"speed_mps": 6.0, "from_deg": 270.0, "turbulence_severity": 3}


def config_of(
    seed: int, homes: str, metres: str, aircraft: int, planned: str, **more: object
) -> aerofed.RunConfig:
    """The configuration of a run."""
    own = [{"home_m": list(at)} for at in CORNERS_M[:aircraft]]
    return load_config(
        Path("quickstart"),
        {
            "seed": seed,
            "vehicles": aircraft if homes == SHARED else own,
            "mission.flight": "none",
            "mission.path_budget_m": 400.0 if metres == EACH else 800.0 / aircraft,
            "channel.extra_gain_db": -10.0,
            "mission.strategy": "cov" if planned == JOINT else "one_after_another:make",
            **{key.replace("__", "."): value for key, value in more.items()},
        },
    )


def one_seed(out: Path, seed: int) -> str:
    """Write the rounds of all runs of a seed."""
    cells = [*product((SHARED, OWN), (IN_ALL, EACH), (1, 2, 3, 4), (JOINT,))]
    cells += [(homes, EACH, 3, IN_TURN) for homes in (SHARED, OWN)]
    found = []
    for cell in cells:
        config = config_of(seed, *cell)
        with finished(config, f"{seed} {cell}", code=Path(__file__).parent) as path:
            rounds = pd.read_csv(path / "rounds.csv")
        found.append(rounds.assign(seed=seed, **dict(zip(KEYS, cell, strict=True))))
    write_atomically(out / f"{seed}.csv", csv(pd.concat(found)))
    return f"seed {seed}"


def one_flight(out: Path, seed: int) -> str:
    """Write the aircraft's rows of a flown run of three."""
    wind = {f"vehicle__aircraft__wind__{key}": value for key, value in WIND.items()}
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


def _gains(rounds: pd.DataFrame) -> str:
    """What each aircraft brings over one fewer."""
    updates, seconds = _paired(rounds, "delivered"), _paired(rounds, "duration_s")
    last = rounds[rounds["round"] == rounds["round"].max()]
    accuracy = [100.0 * _paired(last, f"accuracy_{name}") for name in COMMUNITIES]
    rows = []
    for homes, metres, aircraft in product((SHARED, OWN), (IN_ALL, EACH), (1, 2, 3, 4)):
        cell = (homes, metres, aircraft, JOINT)
        more = ""
        if aircraft > 1:
            more = mean_of(updates[cell] - updates[homes, metres, aircraft - 1, JOINT], sign="+")
        rows.append([
            homes, metres, str(aircraft), mean_of(updates[cell]), more,
            mean_of(seconds[cell]), *(mean_of(each[cell]) for each in accuracy),
        ])  # fmt: skip
    return markdown(
        ["homes", "metres", "A", "updates a round", "over one fewer", "s a round",
         "digits, %", "colour-shapes, %"],
        rows,
    )  # fmt: skip


def _against(rounds: pd.DataFrame) -> str:
    """Joint plans against those made one after another."""
    updates = _paired(rounds, "delivered")
    # Later importances are other ones: they depend on who was heard.
    value = _paired(rounds[rounds["round"] == 1], "plan_objective")
    rows = []
    for homes in (SHARED, OWN):
        both = [(homes, EACH, 3, planned) for planned in (JOINT, IN_TURN)]
        rows.append([
            homes, *(mean_of(value[cell], 3) for cell in both),
            *(mean_of(updates[cell]) for cell in both),
            mean_of(updates[both[0]] - updates[both[1]], sign="+"),
        ])  # fmt: skip
    heads = ["homes", "value of round 1, jointly", "one after another", "updates, jointly",
             "one after another", "difference"]  # fmt: skip
    return markdown(heads, rows)


def _apart(aircraft: pd.DataFrame) -> str:
    """How near the flown ones came."""
    rounds = aircraft.groupby(["seed", "round"]).agg(
        planned=("plan_nearest_m", "min"), flown=("nearest_m", "min")
    )
    kept = rounds[rounds["planned"] >= SEPARATION_M]
    below = int((kept["flown"] < SEPARATION_M).sum())
    less = (kept["planned"] - kept["flown"]).clip(upper=100.0)
    return (
        f"{len(rounds)} rounds of {aircraft['seed'].nunique()} seeds; {len(kept)} kept "
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
        "What each aircraft brings": _gains(rounds),
        "Jointly, or one after another": _against(rounds),
        "What is proven": f"{len(of)} rounds: median {of.median():.2f} %, worst {of.max():.2f} %.",
    }
    kept = {"rounds": rounds[["seed", *KEYS, "round", "plan_objective", "upper_bound", "delivered",
                              "duration_s", "plan_path_m",
                              *(f"accuracy_{name}" for name in COMMUNITIES)]]}  # fmt: skip
    if flown:
        aircraft = pd.concat(map(pd.read_csv, flown))
        texts["Flown in wind"] = _apart(aircraft)
        kept["flown"] = aircraft
    head = (
        f"# What a second aircraft brings: figures\n\nMade by docs/studies/fleet.py, of "
        f"{rounds['seed'].nunique()} seeds; [the plan](../PLAN-fleet.md).\n"
    )
    write(out, head + parts(texts), **kept)


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("what", choices=("runs", "flown", "tables"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("docs/data/fleet"))
    given = parser.parse_args()
    if given.what == "tables":
        tables(given.folder, given.out)
        return
    given.folder.mkdir(parents=True, exist_ok=True)
    make, before = (one_seed, "") if given.what == "runs" else (one_flight, "flown-")
    left = [seed for seed in SEEDS if not (given.folder / f"{before}{seed}.csv").exists()]
    in_parallel(given.jobs, [(make, (given.folder, seed)) for seed in left])


if __name__ == "__main__":
    main()
