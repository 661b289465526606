"""Pictures of the flights of `flight_accuracy.py`: a square at 20 m/s, and an outage of GNSS.

python benchmarks/flight_figures.py DIR  # square.png, outage.png
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import numpy as np
from flight_accuracy import SQUARE_DEG, Outage, Track, fly, hovering, legs, off_track, outage
from matplotlib import pyplot as plt

_COLOURS = ("#0072b2", "#d55e00")
_STYLES = ("-", "--")
_KINDS = ("gnss position", "gnss velocity", "baro", "heading")
_KIND_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#7f7f7f")


def draw_square(flights: Mapping[str, Track], path: Path) -> None:
    """Truth against plan: the map, one corner of it, and the distance from the plan over time."""
    figure = plt.figure(figsize=(12, 7), layout="constrained")
    axes = figure.subplot_mosaic([["map", "corner"], ["time", "time"]], height_ratios=[2, 1])
    points = next(iter(flights.values())).points
    for name in ("map", "corner"):
        axes[name].plot(
            points[:, 1], points[:, 0], color="0.6", linewidth=3, label="plan", zorder=1
        )
    for (name, track), colour, style in zip(flights.items(), _COLOURS, _STYLES, strict=True):
        at = track.true_m
        off, _ = off_track(track.points, at)
        for part in ("map", "corner"):
            axes[part].plot(at[:, 1], at[:, 0], style, color=colour, linewidth=1.4, label=name)
        axes["time"].plot(track.t_s, off, color=colour, linewidth=1, label=name)
    corner = points[1]
    axes["map"].set(
        xlabel="east (m)", ylabel="north (m)", title="400 m square at 20 m/s: true tracks"
    )
    axes["corner"].set(
        xlabel="east (m)", ylabel="north (m)", title="the first corner: cut within 5 m",
        xlim=(corner[1] - 4, corner[1] + 24), ylim=(corner[0] - 24, corner[0] + 4),
    )  # fmt: skip
    angle = np.linspace(0, 2 * np.pi, 100)
    axes["corner"].plot(
        corner[1] + 5 * np.cos(angle), corner[0] + 5 * np.sin(angle), ":", color="0.4",
        label="acceptance, 5 m",
    )  # fmt: skip
    for name in ("map", "corner"):
        axes[name].set_aspect("equal", adjustable="box")
        axes[name].grid(alpha=0.3)
    axes["map"].legend(loc="center")
    axes["corner"].legend(loc="lower right")
    axes["time"].set(
        xlabel="time (s)", ylabel="distance from plan (m)", yscale="log", ylim=(1e-3, 10)
    )
    axes["time"].grid(alpha=0.3, which="both")
    axes["time"].legend(loc="upper right", ncols=2)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_outage(flight: Outage, path: Path) -> None:
    """Error of the estimate in its own 2-sigma band, and what the sensors said against it."""
    figure, axes = plt.subplots(3, 1, figsize=(12, 9), sharex=True, layout="constrained")
    for index, axis in enumerate(("north", "east")):
        ax, band = axes[index], 2 * flight.std_m[:, index]
        ax.fill_between(flight.t_s, -band, band, color=_COLOURS[0], alpha=0.15, label="2 sigma")
        ax.plot(flight.t_s, flight.error[:, index], color=_COLOURS[0], label="belief less truth")
        ax.set(ylabel=f"error {axis} (m)")
    for kind, colour in zip(_KINDS, _KIND_COLOURS, strict=True):
        found = [i for i in flight.innovations if i.kind == kind]
        t_s, ratio = np.array([i.t_ns * 1e-9 for i in found]), np.array([i.ratio for i in found])
        axes[2].plot(t_s, ratio, ".", color=colour, markersize=4, label=kind)
        refused = np.array([not i.accepted for i in found], dtype=bool)
        axes[2].plot(t_s[refused], ratio[refused], "x", color=colour, markersize=8)
    axes[2].axhline(1.0, color="0.3", linewidth=1, label="gate")
    axes[2].set(xlabel="time (s)", ylabel="innovation / gate", ylim=(0, 1.3))
    axes[0].set_title("10 s without GNSS at 10 m/s in 8 m/s wind, severity 4; default sensors")
    for ax in axes:
        ax.axvspan(flight.start_s, flight.end_s, color="0.5", alpha=0.15)
        ax.grid(alpha=0.3)
        ax.legend(loc="upper left", ncols=5)
        ax.set_xlim(0, flight.t_s[-1])
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    """Fly, and draw into a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, metavar="DIR")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    squares = {}
    for windy, name in ((False, "calm"), (True, "8 m/s wind, severity 4")):
        aircraft = hovering("perfect", windy=windy)
        squares[name] = fly(aircraft, legs(aircraft.belief.pos_ned_m, SQUARE_DEG))
    draw_square(squares, folder / "square.png")
    draw_outage(outage(), folder / "outage.png")
    print(f"figures in {folder}")


if __name__ == "__main__":
    main()
