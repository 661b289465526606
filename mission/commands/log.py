"""`aerofed log`: look into flight logs, verify, save, export and compare them."""

from dataclasses import asdict
from pathlib import Path
from typing import Literal

from rich import box
from rich.console import Console
from rich.table import Table

from mission.base.console import PLAIN, Terminal
from mission.base.errors import DIFFERENT, InputError
from mission.base.run_folder import RunFolder
from mission.commands.options import Json, print_json, tell
from mission.log import DamagedLogError

Form = Literal["csv", "parquet", "kml", "geojson", "mcap", "ulog", "attachments"]


def recover(log: Path, out: Path | None = None, *, as_json: Json = False) -> int:
    """Save everything sound of a log that was cut short or damaged, as a complete log.

    Example: aerofed log recover killed/flight.mcap

    Args:
        log: The log, or its run's folder; it stays as it is.
        out: The new log. Default: beside the old one, named *.recovered.mcap.
        as_json: Print what was saved and what was lost as JSON.
    """
    from mission.log.contents import recover as save

    log = _file(log)
    saved = save(log, out or log.with_name(f"{log.stem}.recovered{log.suffix}"))
    lines = [
        f"{saved.target}: {saved.messages} messages, {saved.attachments} attachments, "
        f"{saved.seconds:.1f} s of simulated time"
    ]
    for loss in saved.losses:
        where = f"bytes {loss.start} to {loss.end}" if loss.end > loss.start else "nothing"
        lines.append(f"lost: {where}: {loss.reason}")
    tell(saved, lines, as_json=as_json)
    return 0


def info(log: Path, *, as_json: Json = False) -> int:
    """Say what is in a log: topics, schemas, rates, attachments, metadata.

    Example: aerofed log info paper6/flight.mcap

    Args:
        log: A complete, sound log, or its run's folder; anything else is refused.
        as_json: Print it as JSON.
    """
    from mission.log.inspection import info as look

    log = _file(log)
    known = look(log)
    if as_json:
        topics = [{**asdict(topic), "rate_hz": topic.rate_hz} for topic in known.topics]
        print_json({**asdict(known), "messages": known.messages, "topics": topics})
        return 0
    console = Terminal.for_tables(**PLAIN)
    console.print(
        f"{log}: {known.size_bytes / 1e6:.2f} MB, {known.messages} messages, "
        f"{known.end_s - known.start_s:.1f} s of simulated time, "
        f"{known.megabytes_per_hour:.1f} MB an hour"
    )
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("topic", no_wrap=True)
    table.add_column("schema", no_wrap=True)
    table.add_column("messages", justify="right")
    table.add_column("Hz", justify="right")
    for topic in known.topics:
        table.add_row(topic.name, topic.schema, str(topic.messages), f"{topic.rate_hz:.2f}")
    console.print(table)
    for name, size in known.attachments.items():
        console.print(f"attachment {name}: {size} bytes")
    for name, values in known.metadata.items():
        console.print(f"metadata {name}: " + ", ".join(f"{k} = {v}" for k, v in values.items()))
    return 0


def check(log: Path, *, as_json: Json = False) -> int:
    """Verify every checksum of a log, and the numbering of its messages.

    Example: aerofed log check paper6/flight.mcap

    Args:
        log: The log, or its run's folder. Exit code 0: sound; 2: damaged or not a log; 7: sound
            bytes, but gaps.
        as_json: Print the findings as JSON.
    """
    from mission.log.inspection import check as verify

    log = _file(log)
    try:
        findings = verify(log)
    except DamagedLogError as error:
        if as_json:
            print_json({"log": log, "sound": False, "findings": [str(error)]})
        raise
    value = {"log": log, "sound": not findings, "findings": findings}
    tell(value, [f"{log}: {finding}" for finding in findings or ("sound",)], as_json=as_json)
    return DIFFERENT if findings else 0


def export(log: Path, out: Path | None = None, *, to: Form, as_json: Json = False) -> int:
    """Write a log's contents as tables, or its paths for a map.

    Example: aerofed log export paper6/flight.mcap --to csv

    Args:
        log: The log, or its run's folder; for kml, geojson and mcap also a folder of flights of one
            world, or of one time and place.
        out: The new folder, or file for kml, geojson, mcap and ulog. Default: beside the log; of
            flights together, together.kml, .geojson or .mcap in their folder.
        to: csv or parquet: one table each of track, plans, devices, rounds, uplinks, learning,
            events, battery, wind, control and innovations; kml: devices, planned and flown paths;
            geojson: planned and flown paths in latitude and longitude, also of a .ulg, .bin or
            .tlog; mcap: flights together, with where they came nearest, for Foxglove; ulog: the
            flight as PX4 logs one, for Flight Review and PlotJuggler; attachments: the files inside
            the log (configuration, a Foxglove layout).
        as_json: Print the new files' paths as a JSON list.
    """
    written = _write(log, out, to)
    tell(written, written, as_json=as_json)
    return 0


def _write(log: Path, out: Path | None, to: Form) -> tuple[Path, ...]:
    """Write the export in one form; imports only what that form needs."""
    if to in ("kml", "geojson", "mcap") and log.is_dir() and not RunFolder(log).log.is_file():
        from mission.analysis.several import load_several
        from mission.log.world_files import write_world

        several = load_several((log,), asked=True)
        for why in several.left_out:
            Console(stderr=True, **PLAIN).print(f"left out: {why}")
        world = several.together
        return (write_world(out or log / f"together.{to}", world.area, world.seen, world.met),)
    if to == "mcap":
        raise InputError(f"{log}: is a log of one flight; --to mcap is of a folder of several")
    log = _file(log)
    folder = out or log.with_name(f"{log.stem}-{to}")
    file = out or log.with_suffix(f".{to}")
    if to == "kml":
        from mission.log.export import export_kml

        return (export_kml(log, file),)
    if to == "geojson":
        from mission.analysis.load import load_run
        from mission.log.export import export_geojson

        return (export_geojson(load_run(log).data, file),)
    if to == "ulog":
        from mission.flight.logs.ulog_export import export_ulog

        return (export_ulog(log, out or log.with_suffix(".ulg")),)
    if to == "attachments":
        from mission.log.export import export_attachments

        return export_attachments(log, folder)
    from mission.log.export import export_tables

    return export_tables(log, folder, to)


def diff(first: Path, second: Path, *, as_json: Json = False) -> int:
    """Say where two logs differ.

    Example: aerofed log diff a/flight.mcap b/flight.mcap

    Args:
        first: A log, or its run's folder.
        second: Another log, or its run's folder. Exit code 0: they say the same; 7: they differ.
        as_json: Print the differences as JSON.
    """
    from mission.log.inspection import diff as compare

    lines = compare(_file(first), _file(second))
    value = {"same": not lines, "differences": lines}
    tell(value, lines or ("the same",), as_json=as_json)
    return DIFFERENT if lines else 0


def _file(log: Path) -> Path:
    """Return the log of a run's folder, or the path as it is where it is no folder."""
    if not log.is_dir():
        return log
    file = RunFolder(log).log
    if not file.is_file():
        from mission.analysis.load import no_log_in

        raise no_log_in(log)
    return file
