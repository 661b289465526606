"""`summary.json` of a run: what it is, how it ended, what it added up to."""

from mission.base.run_folder import RunFolder, environment
from mission.base.stopwatch import Stopwatch
from mission.run.budget import RunTotals
from mission.run.outcome import Outcome


class Summary:
    """Written whole each time; "finished" last of all, so that such a folder has everything."""

    def __init__(self, folder: RunFolder, **about: object) -> None:
        """`about`: what the run is."""
        self.folder = folder
        self._about = {**about, **environment()}

    def add(self, **about: object) -> None:
        """Say more of the run the next time."""
        self._about |= about

    def started(self) -> None:
        """Nothing has happened yet."""
        self.folder.write_summary({"status": "running", **self._about})

    def ended(self, outcome: Outcome, totals: RunTotals, stopwatch: Stopwatch) -> None:
        """How, and how far it came."""
        self.folder.write_summary({**outcome.summary, **self._about, **_totals(totals, stopwatch)})


def _totals(totals: RunTotals, stopwatch: Stopwatch) -> dict[str, object]:
    flight_s = stopwatch.wall_s.get("fly", 0.0)
    return {
        "rounds": totals.rounds_done,
        "flown_in_rounds_m": totals.flown_m,
        "budget_used_m": totals.used.metres,
        **totals.limited,
        "simulated_s": totals.sim_s,
        "real_time_factor": totals.sim_s / flight_s if flight_s > 0.0 else 0.0,
        "battery_changes": totals.battery_changes,
        "delivered": totals.delivered,
        "scheduled": totals.scheduled,
        "accuracy": totals.accuracy,
        "untrained_accuracy": totals.untrained,
        "wall_s": {**stopwatch.wall_s, "total": stopwatch.total_s},
    }
