"""Planned against flown for a plan file: the numbers of `aerofed fly`, made and read back."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from mission.alignment import align
from mission.errors import FlightError, InputError
from mission.plancheck import PlannedPath
from mission.track import Flight

SUMMARY = "summary.json"
KEY = "planned_and_flown"


@dataclass(frozen=True)
class PlannedAndFlown:
    """How a flight was against its plan, up to its last place; metres, simulated seconds."""

    plan_path_m: float  # horizontal
    flown_path_m: float
    plan_duration_s: float  # always at the planned speed
    flown_duration_s: float
    cross_track_rms_m: float  # horizontal distance of the true track to the planned line
    cross_track_max_m: float
    places: int
    places_reached: int
    miss_max_m: float  # horizontal distance to a place on the instant it was passed
    height_error_max_m: float  # the same, vertically
    estimate_rms_m: float  # horizontal distance of belief to truth

    def lines(self) -> list[str]:
        """For people."""
        return [
            f"path      planned {self.plan_path_m:.0f} m, flown {self.flown_path_m:.0f} m",
            f"duration  at planned speed {self.plan_duration_s:.1f} s, "
            f"flown {self.flown_duration_s:.1f} s",
            f"cross-track error  rms {self.cross_track_rms_m:.2f} m, "
            f"max {self.cross_track_max_m:.2f} m",
            f"places    {self.places_reached}/{self.places} reached, passed within "
            f"{self.miss_max_m:.2f} m and {self.height_error_max_m:.2f} m in height",
            f"estimate  {self.estimate_rms_m:.2f} m rms from the truth",
        ]


def compare_with_plan(flight: Flight, path: PlannedPath) -> PlannedAndFlown:
    """Planned against flown, from the start of the mission to its last place.

    Raises:
        FlightError: the last place was never reached.
    """
    end = flight.reached.get(path.last_place)
    if end is None:
        raise FlightError(f"item {path.last_place} was never reached")
    until = int(np.searchsorted(flight.t_ns, end.t_ns, side="right"))
    true_m, est_m = flight.true_ned_m[:until], flight.est_ned_m[:until]
    cross_m = align(true_m[:, :2], path.points_ned_m[:, :2]).cross_m
    error_m = np.linalg.norm(est_m[:, :2] - true_m[:, :2], axis=1)
    misses = [
        flight.reached[seq].true_ned_m - place
        for seq, place in path.places.items()
        if seq in flight.reached
    ]
    return PlannedAndFlown(
        plan_path_m=path.path_m,
        flown_path_m=float(np.linalg.norm(np.diff(true_m[:, :2], axis=0), axis=1).sum()),
        plan_duration_s=path.duration_s,
        flown_duration_s=float(end.t_ns - flight.t_ns[0]) / 1e9,
        cross_track_rms_m=math.sqrt(float((cross_m**2).mean())),
        cross_track_max_m=float(cross_m.max()),
        places=len(path.places),
        places_reached=len(misses),
        miss_max_m=max(float(np.linalg.norm(miss[:2])) for miss in misses),
        height_error_max_m=max(abs(float(miss[2])) for miss in misses),
        estimate_rms_m=math.sqrt(float((error_m**2).mean())),
    )


def is_plan_flight(folder: Path) -> bool:
    """Whether the folder is one that `aerofed fly` left."""
    return "plan" in _summary(folder)


def read_plan_flight(folder: Path) -> PlannedAndFlown:
    """The numbers that `aerofed fly` left in its folder.

    Raises:
        InputError: the flight was not finished, or the summary is not one of `aerofed fly`.
    """
    summary = _summary(folder)
    found = summary.get(KEY)
    if found is None:
        raise InputError(
            f"{folder}: the flight was not finished (status {summary.get('status')}), so there is "
            "nothing to compare"
        )
    names = {item.name for item in fields(PlannedAndFlown)}
    if not isinstance(found, dict) or set(found) != names:
        raise InputError(f"{folder / SUMMARY}: {KEY} is not what aerofed fly writes")
    return PlannedAndFlown(**found)


def say_plan_flights(folders: Sequence[Path], *, as_json: bool) -> str:
    """The comparisons of folders of `aerofed fly`, for people or as JSON.

    Raises:
        InputError: see `read_plan_flight`; or one of the folders is a run's.
    """
    for folder in folders:
        if not is_plan_flight(folder):
            raise InputError(
                f"{folder}: not a folder of aerofed fly; flights of plan files and runs cannot "
                "stand side by side"
            )
    flights = [(folder, read_plan_flight(folder)) for folder in folders]
    if as_json:
        data = [{"source": str(folder), **asdict(flight)} for folder, flight in flights]
        return json.dumps(data if len(data) > 1 else data[0], indent=2)
    lines = []
    for folder, flight in flights:
        lines += [f"{folder}: a plan file, flown"] if len(flights) > 1 else []
        lines += flight.lines()
    return "\n".join(lines)


def _summary(folder: Path) -> dict[str, Any]:
    try:
        found = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # whatever it is, nothing that `aerofed fly` has finished
    return found if isinstance(found, dict) else {}
