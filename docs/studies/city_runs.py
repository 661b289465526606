"""What planning with an average costs in four cities: runs, and the tables of docs/city.md.

    python docs/studies/city_runs.py channels MAPS                     # the averages of `CHANNELS`
    python docs/studies/city_runs.py runs RUNS --jobs 2 --flown        # a table a seed and city
    python docs/studies/city_runs.py runs RUNS --jobs 2                # the same runs, not flown
    python docs/studies/city_runs.py tables RUNS --out docs/data/city  # or docs/data/city itself

Every run is one of `aerofed run city`. With `--flown` our simulated vehicle flies; without it truth
is where the plan is, so what a plan loses is the radio's alone, and all else is equal. The radio
over Munich and Florence is traced (Sionna RT, an extra), for the devices of each seed; maps are
kept beside the tables, and so are runs that are done. `buildings` believes in the walls of the
same scenes.
"""

import argparse
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import shapely
from grid_city import rings_of
from scipy.optimize import least_squares
from study import csv, dots, finished, in_parallel, markdown, mean_of, one_scale, panel, write

import aerofed
from fl.radio.channel import Channel, average_per
from fl.radio.per_grid import PerGrid
from fl.radio.place import LinkTerms, PlacedRadio
from mission.base.run_folder import write_atomically
from mission.commands.radio_map import radio_map
from mission.config.area import HEIGHT_MARGIN_M, BuildingConfig
from mission.figures.render import save_all
from mission.figures.style import BAD, COOL, GOOD, WARM, Chart, arranged, heading
from mission.scenario.radio_maps import read_map

SEEDS = range(201, 217)
FIT_SEEDS = range(1, 4)  # whose maps the averages are of
ROUNDS, LATE = 6, 3  # rounds of a run, and how many at its end are late ones
CELL_M = 10.0
GAP = 0.1  # to be proven: closer proofs take up to a minute a run, for plans of the same worth
WALLS_FIRST = "learned from buildings"  # learned, with them as its prior
BELIEFS = ("channel", "buildings", "learned", WALLS_FIRST, "truth")
REPLANS = ("round", "stop")
COMPARED = ("channel", "learned", "truth")  # also at the stops, and also without flight
LOOKS = dict(zip(BELIEFS, (BAD, WARM, COOL, "#56B4E9", GOOD), strict=True))
FLOWN = "flown"  # value of `mission.flight`, folder of the flown runs, and name of their table
KEYS = ["city", "seed", "belief", "replan"]
# The channel that is nearest to the mean success at each distance; of the district, `city.toml`'s.
CHANNELS: dict[str, dict[str, float]] = {
    "district": {},
    "munich": {
        "alpha_los": 2.665,
        "beta_los_db": -41.805,
        "sigma_los": 1.135,
        "beta_nlos_db": -78.043,
        "sigma_nlos": 9.0,
        "a1_per_rad": 0.1,
        "a2": -1.89,
    },
    "florence": {
        "alpha_los": 2.831,
        "beta_los_db": -38.823,
        "sigma_los": 1.084,
        "beta_nlos_db": -100.294,
        "sigma_nlos": 9.0,
        "a1_per_rad": 0.1,
        "a2": -1.266,
    },
    "etoile": {
        "alpha_los": 2.474,
        "beta_los_db": -38.026,
        "sigma_los": 0.728,
        "beta_nlos_db": -40.0,
        "sigma_nlos": 2.159,
        "a1_per_rad": 3.924,
        "a2": 0.409,
    },
}
FITTED = {
    "alpha_los": (1.0, 6.0), "beta_los_db": (-90.0, 0.0), "sigma_los": (0.2, 6.0),
    "beta_nlos_db": (-140.0, -40.0), "sigma_nlos": (0.2, 9.0), "a1_per_rad": (0.1, 40.0),
    "a2": (-5.0, 20.0),
}  # fmt: skip
STARTS = {
    "alpha_los": (2.0, 4.0), "beta_los_db": (-40.0,), "sigma_los": (1.0, 3.0),
    "beta_nlos_db": (-47.0, -80.0), "sigma_nlos": (2.5,), "a1_per_rad": (3.5, 15.0), "a2": (4.0,),
}  # fmt: skip
KNOWN = ("alpha_los", "beta_los_db", "sigma_los")  # of the district: 3GPP's line of sight

