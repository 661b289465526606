"""Pictures of any flight: what the vehicle was told and did, and how it was, over time."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from mission.analysis.compare import RunComparison
from mission.analysis.comparison_text import labels_of
from mission.analysis.told import Values, heights, pair
from mission.analysis.whole import with_battery
from mission.base.airspace import thin
from mission.base.arrays import Floats
from mission.base.gaps import outside
from mission.base.palette import community_colour
from mission.figures.charts import Series, envelope, line_chart
from mission.figures.frame import TOLERANCE_M, run_frame, run_lines
from mission.figures.style import FLOWN, WARM, Chart
from mission.log.signals import AXES, Signal
from mission.log.values import NS_PER_S

_Line: TypeAlias = tuple[str, str, Floats, Floats]  # label, colour, times, values

_WANTED = "told"
_TIME = "time of the log (s)"
# Title, unit, signal, which axes: what was told and what was.
_TOLD = (
    *((f"Position {axis}", "m", "position_m", (n,)) for n, axis in enumerate(("north", "east"))),
    ("Ground speed", "m/s", "velocity_mps", (0, 1)),
    ("Climb", "m/s", "velocity_mps", (2,)),
    *((axis.title(), "deg", "attitude_deg", (n,)) for n, axis in enumerate(AXES["attitude_deg"])),
    *(
        (f"{axis.title()} rate", "deg/s", "rates_degps", (n,))
        for n, axis in enumerate(AXES["rates_degps"])
    ),
)
# Title, unit, signal: all of its axes.
_HEALTH = (
    ("Vibration", "m/s2", "vibration_mps2"),
    ("Clipping", "times", "clips"),
    ("Innovations", "of what is accepted", "innovation_ratio"),
    ("Satellites", "satellites", "satellites"),
    ("Dilution of precision", "HDOP", "hdop"),
    ("Accuracy of GNSS", "m", "gnss_accuracy_m"),
    ("Motors", "of the most", "motors"),
    ("Voltage", "V", "voltage_v"),
    ("Current", "A", "current_a"),
)
# Title, unit, number over time: of flights side by side.
_BOTH = (
    ("Off the plan", "m", "plan_cross_m"),
    ("Off the setpoint", "m", "tracking_m"),
    ("Height off", "m", "height_off_m"),
    ("Tilt off", "deg", "tilt_off_deg"),
    ("Vibration", "m/s2", "vibration_mps2"),
    ("Innovations", "of what is accepted", "innovation_ratio"),
    ("Battery", "V", "voltage_v"),
    ("Motors", "of the most", "motors"),
)


def flight_map(flight: RunComparison, width: float = 640.0) -> Chart:
    """A map of a flight without a plan: where it was told to be, and where it was."""
    run, lines = flight.run.data, run_lines(flight.run.data, [])
    if (of := pair(run.signals, "position_m")) is not None:
        t_s, wanted, actual = of
        told = run.belief.at((t_s * NS_PER_S).astype(np.int64)).pos_m[:, :2]
        told = told + (wanted - actual)[:, 1::-1]
        for part in outside(told, t_s, Signal(t_s, told).holes_s):
            cuts = np.flatnonzero(np.diff(np.isfinite(part).all(axis=1))) + 1
            parts = [p for p in np.split(part, cuts) if np.isfinite(p).all() and len(p) > 1]
            lines += [("planned", 0, thin(one, TOLERANCE_M)) for one in parts]
    frame = run_frame(run, width)
    words = {"text": "Told and flown" if lines[-1][0] == "planned" else "Flown"}
    return frame.finished([frame.home(run.area.home_m), *frame.lines(lines)], words)


def told_charts(flight: RunComparison) -> list[Chart]:
    """Charts of what was told and what was, where the log has both."""
    signals = flight.run.data.signals
    drawn = [("Height", "m", height)] if (height := heights(signals)) is not None else []
    for title, unit, name, axes in _TOLD:
        if (of := pair(signals, name)) is None or of[1].shape[1] <= max(axes):
            continue
        lines = [np.mod(v + 180, 360) - 180 if name == "attitude_deg" else v for v in of[1:]]
        wanted, actual = (np.hypot(*v[:, axes].T) if axes[1:] else v[:, axes[0]] for v in lines)
        drawn.append((title, unit, (of[0], wanted, actual)))
    return [
        chart
        for title, unit, (t_s, wanted, actual) in drawn
        for chart in _chart(
            flight, title, unit, [("was", FLOWN, t_s, actual), (_WANTED, WARM, t_s, wanted)]
        )
    ]


def health_charts(flight: RunComparison) -> list[Chart]:
    """Charts of how the vehicle was."""
    signals, found = with_battery(flight.run.data), list[Chart]()
    for title, unit, name in _HEALTH:
        if (signal := signals.get(name)) is not None:
            axes = range(signal.values.shape[1])
            names = AXES[name] if len(axes) > 1 else (title.lower(),)
            lines = [
                (label, community_colour(n), signal.t_s, signal.values[:, n])
                for n, label in zip(axes, names, strict=False)
            ]
            gate = "refused beyond" * (name == "innovation_ratio")
            found += _chart(flight, title, unit, lines, gate=gate)
    return found


def side_by_side_charts(flights: Sequence[RunComparison]) -> list[Chart]:
    """Charts of flights against each other, over the time since each left the ground."""
    labels, found = labels_of(flights), list[Chart]()
    for title, unit, name in _BOTH:
        lines = []
        for index, flight in enumerate(flights):
            values = flight.flown.series.get(name) if flight.flown else None
            if flight.flown and values and np.isfinite(values.values).any():
                x, y = envelope(values.t_s - flight.flown.start_s, np.abs(values.values))
                lines.append(Series(labels[index], community_colour(index), x, y))
        if lines:
            found.append(line_chart(title, lines, x="time since take-off (s)", y=unit))
    return found


def _chart(
    flight: RunComparison, title: str, unit: str, lines: Sequence[_Line], *, gate: str = ""
) -> list[Chart]:
    """A chart of the time in the air, where any line has a value then."""
    series = []
    for label, colour, t_s, values in lines:
        inside = Values(t_s, values)
        if flight.flown is not None:
            inside = inside.between(flight.flown.start_s, flight.flown.end_s)
        if np.isfinite(inside.values).any():
            x, y = envelope(inside.t_s, inside.values)
            series.append(Series(label, colour, x, y, dashed=label == _WANTED))
    words = f"{title.lower()} ({unit})"
    return [line_chart(title, series, x=_TIME, y=words, gate=gate)] if series else []
