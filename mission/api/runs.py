"""Runs: flown, resumed, and read back as tables and pictures."""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mission.api.configuring import Source, as_path, config, folder
from mission.base.errors import INTERRUPTED, InputError
from mission.base.interrupts import in_a_thread
from mission.base.run_folder import RunFolder, output_folder
from mission.base.tables import columns
from mission.base.user_files import read_text
from mission.config.models import RunConfig
from mission.log.records import (
    DeviceRecord,
    OfSeveral,
    RoundRecord,
    UplinkRecord,
    flat,
    is_by_community,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    import pandas as pd

    from mission.analysis.load import LoadedRun
    from mission.figures.style import Chart
    from mission.run.recorded import Around


def frame(
    record: type | None, values: Mapping[str, object] | Sequence[Mapping[str, object]]
) -> "pd.DataFrame":
    """Make a DataFrame of columns by name, or of rows.

    An empty table has the columns of `record` all the same, but those by community.
    """
    import pandas as pd  # not before a table is asked for

    frame = pd.DataFrame(values)
    if len(frame.columns) or record is None:
        return frame
    told = [c for c in columns(record) if c.find(OfSeveral) is None]
    known = {c.name: c.holds for c in told if not is_by_community(c)}
    return pd.DataFrame({name: pd.Series([], dtype=kind) for name, kind in known.items()})


@dataclass(frozen=True)
class Figure:
    """One picture. As the last value of a notebook's cell it is shown."""

    name: str
    chart: "Chart" = field(repr=False)  # Vega-Lite, as JSON has it

    def save(self, path: Path | str) -> Path:
        """Write it to a file, .png, .svg or .pdf; returns the path.

        Raises:
            InputError: another kind of file, or it cannot be written.
        """
        from mission.figures.render import save

        target = as_path(path, "path")
        save(self.chart, target)
        return target

    def _repr_png_(self) -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            return self.save(Path(folder) / "figure.png").read_bytes()


def chosen(pictures: Mapping[str, "Chart"], name: str, *, of: Path) -> Figure:
    """The picture of that name, among files `NAME.png`.

    Raises:
        InputError: there is none of that name.
    """
    picture = pictures.get(f"{name}.png")
    if picture is None:
        names = ", ".join(repr(file.removesuffix(".png")) for file in pictures) or "none"
        raise InputError(f"{of}: no figure {name!r}; there are: {names}")
    return Figure(name, picture)


@dataclass(frozen=True)
class Run:
    """A run in its folder, or a flight log by itself; of a killed one, the rounds that ended.

    Tables are read when first asked for. Positions are area coordinates in metres (x east, y
    north, height above home), times simulated seconds.
    """

    path: Path

    @cached_property
    def rounds(self) -> "pd.DataFrame":
        """One row per round, with the columns of `rounds.csv`."""
        return self.table("rounds")

    @cached_property
    def uplinks(self) -> "pd.DataFrame":
        """One row per round and scheduled device, with the columns of `uplinks.csv`."""
        return self.table("uplinks")

    @cached_property
    def aircraft(self) -> "pd.DataFrame":
        """One row per round and aircraft, with the columns of `aircraft.csv`.

        Raises:
            InputError: a log by itself, or a run of an earlier version.
        """
        from mission.log.records import AircraftRecord

        return self._beside_log("aircraft", AircraftRecord, words="aircraft", logged="rounds")

    @cached_property
    def learning(self) -> "pd.DataFrame":
        """One row per device and round, from 0 (untrained), with the columns of `learning.csv`.

        Raises:
            InputError: a log by itself; `table("learning")` has what a log knows, by community.
        """
        return self._beside_log("learning", DeviceRecord, words="devices", logged="learning")

    def _beside_log(
        self, name: str, record: "type[Any]", *, words: str, logged: str
    ) -> "pd.DataFrame":
        """A table that the log has not, of the rounds that have ended."""
        if self.path.is_file():
            raise InputError(
                f"{self.path}: a log has no table of {words}; its folder's {name}.csv has, and "
                f'table("{logged}") is what the log knows'
            )
        ended = {0, *self.rounds["round"]}
        return frame(record, [row for row in self._written(name, record) if row["round"] in ended])

    def _written(self, name: str, record: "type[Any]") -> list[dict[str, object]]:
        """The rows of a table of the folder."""
        from mission.log.tables import read_table

        here = RunFolder(self.path)
        file: Path = getattr(here, name)
        # A resumed run keeps its longer tables until it has caught up with them.
        kept = here.kept / file.name
        read = read_table(kept if kept.is_file() else file, record)
        return [flat(item, several=bool(self._vehicles)) for item in read]

    @cached_property
    def track(self) -> "pd.DataFrame":
        """One row per sample: `t_s`, `round` (0 between rounds), true and estimated position."""
        track = self.table("track")
        t_s = track["t_s"].to_numpy()
        track.insert(1, "round", 0)
        for record in self._loaded.data.rounds:
            inside = (t_s >= record.start_t_s) & (t_s <= record.start_t_s + record.duration_s)
            track.loc[inside, "round"] = record.round
        return track

    def table(self, name: str) -> "pd.DataFrame":
        """Any table of the log, as `aerofed log export` writes it: "plans", "events", "wind" ...

        Raises:
            InputError: there is no such table, as but for "rounds" and "uplinks" a run of several
                aircraft has none; or the log cannot be read.
        """
        from mission.log.export import tables

        record = {"rounds": RoundRecord, "uplinks": UplinkRecord}.get(name)
        if self._vehicles:
            if record is not None:
                return frame(record, self._written(name, record))
            raise InputError(
                f"{self.path}: table {name!r} is in the log of each aircraft; give aerofed.load "
                f"one of them, as {self._vehicles[0]}"
            )
        known = tables(self._loaded.data)
        if name not in known:
            raise InputError(f"{self.path}: no table {name!r}; there are: {', '.join(known)}")
        return frame(record, known[name])

    @property
    def status(self) -> str:
        """Status: "finished", "interrupted", "failed" or "running" (also if it was killed)."""
        return str(self.summary.get("status", "finished"))

    @property
    def summary(self) -> Mapping[str, Any]:
        """What `summary.json` says; empty for a log by itself."""
        from mission.analysis.load import summary_in

        return summary_in(self.path) if self._vehicles else self._loaded.summary

    @cached_property
    def config(self) -> "RunConfig":
        """The configuration of the run, as the log has it.

        Raises:
            InputError: the log's copy is missing, or of another version.
        """
        import tomllib

        try:
            if self._vehicles:
                values = tomllib.loads(read_text(RunFolder(self.path).config))
            else:
                values = tomllib.loads(self._loaded.data.attachments["config.toml"].decode())
            return RunConfig.model_validate_json(json.dumps(values), strict=True)
        except (KeyError, ValueError) as error:
            raise InputError(f"{self.path}: its configuration cannot be read: {error}") from None

    def figure(self, name: str = "map") -> Figure:
        """A picture of the run: "map", "rounds" or "learning"; of several aircraft "map", "apart",
        "timetable" or "learning".

        Raises:
            InputError: there is none of that name, or nothing to draw in it.
        """
        from mission.figures.run import fleet_pictures, run_pictures

        several = bool(self._vehicles)
        pictures = fleet_pictures(self.path) if several else run_pictures(self._loaded)
        return chosen(pictures, name, of=self.path)

    def report(self, target: Path | str | None = None) -> Path:
        """Write its page, as `aerofed report` does, and say where: one HTML file.

        Args:
            target: the file; default: `report.html` in the folder, or beside the log.

        Raises:
            InputError: no round was finished, or the file cannot be written.
        """
        from mission.report.page import write_report

        return write_report(self.path, None if target is None else as_path(target, "target"))

    @cached_property
    def _vehicles(self) -> list[Path]:
        """The folders of several aircraft, each with a log; [] where the run has one log."""
        from mission.analysis.load import vehicles_of

        return vehicles_of(self.path) if RunFolder(self.path).rounds.is_file() else []

    @cached_property
    def _loaded(self) -> "LoadedRun":
        from mission.analysis.load import load_run

        return load_run(self.path)


def run(
    source: Source = "quickstart",
    overrides: Mapping[str, object] | None = None,
    *,
    strategy: "str | Callable[..., object] | None" = None,
    out: Path | str | None = None,
    data_dir: Path | str | None = None,
    quiet: bool = True,
) -> Run:
    """Fly a run, as `aerofed run` does: the same configuration and seed give the same bytes.

    It returns when the run is over, also where an event loop is running (in a notebook): the run
    has a thread with a loop of its own then.

    Args:
        source: "quickstart", "paper", "paper-sweep", "apart", "town", "city", "munich"; a TOML
            file; a configuration.
        overrides: values by dotted key: {"mission.rounds": 3, "mission.strategy": "no_cov"}.
        strategy: sets mission.strategy; here, and wherever code of your own is named, the function
            or class itself may stand for its name.
        out: new or empty folder for the results; default: a new one under runs/.
        data_dir: folder with the data sets' files, where tasks need files.
        quiet: show nothing; False shows what `aerofed run` shows.

    Raises:
        LimitsNotMetError: it is flown, and does not meet a limit of the table [limits].
        AerofedError: what else `aerofed run` would end with. What was flown stays in `out`.
        KeyboardInterrupt: it was interrupted; `resume(out)` goes on.
    """
    if strategy is not None and isinstance(overrides, Mapping | None):
        overrides = {**(overrides or {}), "mission.strategy": strategy}
    resolved = config(source, overrides)
    if resolved.limits:
        from mission.analysis.limits import check_flown

        check_flown(resolved.mission.strategy)
    data = folder(data_dir)
    given = None if out is None else as_path(out, "out")
    from mission.run.session import fly_session

    with output_folder(given, resolved.run_name) as path:
        return flown(
            lambda around: fly_session(resolved, path, around, data_dir=data), path,
            resolved.limits, quiet=quiet,
        )  # fmt: skip


def resume(path: Path | str, *, rounds: int | None = None, quiet: bool = True) -> Run:
    """Go on with a run that was interrupted or killed; it ends as if it never had been.

    With `rounds` it has so many, as if it had been begun with them, also where it was finished.

    Raises:
        LimitsNotMetError: it has ended, and does not meet a limit of its table [limits].
        AerofedError: not a run, or one that cannot go on here; or what ends it this time.
        KeyboardInterrupt: it was interrupted again.
    """
    from mission.analysis.limits import limits_in
    from mission.run.session import resume_session

    folder = as_path(path, "path")
    kept = RunFolder(folder).config
    limits = limits_in(kept) if kept.is_file() else None

    return flown(
        lambda around: resume_session(folder, around, rounds=rounds), folder, limits, quiet=quiet
    )


def load(path: Path | str) -> Run:
    """Read a run that was flown: its folder, or its log (`flight.mcap`) by itself.

    Raises:
        InputError: neither.
    """
    run = Run(as_path(path, "path"))
    _ = run._vehicles or run._loaded
    return run


def flown(
    fly: "Callable[[Around], int]",
    path: Path,
    limits: Mapping[str, float] | None,
    *,
    quiet: bool,
    goes_on: bool = True,
    figures: bool = True,
) -> Run:
    """Call `fly`, which returns an exit code; return the run at `path` if it keeps to `limits`.
    `goes_on`: whether an interrupted one can be resumed."""
    from rich.console import Console

    if limits:  # of which each must be known before anything is flown
        from mission.analysis.limits import known_limits

        known_limits(limits, "limits")
    from mission.base.console import RunConsole
    from mission.run.recorded import Around

    around = Around(RunConsole(Console(quiet=quiet)), figures=figures)
    code = in_a_thread(lambda: fly(around)) if _loop_is_running() else fly(around)
    if code == INTERRUPTED:
        more = f"; resume({str(path)!r}) goes on" if goes_on else ""
        raise KeyboardInterrupt(f"{path} was interrupted{more}")
    if limits:
        from mission.analysis.limits import kept
        from mission.analysis.several import load_several

        kept(load_several((path,)), limits)
    return Run(path)


def _loop_is_running() -> bool:
    import asyncio

    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True