_HEAD = """\
# What planning with an average costs, in four cities

Made from flown.csv.gz and rounds.csv.gz by
`python docs/studies/city_runs.py tables docs/data/city`; the runs by
`python docs/studies/city_runs.py runs`: {rounds} rounds, seeds {first} to {last} ({count} of them).
Mean ± 95 % interval over seeds (Student's t), differences seed by seed. Objectives are those of a
round: of its first plan, and by the true success of all that were asked, twice who was asked twice;
% is the second beside the first. Success is the mean of those who were asked in the last {late}
rounds, as hoped for and true. For all four each seed counts with the mean of its cities. The runs
are of commit 0675b191, those of seeds 209 to 216 of 250c8f42, which makes the same bytes of seed
201. They were flown; what that changed, by the seeds that were run without flight as well, is at
the end.
"""


def mapped(city: str, seed: int, folder: Path) -> Path:
    """The radio map of a city for the devices of a seed."""
    path = folder / f"{city}-{seed}.nc"
    if not path.exists():
        how: dict[str, Any] = {} if city == "district" else {"engine": "sionna", "scene": city}
        radio_map(Path("city"), out=path, cell=CELL_M, set_=(f"seed={seed}",), **how)
    return path


@cache
def walls(scene: str) -> list[BuildingConfig]:
    """The buildings of a scene: outlines from above, roofs at their mean height.

    They stop no flight, as they do not where a plan believes in something else: the few that are
    as high end below it, and none stands where it takes off.
    """
    import sionna.rt as rt

    area, mission = aerofed.config("city").area, aerofed.config("city").mission
    middle_m, most_m = np.array(area.size_m) / 2.0, mission.heights_m[0] - HEIGHT_MARGIN_M
    field = shapely.Point(area.home_m).buffer(area.margin_m + 1.0)
    ours = shapely.box(0.0, 0.0, *area.size_m).difference(field)
    faces: dict[str, list[np.ndarray]] = defaultdict(list)  # of walls and roof together
    for name, one in rt.load_scene(getattr(rt.scene, scene), merge_shapes=False).objects.items():
        corners = np.array(one.mi_mesh.vertex_positions_buffer()).reshape(-1, 3)
        whole = name.rpartition("-")[0] or name
        faces[whole].append(corners[np.array(one.mi_mesh.faces_buffer()).reshape(-1, 3)])
    for ground in ("ground", "Plane"):
        faces.pop(ground, None)
    found = []
    for triangles in map(np.concatenate, faces.values()):
        flat = shapely.polygons(triangles[..., :2] + middle_m)
        seen, up_m = shapely.area(flat) > 1e-3, triangles[..., 2]  # from above; no walls
        roof = seen & (up_m.min(axis=1) > up_m.min() + 0.5)
        height_m = np.average(up_m.mean(axis=1)[roof], weights=shapely.area(flat[roof]))
        ground = shapely.union_all(shapely.set_precision(flat[seen], 0.01)).simplify(0.5)
        inside = ground.intersection(ours)
        for part in getattr(inside, "geoms", [inside]):
            if part.geom_type == "Polygon" and part.area > 4.0:
                outline, *holes = (ring.tolist() for ring in rings_of(part))
                found.append(BuildingConfig(
                    polygon_m=outline, holes_m=holes, height_m=min(float(height_m), most_m)
                ))  # fmt: skip
    return found


