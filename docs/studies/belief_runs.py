"""Whether what the learned radio belief promises is met: runs, and a table of them.

    python docs/studies/belief_runs.py FOLDER          # runs and maps are kept in FOLDER
    python docs/studies/belief_runs.py FOLDER --plain  # one field of 6 dB, floor values as measured
    python docs/studies/belief_runs.py FOLDER --seeds 301 302 --cities district

Runs are those of `city_runs.py`, unflown, with one local epoch. As each round but the first
begins, the SNR of all devices at 400 places is set beside the 90 % intervals of what is believed
then. A value under the receiver's floor counts as within where the interval reaches down to it; to
the dB it is compared as it is, unless no ray of a map arrives. What plans promise is that of the
rounds after the first, which are planned with what was heard.
"""

import argparse
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import patch

import city_runs
import numpy as np
import pandas as pd
from study import csv, finished, markdown, mean_of

import aerofed
from fl.radio import learned
from fl.radio.learned import PILOT_GAIN_DB, Heard, Learned, Listener
from fl.radio.place import PlacedRadio
from mission.base.run_folder import write_atomically
from mission.config.models import RunConfig
from mission.scenario.scenario import build_scenario

SEEDS = range(301, 317)  # no constant was chosen on them
PLACES = 400
LEAST_DB = -60.0  # no ray arrives where a map has less
Z = 1.6449  # 90 % of a normal distribution lie within
CITIES = city_runs.CHANNELS
PLAIN: dict[str, Any] = {
    "FIELDS": {"channel": ((6.0, 40.0),)}, "NUGGET_DB": 0.0,
    "_uncensored": lambda off_db, *_: off_db,
}  # fmt: skip


def config_of(city: str, seed: int, folder: Path) -> RunConfig:
    """A run of a city, whose map is traced where there is none yet."""
    settings: dict[str, object] = {
        "seed": seed,
        "radio.belief": "learned",
        "mission.rounds": city_runs.ROUNDS,
        "mission.flight": "none",
        "planner.gap": city_runs.GAP,
        "learning.local_epochs": 1,
        **{f"channel.{name}": value for name, value in CITIES[city].items()},
    }
    if city != "district":
        made = str(city_runs.mapped(city, seed, folder))
        settings |= {"radio.truth": "map", "radio.map_file": made, "area.buildings_file": None}
    return aerofed.config("city", settings)


def run_of(config: RunConfig) -> pd.Series:
    """What a run comes to: means over its rounds, shares of intervals that cover."""
    scenario = build_scenario(config, data_dir=None)
    truth, count = scenario.radio, len(scenario.devices_m)
    assert isinstance(truth, PlacedRadio)
    assert scenario.listener is not None
    belief = scenario.listener.belief
    assert isinstance(belief, Learned)
    at_m = np.random.default_rng(config.seed).uniform(0.0, config.area.size_m, (PLACES, 2))
    place_m = np.column_stack((at_m, np.full(PLACES, config.mission.heights_m[0])))
    device = np.repeat(np.arange(count), PLACES)
    snr_db = truth.snr_db(device, np.tile(place_m, (count, 1))).reshape(count, PLACES)
    floor_db = config.radio.snr_threshold_db - PILOT_GAIN_DB
    over, told, within, strict = snr_db > floor_db, snr_db > LEAST_DB, [], []
    grid: Callable[..., object] = Listener.grid

    def noted(listener: Listener, heard: Heard) -> object:
        if len(heard.device):
            mean_db, deviation_db = belief.snr_db(heard, place_m)
            low, high = mean_db - Z * deviation_db, mean_db + Z * deviation_db
            strict.append((low <= snr_db) & (snr_db <= high))
            within.append(np.where(over, strict[-1], low <= floor_db))
        return grid(listener, heard)

    with patch.object(Listener, "grid", noted), finished(config, "run") as path:
        rounds, uplinks = (pd.read_csv(path / f"{name}.csv") for name in ("rounds", "uplinks"))
    known = uplinks[uplinks["round"] > 1]  # of the first round, the prior promises
    return pd.Series(
        {
            "over": np.mean([covers[over].mean() for covers in within]),
            "all": np.mean(within),
            "strict": np.mean([covers[told].mean() for covers in strict]),
            "promised": 1.0 - known.plan_per.mean(),
            "met": 1.0 - known.true_per.mean(),
            "planned": rounds.plan_objective[1:].mean(),
            "true": rounds.true_objective[1:].mean(),
            "planned_1": rounds.plan_objective[0],
            "true_1": rounds.true_objective[0],
            "updates": rounds.delivered.mean(),
        }
    )


def table(runs: pd.DataFrame) -> str:
    """Markdown: a line a city, and of all, where each seed counts with the mean of its cities."""
    rows = []
    for city in [*runs.city.unique(), "all"]:
        mine = runs[runs.city == city] if city != "all" else runs
        seeds = mine.groupby("seed").mean(numeric_only=True)
        mean = seeds.mean()
        learned = city_runs.ROUNDS - 1  # rounds; the first is the prior's
        every = (learned * mean.true + mean.true_1) / (learned * mean.planned + mean.planned_1)
        rows.append([
            city, *(f"{100.0 * mean[name]:.0f} %" for name in ("over", "all", "strict")),
            *(f"{mean[name]:.3f}" for name in ("promised", "met", "planned", "true")),
            *(f"{100.0 * (share - 1.0):+.1f} %" for share in (mean.true / mean.planned, every)),
            mean_of(seeds.updates, 2),
        ])  # fmt: skip
    heads = ["city", "intervals cover: over the floor", "everywhere", "under it to the dB",
             "success promised", "met", "objective promised", "met", "%", "% of all rounds",
             "updates a round"]  # fmt: skip
    return markdown(heads, rows)


def main() -> None:
    """Do what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--plain", action="store_true", help="one field, floor values as measured")
    parser.add_argument("--cities", nargs="+", choices=CITIES, default=list(CITIES))
    parser.add_argument("--seeds", nargs="+", type=int, default=list(SEEDS))
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    kind, rows = "plain" if asked.plain else "learned", []
    with patch.multiple(learned, **PLAIN) if asked.plain else nullcontext():
        for seed in asked.seeds:
            for city in asked.cities:
                path = asked.folder / f"{kind}-{city}-{seed}.csv"
                if not path.exists():
                    found = run_of(config_of(city, seed, asked.folder)).to_frame().T
                    write_atomically(path, csv(found))
                    print(path.name, found.round(3).to_dict("records")[0], flush=True)
                rows.append(pd.read_csv(path).assign(city=city, seed=seed))
    print(table(pd.concat(rows, ignore_index=True)))


if __name__ == "__main__":
    main()
