"""`aerofed link-budget`."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from mission.base.console import PLAIN, Terminal
from mission.commands.options import Json, Overrides, load, print_json

if TYPE_CHECKING:
    from fl.config import ChannelConfig

_DISTANCES_M = (0.0, 25.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 400.0, 600.0, 800.0)
_BAD_OVERHEAD_PER = 0.5


def link_budget(config: Path | None = None, *, set_: Overrides = (), as_json: Json = False) -> int:
    """Print the packet error rate over distance, the served radius, and the logistic fit.

    Example: aerofed link-budget paper --set channel.extra_gain_db=3

    Args:
        config: TOML file whose channel is shown. Without one, the quick start's.
        set_: Override any key: --set channel.preset=literal
        as_json: Print JSON, with every number at full precision.
    """
    resolved = load(config, set_)
    preset, limits = resolved.channel.preset, resolved.mission.altitudes_m
    found = [
        {"preset": preset, "altitude_m": height_m, **_numbers(resolved.channel, height_m)}
        for height_m in limits or resolved.mission.heights_m[:1]
    ]
    if as_json:
        print_json(found if limits else found[0])
    for budget in () if as_json else found:
        _print(budget)
    return 0


def _numbers(config: "ChannelConfig", height_m: float) -> dict[str, Any]:
    """Return PER over distance, served radius and logistic fit of the channel at a height."""
    from fl.radio import channel as radio  # with it NumPy

    channel = config.channel(altitude_m=height_m)
    overhead = radio.link_budget(channel)
    warning = (
        f"PER straight overhead is {overhead.per:.3f}: most packets are lost wherever the "
        "aircraft flies; choose another channel preset or raise tx_power_db"
    )
    return {
        "overhead": overhead,
        "distance_m": _DISTANCES_M,
        "per": [float(radio.average_per(channel, r_m)) for r_m in _DISTANCES_M],
        "served_radius_m": radio.served_radius_m(channel),
        "logistic": radio.fit_logistic(channel),
        "warning": warning if overhead.per > _BAD_OVERHEAD_PER else None,
    }


def _print(budget: Mapping[str, Any]) -> None:
    radius_m, fit = budget["served_radius_m"], budget["logistic"]
    served = f"{radius_m:.0f} m" if radius_m > 0.0 else "none, not even straight overhead"
    rows = zip(budget["distance_m"], budget["per"], strict=True)
    lines = [
        f"channel {budget['preset']}, {budget['altitude_m']:g} m above",
        str(budget["overhead"]),
        "",
        "distance m   PER",
        *(f"{distance_m:10.0f}   {per:.4f}" for distance_m, per in rows),
        "",
        f"served radius (PER 0.5): {served}",
        "stand-in for the PER in the planners paper and paper_literal, over the elevation theta: "
        f"1 / (1 + exp(b1 theta + b2)), b1 = {fit.b1_per_rad:.2f} per rad, b2 = {fit.b2:.2f}, "
        f"wrong by {fit.worst_error:.3f} at most",
    ]
    for line in lines:
        Terminal(**PLAIN).print(line)
    if budget["warning"]:
        Console(stderr=True, **PLAIN).print(f"warning: {budget['warning']}")