def averaged(city: str, maps: Sequence[Path]) -> tuple[dict[str, float], float]:
    """The constants of the channel that comes nearest to maps, and how far off it is (rms)."""
    free = [name for name in FITTED if city != "district" or name not in KNOWN]
    config = aerofed.config("city")
    radio, height_m = config.radio, float(config.mission.heights_m[0])
    terms = LinkTerms(
        radio.tx_power_dbm, radio.bandwidth_hz, radio.noise_figure_db, radio.snr_threshold_db,
        radio.fading_db,
    )  # fmt: skip
    away, success = [], []
    for made in map(read_map, maps):
        grid = PerGrid.of(
            PlacedRadio(made, terms), len(made.devices_m), size_m=config.area.size_m,
            height_m=height_m, cell_m=CELL_M,
        )  # fmt: skip
        x_m, y_m = (CELL_M * np.arange(size) for size in grid.success.shape[:0:-1])
        for (x, y), mine in zip(made.devices_m, grid.success, strict=True):
            away.append(np.hypot(x_m[None, :] - x, y_m[:, None] - y).ravel())
            success.append(mine.ravel())
    bins = (np.concatenate(away) // 25.0).astype(int)
    count = np.bincount(bins)
    mean = np.bincount(bins, np.concatenate(success)) / count
    middle_m = 25.0 * (np.arange(len(count)) + 0.5)
    base = config.channel.channel(altitude_m=height_m)

    def channel(values: Sequence[float]) -> Channel:
        return replace(base, **dict(zip(free, map(float, values), strict=True)))

    def off(values: Sequence[float]) -> np.ndarray:
        believed = 1.0 - average_per(channel(values), middle_m, height_m=height_m)
        return np.asarray(np.sqrt(count / count.sum()) * (believed - mean))

    starts = product(*(STARTS[name] for name in free))
    low, high = zip(*(FITTED[name] for name in free), strict=True)
    found = min(
        (least_squares(off, start, bounds=(low, high)) for start in starts),
        key=lambda one: one.cost,
    )
    constants = dict(zip(free, np.round(found.x, 3).tolist(), strict=True))
    return constants, float(np.sqrt((off(list(constants.values())) ** 2).sum()))


def rounds_of(
    city: str, seed: int, belief: str, replan: str, made: Path | None, flight: str = "none"
) -> pd.DataFrame:
    """The rounds of a run, a row each.

    Raises:
        RuntimeError: the run failed, with what it said.
    """
    settings: dict[str, object] = {
        "seed": seed,
        "radio.belief": "learned" if belief == WALLS_FIRST else belief,
        "radio.prior": "buildings" if belief == WALLS_FIRST else None,
        "mission.replan": replan,
        "mission.rounds": ROUNDS,
        "mission.flight": flight,
        "planner.gap": GAP,
        **{f"channel.{name}": value for name, value in CHANNELS[city].items()},
    }
    if made is not None:
        settings |= {"radio.truth": "map", "radio.map_file": str(made)}
        settings["area.buildings_file"] = None
        if belief in ("buildings", WALLS_FIRST):
            settings["area.buildings"] = [one.model_dump() for one in walls(city)]
    config = aerofed.config("city", settings)
    with finished(config, f"{city}, {seed}, {belief}, {replan}") as path:
        rounds, uplinks = (pd.read_csv(path / f"{name}.csv") for name in ("rounds", "uplinks"))
    per = uplinks.groupby("round")[["plan_per", "true_per"]].mean()
    accuracy = rounds.filter(like="accuracy_").mean(axis=1)
    return pd.DataFrame(
        {
            **dict(zip(KEYS, (city, seed, belief, replan), strict=True)),
            "round": rounds["round"],
            "planned": rounds.plan_objective,
            "true": rounds.true_objective,
            "scheduled": rounds.scheduled,
            "delivered": rounds.delivered,
            "plan_per": per.plan_per.to_numpy(),
            "true_per": per.true_per.to_numpy(),
            "accuracy": accuracy,
        }
    ).round(4)


def runs(city: str, seed: int, belief: str, folder: Path, flight: str) -> str:
    """All runs of a city, a seed and a belief; those that are flown, in a folder of their own."""
    name = f"{city}-{seed}-{belief.replace(' ', '-')}.csv"
    path = (folder if flight == "none" else folder / FLOWN) / name
    if not path.exists():
        made = None if city == "district" else mapped(city, seed, folder)
        replans = REPLANS if flight != "none" and belief in COMPARED else REPLANS[:1]
        every = [rounds_of(city, seed, belief, replan, made, flight) for replan in replans]
        write_atomically(path, csv(pd.concat(every)))
    return path.name


def collected(folder: Path, all_of: Path) -> pd.DataFrame:
    """The rounds of a folder of tables, or of the table of all where there are none."""
    files = sorted(folder.glob("*.csv")) or [all_of]
    rows = pd.concat(map(pd.read_csv, files), ignore_index=True)
    return rows.sort_values([*KEYS, "round"], ignore_index=True)


def summed(rows: pd.DataFrame) -> pd.DataFrame:
    """What each run comes to: updates, objective as planned and as it was, accuracy."""
    late = rows["round"] > ROUNDS - LATE
    by = rows.groupby(KEYS)
    found = by[["planned", "true", "delivered", "scheduled"]].sum()
    found["short"] = 100.0 * (found.true / found.planned - 1.0)
    found["success"] = 1.0 - rows[late].groupby(KEYS).true_per.mean()
    found["hoped"] = 1.0 - rows[late].groupby(KEYS).plan_per.mean()
    found["accuracy"] = 100.0 * by.accuracy.last()
    return found


def tables(runs: pd.DataFrame) -> str:
    """Markdown: each city, what a belief and what deciding at the stops gains."""
    parts = []
    for city in (*CHANNELS, "all four"):
        here = runs.loc[city] if city in CHANNELS else runs.groupby(KEYS[1:]).mean()
        rows, gains = [], []
        ran = set(here.index.droplevel("seed"))
        for belief, replan in (one for one in product(BELIEFS, REPLANS) if one in ran):
            mine = here.xs((belief, replan), level=("belief", "replan"))
            rows.append([
                f"`{belief}`", f"`{replan}`", mean_of(mine.delivered, 1),
                f"{mine.planned.mean() / ROUNDS:.2f}", f"{mine.true.mean() / ROUNDS:.2f}",
                mean_of(mine.short, 1, sign="+"), f"{mine.hoped.mean():.2f}",
                mean_of(mine.success, 2), mean_of(mine.accuracy, 1),
            ])  # fmt: skip
            # At the stops against by rounds; by rounds, and with both, against the average.
            others = {("channel", "round")} | ({(belief, "round")} if replan == "stop" else set())
            for name, other in sorted(others - {(belief, replan)}):
                less = mine - here.xs((name, other), level=("belief", "replan"))
                gains.append([
                    f"`{belief}`, `{replan}` less `{name}`, `{other}`",
                    mean_of(less.delivered, 1, sign="+"),
                    f"{int((less.delivered > 0).sum())} of {len(less)}",
                    mean_of(less.success, 2, sign="+"), mean_of(less.accuracy, 1, sign="+"),
                ])  # fmt: skip
        of = f"updates of {int(here.scheduled.max())}"
        heads = ["belief", "replan", of, "objective planned", "as it was", "%",
                 "success hoped for", "success", "accuracy, %"]  # fmt: skip
        paired = ["", "updates", "seeds ahead", "success", "accuracy, points"]
        parts += [f"## {city}", markdown(heads, rows), markdown(paired, gains)]
    return "\n\n".join(parts)


def flown_table(flown: pd.DataFrame, still: pd.DataFrame) -> str:
    """Markdown: what flying changes, seed by seed."""
    rows = []
    for city, belief in product(CHANNELS, COMPARED):
        mine, other = (
            of.xs((city, belief, "round"), level=("city", "belief", "replan"))
            for of in (flown, still)
        )
        less = (mine - other).dropna()
        rows.append([
            city, f"`{belief}`", f"{other.delivered.mean():.1f}",
            mean_of(less.delivered, 1, sign="+"), mean_of(less.planned / ROUNDS, 3, sign="+"),
            mean_of(less.true / ROUNDS, 3, sign="+"), mean_of(other.short, 1, sign="+"),
            mean_of(less.short, 1, sign="+"), mean_of(less.accuracy, 1, sign="+"),
        ])  # fmt: skip
    heads = ["city", "belief", "updates, not flown", "flown less not flown: updates",
             "objective planned", "as it was", "%, not flown", "flown less not flown: %, points",
             "accuracy, points"]  # fmt: skip
    return markdown(heads, rows)


def picture(runs: pd.DataFrame) -> Chart:
    """A panel a city: what arrived, by belief and by where it is decided."""
    panels = []
    for city in CHANNELS:
        rows = []
        for (belief, replan), mine in runs.loc[city].groupby(["belief", "replan"]):
            rows.append(dots(f"{belief}, {replan}", LOOKS[belief], mine.delivered))
        rows.sort(key=lambda row: BELIEFS.index(row.label.partition(",")[0]))
        name = "district" if city == "district" else city.capitalize()
        panels.append(panel(name, rows, x="updates that arrived, of 72"))
    one_scale(panels, [runs.delivered.min() - 1.0, 73.0])
    title = heading("Updates that arrive, by what plans believe and when they are made")
    return arranged(panels, how="hconcat", spacing=24, title=title)


def write_tables(folder: Path, out: Path, figures: Path) -> None:
    """The tables of all rounds, and README.md, into `out`; the picture into `figures`."""
    still = collected(folder, folder / "rounds.csv.gz")
    flown = collected(folder / FLOWN, folder / f"{FLOWN}.csv.gz")
    seeds = sorted(flown.seed.unique().tolist())
    head = _HEAD.format(first=seeds[0], last=seeds[-1], count=len(seeds), rounds=ROUNDS, late=LATE)
    runs = summed(flown)
    save_all({"city-updates.png": picture(runs)}, figures)
    changed = f"## What flying changed\n\n{flown_table(runs, summed(still))}"
    write(out, f"{head}\n{tables(runs)}\n\n{changed}\n", rounds=still, flown=flown)


def main() -> None:
    """Do what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("what", choices=("channels", "runs", "tables"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--flown", action="store_true", help="fly them")
    parser.add_argument("--cities", nargs="+", choices=CHANNELS, default=list(CHANNELS))
    parser.add_argument("--beliefs", nargs="+", choices=BELIEFS, default=list(BELIEFS))
    parser.add_argument("--out", type=Path, default=Path("docs/data/city"))
    parser.add_argument("--figures", type=Path, default=Path("docs/images"))
    asked = parser.parse_args()
    if asked.what == "tables":
        write_tables(asked.folder, asked.out, asked.figures)
        return
    (asked.folder / FLOWN).mkdir(parents=True, exist_ok=True)
    if asked.what == "channels":
        for city in asked.cities:
            maps = [mapped(city, seed, asked.folder) for seed in FIT_SEEDS]
            print(city, *averaged(city, maps), flush=True)
        return
    for city, seed in product(asked.cities, SEEDS):  # one after the other: two would trace it twice
        if city != "district":
            mapped(city, seed, asked.folder)
    flight = FLOWN if asked.flown else "none"
    in_parallel(
        asked.jobs,
        (
            (runs, (city, seed, belief, asked.folder, flight))
            for seed, city, belief in product(SEEDS, asked.cities, asked.beliefs)
            if asked.flown or belief in COMPARED
        ),
    )


if __name__ == "__main__":
    main()
