"""The end of a report: where the time went, in what conditions, with which versions."""

from collections.abc import Mapping
from typing import Any

from mission.analysis.load import LoadedRun
from mission.base.tables import count

_COMPASS = "north north-east east south-east south south-west west north-west"
_NAMED = (
    *("ended_by", "seed", "simulated_s", "real_time_factor", "battery_changes"),
    "position_source",
)


def about(run: LoadedRun) -> dict[str, object]:
    """Collect wall times, conditions, versions and configuration for the end of the page."""
    summary: Mapping[str, object] = run.summary
    config = run.data.attachments.get("config.toml", b"").decode("utf-8", errors="replace")
    wind = _wind(run.data.config)
    wall_s = summary.get("wall_s")
    wall_s = wall_s if isinstance(wall_s, dict) else {}
    versions = [(key, summary[key]) for key in ("python", "platform", "cpus") if key in summary]
    libraries = summary.get("libraries")
    if isinstance(libraries, dict):
        versions += libraries.items()
    return {
        "wall_s": [(name, seconds) for name, seconds in wall_s.items() if name != "total"],
        "total_s": wall_s.get("total", sum(wall_s.values())),
        "conditions": [
            *([("wind", wind)] if wind else []),
            *((key.replace("_", " "), _say(summary[key])) for key in _NAMED if key in summary),
        ],
        "versions": "\n".join(f"{name:14} {version}" for name, version in versions),
        "config": config,
    }


def _wind(config: Mapping[str, Any]) -> str:
    """The wind as it was configured, in words; empty where nothing says it."""
    wind = config.get("vehicle", {}).get("aircraft", {}).get("wind")
    if wind is None:
        return ""
    speed_mps, severity = wind.get("speed_mps", 0.0), wind.get("turbulence_severity", 0)
    gusts = wind.get("gusts", [])
    steady = f"{speed_mps:g} m/s"
    if "from_deg" in wind:
        named = _COMPASS.split()[round(wind["from_deg"] / 45) % 8]
        steady += f" from {named} ({wind['from_deg']:g}°)"
    parts = [steady if speed_mps else "no steady wind"]
    parts.append(f"turbulence of severity {severity} of 7" if severity else "no turbulence")
    parts.append(count(len(gusts), "gust") if gusts else "no gusts")
    return ", ".join(parts)


def _say(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
