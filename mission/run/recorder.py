"""Recording of a run as it goes on: log, tables, plans, checkpoint, progress, callbacks."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial

from fl.federation.rounds import RoundLearning
from fl.federation.state import FederationState
from mission.base.console import RunConsole, Stopwatch
from mission.base.run_folder import RunFolder, library_versions
from mission.flight.flyers.base import Attached, Backend
from mission.flight.missions.plan_file import write_round_plan
from mission.log.live import LiveView
from mission.log.records import (
    AircraftRecord,
    DeviceRecord,
    RoundRecord,
    TimedUplinkRecord,
    UplinkRecord,
)
from mission.log.tables import Table
from mission.log.values import Devices
from mission.log.writer import FlightLog
from mission.run.apart import PairApart, told
from mission.run.callbacks import Callbacks, RoundReport
from mission.run.checkpoint import CheckpointFolder, RoundMemory
from mission.run.outing import Outing, alone
from mission.run.progress import Progress, make_progress
from mission.scenario.radios import radio_grid
from mission.scenario.scenario import Scenario


@dataclass(frozen=True)
class Ready:
    """A run set up: scenario, backend, folder, checkpoint, callbacks."""

    scenario: Scenario
    backend: Backend
    folder: RunFolder
    checkpoint: CheckpointFolder
    state: FederationState
    callbacks: Callbacks
    memory: Sequence[RoundMemory] = ()  # rounds to fly again
    live: tuple[LiveView, ...] = ()


@dataclass
class FolderRecorder:
    """Passes a run's events to log, tables, checkpoint, progress, callbacks; alters no result."""

    run: Ready
    logs: tuple[FlightLog, ...]  # one of each aircraft
    rounds: Table[RoundRecord]
    aircraft: Table[AircraftRecord]
    uplinks: Table[UplinkRecord]
    devices: Table[DeviceRecord]
    progress: Progress
    stopwatch: Stopwatch
    # Up to the end of the last round: simulated seconds, and wall seconds spent on flying them.
    _flown_s: float = field(default=0.0, init=False)
    _wall_s: float = field(default=0.0, init=False)

    def attached(self) -> list[Attached]:
        """Log, folder and messages of each aircraft."""
        if len(self.logs) == 1:
            return [Attached(self.logs, self.run.folder.path, self.notice)]
        return [
            Attached((log,), self.run.folder.of_vehicle(name).path, partial(self.notice, of=name))
            for name, log in zip(self.run.scenario.aircraft, self.logs, strict=True)
        ]

    def planned(self, t_ns: int, round_number: int, one: Outing) -> None:
        """Log a plan of an aircraft before it is flown, and write it as a plan file."""
        ordered, foreseen = one.ordered, one.foreseen
        self.logs[one.number].plan(
            t_ns,
            round_number,
            one.course.problem,
            one.course.plan,
            speed_mps=ordered.speed_mps,
            slot_s=ordered.slot_s(foreseen),
            duration_s=foreseen.duration_s,
        )
        of = f"-{one.aircraft.name}" if len(self.logs) > 1 else ""
        path = self.run.folder.plans / f"round-{round_number:03d}{of}.plan"
        write_round_plan(path, ordered, one.aircraft.area)

    def finished(
        self,
        report: RoundReport,
        memory: RoundMemory,
        state: FederationState,
        outings: Sequence[Outing] = (),
        pairs: Sequence[PairApart] = (),
    ) -> None:
        """Log, tabulate, checkpoint and report a finished round; it survives a kill from then on.

        `state` is that of learning after the round, `outings` what each aircraft did in it.
        """
        record = report.round
        if record.scheduled == 0:
            self.progress.notice(
                f"round {record.round}: no device is within reach of the path, and ready in time; "
                "area.home_m, mission.path_budget_m, the channel, what is believed of the "
                "radio and compute times decide who is"
            )
        of_each = {one.number: (one.served, alone(one, record)) for one in outings}
        if len(self.logs) == 1:
            of_each = {0: (list(report.uplinks), record)}
        for number, (served, _) in of_each.items():
            self.logs[number].uplinks(served)
        self.learnt(record.round, report.learning)
        for number, (_, own) in of_each.items():
            self.logs[number].round(own)
        self.uplinks.extend(report.uplinks)
        self.aircraft.extend(report.aircraft)
        self.rounds.extend([record])
        if not report.again:
            # Log and tables hold all that the old ones held.
            self.run.folder.discard_kept()
            self.run.checkpoint.save(self.run.scenario.federation, state, memory)
        self.progress.round_done(record, real_time_factor=self._speed(record))
        for line in told(outings, pairs, self.run.scenario.config.mission.separation_m):
            self.progress.notice(line)
        self.run.callbacks.round_finished(report)

    def learnt(self, round_number: int, learnt: RoundLearning) -> None:
        """Log and tabulate what the models know after a round; 0 is before the first."""
        for log in self.logs:
            log.learning(round_number, accuracy=learnt.accuracy, cov=learnt.cov, loss=learnt.loss)
        self.devices.extend(self._devices(round_number, learnt))

    def notice(self, text: str, of: str = "") -> None:
        """Log and show a line, with the name of the aircraft that it is of."""
        text = f"{of}: {text}" if of else text
        for log in self.logs:
            log.note(text, severity=4)
        self.progress.notice(text)

    def _speed(self, record: RoundRecord) -> float:
        """Real-time factor of the flight between the ends of the previous round and this one."""
        flown_s = record.start_t_s + record.duration_s
        wall_s = self.stopwatch.wall_s.get("fly", 0.0)
        sim, wall = flown_s - self._flown_s, wall_s - self._wall_s
        self._flown_s, self._wall_s = flown_s, wall_s
        return sim / wall if wall > 0.0 else 0.0

    def _devices(self, round_number: int, learnt: RoundLearning) -> Iterator[DeviceRecord]:
        each = zip(
            self.run.scenario.community_of,
            learnt.device_accuracy.tolist(),
            learnt.received_accuracy.tolist(),
            learnt.device_loss.tolist(),
            strict=True,
        )
        for device, values in enumerate(each):
            yield DeviceRecord(round_number, device, *values)


