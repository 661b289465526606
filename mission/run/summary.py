"""`summary.json` of a run: what it is, how it ended, what it added up to."""

from typing import Any

from mission.base.run_folder import RunFolder, environment
from mission.base.stopwatch import Stopwatch
from mission.run.budget import Tally
from mission.run.outcome import Ending
from mission.run.setup import World


class Summary:
    """Written whole each time; "finished" last of all, so that such a folder has everything."""

    def __init__(self, folder: RunFolder, world: World, *, remembered: int) -> None:
        config = world.config
        self._folder = folder
        self._about = {
            "name": config.name,
            "strategy": config.mission.strategy,
            "seed": config.seed,
            "resumed_after_round": remembered or None,
            "position_source": world.flyers.position_source,
            "data": world.data_sources(),
            **environment(),
        }

    def started(self) -> None:
        """Nothing has happened yet."""
        self._folder.write_summary({"status": "running", **self._about})

    def ended(self, ending: Ending, tally: Tally, stopwatch: Stopwatch) -> None:
        """How, and how far it came."""
        self._folder.write_summary({**ending.summary, **self._about, **_totals(tally, stopwatch)})


def _totals(tally: Tally, stopwatch: Stopwatch) -> dict[str, Any]:
    flight_s = stopwatch.wall_s.get("fly", 0.0)
    return {
        "rounds": tally.rounds_done,
        "flown_in_rounds_m": tally.flown_m,
        "budget_used_m": tally.budget_used_m,
        "simulated_s": tally.sim_s,
        "real_time_factor": tally.sim_s / flight_s if flight_s > 0.0 else 0.0,
        "battery_changes": tally.battery_changes,
        "delivered": tally.delivered,
        "scheduled": tally.scheduled,
        "accuracy": tally.accuracy,
        "wall_s": {**stopwatch.wall_s, "total": stopwatch.total_s},
    }
