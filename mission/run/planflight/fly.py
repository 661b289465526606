"""One `aerofed fly`: a run of one flight that serves nobody, by a plan file.

The simulated vehicle or an external autopilot flies it; it is planned against flown as a run is.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mission.analysis.compare import RunComparison, compare_run, plain
from mission.analysis.comparison_text import tables
from mission.analysis.load import load_run, reached
from mission.base import csv_text
from mission.base.console import RunConsole
from mission.base.errors import AerofedError, FlightError
from mission.base.run_folder import RunFolder, write_atomically
from mission.base.stopwatch import Stopwatch
from mission.config.models import RunConfig
from mission.flight.flyers.ports import check_link
from mission.flight.plan_file import read_plan_file
from mission.log.live.view import LiveView, live_views
from mission.log.values import Devices, FlightData, PlanFileRecord
from mission.log.write.writer import FlightLog
from mission.run.budget import RunTotals
from mission.run.planflight.carrier import PlanCarrier, area_xyz, make_carrier
from mission.run.planflight.prepare import PreparedPlan, prepare_plan
from mission.run.recorded import fly_recorded
from mission.run.summary import Summary

_COLUMNS = ("t_s", "true_x_m", "true_y_m", "true_alt_m", "est_x_m", "est_y_m", "est_alt_m")


def fly_plan(config: RunConfig, source: Path, path: Path, *, console: RunConsole) -> int:
    """Fly the plan in `source` and leave a folder at `path`. Returns the exit code.

    Raises:
        InputError: the plan is damaged or holds what may not be flown; nothing is written then.
        FlightError, LinkLostError: see `Pilot`; the folder keeps what was flown.
    """
    stopwatch = Stopwatch()
    with ExitStack() as opened:
        with stopwatch("setup"):
            ready = prepare_plan(config, read_plan_file(source))
            check_link(config.link)
            folder = opened.enter_context(RunFolder.taken(path))
            with folder.unless_refused():
                carrier = make_carrier(ready, say=console.say)
                live = opened.enter_context(live_views(console))
            write_atomically(folder.config, carrier.ready.config.to_toml())
            write_atomically(folder.path / source.name, source.read_bytes())
        summary = Summary(
            folder,
            name=source.stem,
            plan=source.name,
            seed=config.seed,
            resumable=False,
            position_source=carrier.position_source,
        )
        opening = _recording(carrier, folder, stopwatch, live)
        return fly_recorded(opening, summary, console=console, stopwatch=stopwatch)


@dataclass
class _PlanFlight:
    """The plan while it is flown, and what became of it."""

    carrier: PlanCarrier
    log: FlightLog
    stopwatch: Stopwatch
    totals: RunTotals = field(default_factory=lambda: RunTotals.before(0))
    comparison: RunComparison | None = None
    ended: bool = False  # by itself: neither failed nor interrupted

    async def run(self) -> None:
        """Fly it."""
        try:
            with self.stopwatch("fly"):
                await self.carrier.fly(self.log)
            self.ended = True
        except AerofedError as failure:
            t_s = self.carrier.t_ns / 1e9
            raise failure.in_words(f"t {t_s:.1f} s: {failure}") from failure.__cause__
        finally:
            self.totals.sim_s = self.carrier.t_ns / 1e9

    def conclude(self, summary: Summary) -> None:
        """Compare what was flown with its plan; nothing where nothing was.

        Raises:
            FlightError: the plan was flown to its end, and the last place never reached.
        """
        run = load_run(summary.folder.path)
        if not run.data.rounds:
            return
        self.totals.add(run.data.rounds[0])
        write_atomically(summary.folder.path / "track.csv", _track_csv(run.data))
        self.comparison = compare_run(run)
        numbers = plain(self.comparison.total).items()
        summary.add(planned_and_flown={key: value for key, value in numbers if value is not None})
        last = max(self.carrier.ready.path.places)
        if self.ended and last not in reached(run.data):
            raise FlightError(f"item {last} was never reached")

    def show(self, console: RunConsole) -> None:
        """The comparison."""
        for table in tables(self.comparison) if self.comparison else ():
            console.show(table)


@contextmanager
def _recording(
    carrier: PlanCarrier, folder: RunFolder, stopwatch: Stopwatch, live: tuple[LiveView, ...]
) -> Iterator[_PlanFlight]:
    """The flight with its log, and what is needed to understand that."""
    ready, nobody = carrier.ready, Devices(np.zeros((0, 2)), ())
    with FlightLog(
        folder.log, area=ready.area, devices=nobody, fence=ready.fence, mirrors=live
    ) as log:
        log.attach("config.toml", "application/toml", ready.config.to_toml().encode())
        log.attach(ready.plan.path.name, "text/plain", ready.plan.content)
        log.metadata(PlanFileRecord.KEY, _places(ready).to_text())
        yield _PlanFlight(carrier, log, stopwatch)


def _places(ready: PreparedPlan) -> PlanFileRecord:
    area, path = ready.area, ready.path
    return PlanFileRecord(
        source=ready.plan.path.name,
        places_m={seq: area_xyz(area, ned[None])[0] for seq, ned in path.places.items()},
        rally_m=tuple(area_xyz(area, ned[None])[0] for ned in path.rally_ned_m),
    )


def _track_csv(data: FlightData) -> str:
    rows = np.hstack((data.truth.pos_m, data.belief.pos_m)).tolist()
    return csv_text.lines(
        [
            _COLUMNS,
            *(
                [t_ns / 1e9, *(f"{value:.3f}" for value in row)]
                for t_ns, row in zip(data.truth.t_ns.tolist(), rows, strict=True)
            ),
        ]
    )