@contextmanager
def recording(run: Ready, console: RunConsole, stopwatch: Stopwatch) -> Iterator[FolderRecorder]:
    """Context manager: open log and tables; they are closed whole however the block ends."""
    scenario, folder = run.scenario, run.folder
    devices = Devices(scenario.devices_m, scenario.community_of)
    with ExitStack() as stack:
        mission = scenario.config.mission
        progress = make_progress(console.out, rounds=mission.rounds, flown=mission.flight != "none")
        stack.callback(progress.close)
        several = len(scenario.fleet) > 1 and scenario.strategy is not None
        for one in scenario.fleet if several else ():
            folder.of_vehicle(one.name).path.mkdir(exist_ok=True)
        logs = tuple(
            stack.enter_context(
                FlightLog(
                    (folder.of_vehicle(one.name) if several else folder).log,
                    area=one.area,
                    devices=devices,
                    fence=backend.fence(),
                    mirrors=[view.of(one.name) for view in run.live] if several else run.live,
                )
            )
            for one, backend in zip(
                scenario.fleet[: None if several else 1], run.backend.each, strict=False
            )
        )
        names = scenario.federation.names
        rounds = stack.enter_context(Table(folder.rounds, RoundRecord, communities=names))
        uplink = TimedUplinkRecord if scenario.device_times else UplinkRecord
        uplinks = stack.enter_context(Table(folder.uplinks, uplink, several=several))
        aircraft = stack.enter_context(Table(folder.aircraft, AircraftRecord, several=several))
        learnt = stack.enter_context(Table(folder.learning, DeviceRecord))
        for log in logs:  # what is needed to understand it goes with it
            log.attach("config.toml", "application/toml", scenario.config.to_toml().encode())
            log.attach("devices.csv", "text/csv", scenario.devices_csv().encode())
            log.metadata("libraries", library_versions())
            if scenario.config.radio.belief not in ("channel", "truth"):
                count = len(scenario.devices_m)
                log.radio_true(radio_grid(scenario.radio, scenario.channel, scenario.area, count))
        tables = rounds, aircraft, uplinks, learnt
        recorder = FolderRecorder(run, logs, *tables, progress, stopwatch)
        for notice in scenario.notices():
            recorder.notice(notice)
        yield recorder
