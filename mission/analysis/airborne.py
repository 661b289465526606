"""When a vehicle was in the air, and in which modes."""

from dataclasses import replace

import numpy as np

from mission.analysis.holes import LOW_M
from mission.base.errors import NoFlightError
from mission.base.gaps import LEAST_S
from mission.log.values import NS_PER_S, FlightData, Modes, Track

DISARMED = "DISARMED"  # in place of the mode of a vehicle that has landed: it may be any
TERMINATED = "TERMINATED"  # the mode of our vehicle once it is wrecked
STANDING_M = 3.0  # that a position may wander on the ground
_OFF_GROUND_M = 0.7
_STILL_M = 0.3  # in a second


def flown_modes(data: FlightData) -> Modes:
    """Return the modes in which the vehicle was armed, and `DISARMED` between."""
    edges = np.ravel(data.armed_ns)
    times = np.unique(np.append(data.modes.t_ns, edges)).astype(np.int64)
    modes = np.searchsorted(data.modes.t_ns, times, side="right") - 1
    armed = np.searchsorted(edges, times, side="right") % 2 == 1
    names = np.array([*data.modes.names, "mode unknown"])[modes]
    return Modes(times, tuple(np.where(armed, names, DISARMED).tolist()))


def airborne(path: object, data: FlightData) -> tuple[int, int]:
    """Return when a flight begins and ends (ns): the last second of standing before it leaves, and
    the last instant away from its first position. Standing is no movement in a second, whatever the
    height, since home may be set anew on the ground. InputError: it never left the ground."""
    t_ns, pos_m = data.truth.t_ns, data.truth.pos_m
    away_m = np.linalg.norm(pos_m - pos_m[0], axis=1)
    off = np.flatnonzero(away_m > _OFF_GROUND_M)
    if not len(off):
        raise NoFlightError(f"{path}: it never left the ground, so there is nothing to compare")
    first = int((away_m > min(STANDING_M, away_m.max() / 2)).argmax())
    moved_m = np.linalg.norm(pos_m - data.truth.at(t_ns - NS_PER_S).pos_m, axis=1)
    stood = np.flatnonzero(moved_m[:first] < _STILL_M)
    start_ns = t_ns[stood[-1]] - NS_PER_S if len(stood) else 0
    end_ns = int(t_ns[off[-1]])
    if data.modes.names[-1:] == (DISARMED,):
        end_ns = min(end_ns, int(data.modes.t_ns[-1]))
    return max(int(start_ns), int(t_ns[0])), end_ns


def air_times(data: FlightData, start_ns: int, end_ns: int) -> list[tuple[float, float]]:
    """From when to when (s) it was armed in a time."""
    both = [(max(since, start_ns), min(until, end_ns)) for since, until in data.armed_ns]
    spans = [(since / NS_PER_S, until / NS_PER_S) for since, until in both if until > since]
    return spans or [(start_ns / NS_PER_S, end_ns / NS_PER_S)]


def times_in_air(path: object, data: FlightData) -> list[tuple[float, float]]:
    """From when to when (s) it was armed and off the ground: it stands where it is armed, and where
    it is disarmed if the log tells that, unless it was lost in the air; where positions begin, or
    end, in the air, up to there. Of a run that nobody flies, all of it. InputError: it never left
    the ground."""
    if data.config.get("mission", {}).get("flight") == "none":
        return [tuple((data.truth.t_ns[[0, -1]] / NS_PER_S).tolist())]
    start_ns, end_ns = airborne(path, replace(data, modes=flown_modes(data)))
    disarmed_ns = max((e.t_ns for e in data.events if e.text == "disarmed"), default=0)
    first_ns, last_ns = data.truth.t_ns[[0, -1]].tolist()
    ended = disarmed_ns - last_ns > LEAST_S * NS_PER_S
    begun = data.truth.pos_m[0, 2] > LOW_M and first_ns - data.armed_ns[0][0] > LEAST_S * NS_PER_S
    start_ns = first_ns if begun else start_ns
    found = list[tuple[float, float]]()
    for since, until in air_times(data, start_ns, end_ns):
        track = data.truth.between(round(since * NS_PER_S), round(until * NS_PER_S))
        rose, landed = (
            np.flatnonzero(np.linalg.norm(track.pos_m - at, axis=1) > _OFF_GROUND_M)
            for at in (track.pos_m[:1], track.pos_m[-1:])
        )
        if len(rose) and len(landed):
            stood = found or not begun
            stands = not ended and disarmed_ns >= round(until * NS_PER_S)
            stands = stands and not _is_lost(data, track)
            begin_s = track.t_ns[rose[0]] / NS_PER_S if stood else since
            end_s = track.t_ns[landed[-1]] / NS_PER_S if stands else until
            found.append((float(begin_s), float(end_s)))
    return found


def _is_lost(data: FlightData, flown: Track) -> bool:
    """Whether a flight ends where its vehicle was wrecked: it was terminated, or still moved."""
    second_ns = flown.t_ns[-1] + NS_PER_S * np.array([-1, 1])  # before, after its end
    moved_m = np.linalg.norm(flown.pos_m[-1] - flown.at(second_ns[:1]).pos_m)
    after = np.searchsorted(data.modes.t_ns, second_ns[1], side="right") - 1
    return bool(moved_m > _STILL_M) or data.modes.names[after] == TERMINATED
