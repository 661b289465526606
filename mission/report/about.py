"""The end of a report: where the time went, in what conditions, with which versions."""

import tomllib
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from mission.analysis.load import LoadedRun
from mission.report import html
from mission.report.charts import COOL

_COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west",
            "north-west")  # fmt: skip


def about_cards(run: LoadedRun) -> list[str]:
    """Wall time, conditions, versions, configuration: what is known of them."""
    cards = []
    wall_s = run.summary.get("wall_s")
    if isinstance(wall_s, dict):
        cards.append(_time_card(wall_s))
    config = run.data.attachments.get("config.toml", b"").decode("utf-8", errors="replace")
    facts = [("wind", wind) for wind in [_wind(config)] if wind]
    named = ("seed", "simulated_s", "real_time_factor", "battery_changes", "position_source")
    facts += [
        (key.replace("_", " "), _say(run.summary[key])) for key in named if key in run.summary
    ]
    if facts:
        cards.append(f'<section class="card"><h3>Conditions</h3>{_rows(facts)}</section>')
    versions: list[tuple[str, str]] = []
    machine = ("python", "platform", "cpus")
    versions += [(key, str(run.summary[key])) for key in machine if key in run.summary]
    libraries = run.summary.get("libraries")
    if isinstance(libraries, dict):
        versions += [(str(name), str(version)) for name, version in libraries.items()]
    if versions:
        text = "\n".join(f"{name:14} {version}" for name, version in versions)
        cards.append(html.folded("Versions and machine", text))
    if config:
        cards.append(html.folded("Configuration", config))
    return cards


def _time_card(wall_s: Mapping[str, float]) -> str:
    """Where the wall time of the run went."""
    total = wall_s.get("total", sum(wall_s.values()))
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td class=number>{seconds:.1f} s</td>"
        f'<td style="width:45%"><div style="height:12px;border-radius:3px;background:{COOL};'
        f'width:{100 * seconds / total if total else 0:.1f}%"></div></td></tr>'
        for name, seconds in wall_s.items()
        if name != "total"
    )
    return f'<section class="card"><h3>Wall time: {total:.1f} s</h3><table>{rows}</table></section>'


def _wind(config: str) -> str:
    """The wind as it was configured, in words; empty where nothing says it."""
    try:
        vehicle = tomllib.loads(config).get("vehicle", {})
    except tomllib.TOMLDecodeError:
        return ""
    wind = vehicle.get("aircraft", {}).get("wind")
    if not isinstance(wind, dict):
        return ""
    speed_mps, severity = wind.get("speed_mps", 0.0), wind.get("turbulence_severity", 0)
    gusts = wind.get("gusts", [])
    steady = f"{speed_mps:g} m/s"
    if "from_deg" in wind:
        named = _COMPASS[round(wind["from_deg"] / 45) % 8]
        steady += f" from {named} ({wind['from_deg']:g}°)"
    parts = [steady if speed_mps else "no steady wind"]
    parts.append(f"turbulence of severity {severity} of 7" if severity else "no turbulence")
    parts.append(f"{len(gusts)} gust{'' if len(gusts) == 1 else 's'}" if gusts else "no gusts")
    return ", ".join(parts)


def _say(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _rows(facts: Sequence[tuple[str, str]]) -> str:
    rows = "".join(f"<tr><td>{escape(k)}</td><td>{escape(v)}</td></tr>" for k, v in facts)
    return f"<table>{rows}</table>"
