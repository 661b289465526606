"""The ranking of the strategies without flying: many seeds and settings in the time of a few runs.

Every round is planned, drawn and learnt as `aerofed sweep` does, with the same random streams, but
the aircraft is taken to be where the plan wants it. What that leaves out is the difference between
the PER at the planned and at the true position, which a flown sweep's tables show.

    python benchmarks/ranking.py configs/paper-sweep.toml --data-dir DATA --seeds 8 \
        --strategies cov,no_cov --set channel.preset=suburban,suburban+10dB --out ranking.jsonl

A run that is in the file already is not repeated: the same command goes on where it was ended, by
whatever, and drops a last line that was cut.
"""

import argparse
import hashlib
import json
import math
import os
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from joblib.externals.loky import ProcessPoolExecutor
from numpy.typing import NDArray

from fl.federation import rounds as learning
from fl.radio.uplink import deliver
from mission.base.user_code import is_import_path
from mission.planner.problem import RoundProblem
from mission.run.budget import RunTotals
from mission.scenario.scenario import Scenario, build_scenario
from mission.scenario.strategies import Strategy
from mission.sweep.execute.worker import ENVIRONMENT
from mission.sweep.grid import SweepRun, make_grid, parse_axis
from mission.sweep.outcome.reproduction import reproduction
from mission.sweep.results import FINAL_ROUNDS, Row, RunResult
from mission.sweep.state import SweepState

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Outing:
    """One round without the flight."""

    scheduled: Bools  # (K,)
    delivered: Bools  # (K,)
    per: Floats  # of the scheduled ones
    end_m: Floats  # (2,)
    path_m: float
    cost_m: float  # of the path budget


def go_out(
    scenario: Scenario,
    strategy: Strategy,
    state: learning.FederationState,
    totals: RunTotals,
    *,
    start_m: Floats,
) -> Outing:
    """Plan a round, and draw who gets through from where the plan wants the aircraft."""
    mission = scenario.config.mission
    problem = RoundProblem(
        devices_m=scenario.devices_m,
        importance=learning.importance(scenario.federation, state, fairness=strategy.fairness),
        start_m=start_m,
        steps=mission.steps,
        per_step=mission.devices_per_step,
        path_budget_m=min(mission.path_budget_m, totals.left_m(mission)),
        channel=scenario.channel,
    )
    sortie = strategy.sortie(totals.rounds_done, problem)
    plan = sortie.plan
    scheduled: Bools = np.asarray(plan.schedule.any(axis=0))
    where = plan.waypoints_m[plan.schedule.argmax(axis=0)]
    away = np.linalg.norm(where - scenario.devices_m, axis=1)
    arrivals = deliver(
        scenario.channel,
        away,
        height_m=np.full(len(away), mission.altitude_m),
        transmitted=scheduled,
        rng=scenario.streams.generator(f"uplink/{totals.next_round}"),
        gate=scenario.config.channel.gate,
    )
    cost = min(plan.path_m, problem.path_budget_m) if sortie.cost_m is None else sortie.cost_m
    return Outing(
        scheduled,
        arrivals.delivered,
        arrivals.per[scheduled],
        plan.waypoints_m[-1],
        plan.path_m,
        cost,
    )


def play(run: SweepRun, data_dir: Path | None) -> dict[str, Any]:
    """All rounds of one run: its row of `runs.csv`, and accuracy and CoV by round."""
    scenario = build_scenario(run.config, data_dir=data_dir)
    mission, federation, strategy = run.config.mission, scenario.federation, scenario.strategy
    totals = RunTotals.before(len(scenario.devices_m))
    everyone = np.ones(len(scenario.devices_m), dtype=np.bool_)
    state, learnt = learning.init(federation), []
    start_m = np.array(scenario.area.home_m, dtype=np.float64)
    if strategy is not None and strategy.approach_m is not None:
        start_m = strategy.approach_m
    outings: list[Outing] = []
    while not totals.is_over(mission):
        outing = (
            Outing(everyone, everyone, np.zeros(0), start_m, 0.0, mission.path_budget_m)
            if strategy is None
            else go_out(scenario, strategy, state, totals, start_m=start_m)
        )
        state, lesson = learning.play_round(
            federation, state, scheduled=outing.scheduled, delivered=outing.delivered
        )
        outings.append(outing)
        learnt.append({"accuracy": lesson.accuracy, "cov": lesson.cov})
        start_m = outing.end_m
        totals.rounds_done += 1
        totals.budget_used_m += outing.cost_m
    arrived = np.sum([outing.delivered for outing in outings], axis=0)
    per = np.concatenate([outing.per for outing in outings])
    summary: Row = {
        "rounds": len(outings),
        "flown_m": math.fsum(outing.path_m for outing in outings),
        "delivered_share": float(arrived.sum() / sum(o.scheduled.sum() for o in outings)),
        "plan_per": float(per.mean()) if per.size else math.nan,
        "true_per": math.nan,
    }
    last = learnt[-FINAL_ROUNDS:]
    for index, name in enumerate(federation.names):
        for what in ("accuracy", "cov"):
            summary[f"final_{what}_{name}"] = float(np.mean([item[what][name] for item in last]))
        mine = arrived[federation.members(index)]
        summary[f"participation_{name}"] = float(mine.mean()) / len(outings)
    return {**identity(run), "summary": summary, "rounds": learnt}


def identity(run: SweepRun) -> dict[str, str]:
    """What a line of the file is known by: a run of this name with other settings is another."""
    settings = hashlib.sha256(run.config.to_toml().encode()).hexdigest()[:16]
    return {"run": run.name, "settings": settings}


def read_whole(file: Path) -> list[dict[str, Any]]:
    """The entries of a results file, from which a last line that was cut is dropped."""
    text = file.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if whole != text:
        with file.open("r+b") as cut:
            cut.truncate(len(whole))
    return [json.loads(line) for line in whole.splitlines()]


def main() -> None:
    """Play what is not in the file yet, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--data-dir", type=Path)
    parser.add_argument("--strategies", default="cov,no_cov,barycenter,rectangular,ideal")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--set", nargs="*", default=[], dest="axes")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    grid = make_grid(
        options.config,
        strategies=options.strategies.split(","),
        seeds=options.seeds,
        axes=[parse_axis(text) for text in options.axes],
    )
    if any(map(is_import_path, grid.strategies)):
        parser.error("strategies of one's own are flown by aerofed sweep")
    entries = read_whole(options.out) if options.out.exists() else []
    wanted = [identity(run) for run in grid.runs]
    done = {
        entry["run"]: entry
        for entry in entries
        if {"run": entry["run"], "settings": entry.get("settings")} in wanted
    }
    todo = [run for run in grid.runs if run.name not in done]
    with ProcessPoolExecutor(options.jobs, env=ENVIRONMENT) as pool, options.out.open("a") as out:
        for future in as_completed(pool.submit(play, run, options.data_dir) for run in todo):
            entry = future.result()
            done[entry["run"]] = entry
            out.write(json.dumps(entry) + "\n")
            out.flush()
    results = [
        RunResult(run, done[run.name]["summary"], tuple(done[run.name]["rounds"]), {})
        for run in grid.runs
    ]
    print(reproduction(SweepState({"name": grid.base.name}, tuple(results), ())))


if __name__ == "__main__":
    main()
