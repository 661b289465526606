"""What plans for the benchmark's problems are worth, and whether they keep to the rules.

    python evaluate.py PLANS.json [--problems problems.json] [--reference plans.json]

Needs Python 3.11 and numpy, nothing else. PLANS.json has an object for each problem's id:

    {"waypoints": [[x, y], ...], "schedule": [[0, 1, ...], ...], "route": [[x, y], ...],
     "altitude_m": 60.0}

N waypoints, the first at the start; N rows of K zeros and ones; `route` only where the way
between waypoints has corners, `altitude_m` only where the problem leaves it open. Of several
aircraft `{"vehicles": [...]}` has one such object for each, with `wait_s` where one hovers at its
start before it leaves. Whatever else is there is not looked at. README.md has the rules. All of it
is written anew from them, so that it checks the planner it came with as well.
"""

import argparse
import json
import math
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np

SPEED_MPS, RADIUS_M, CUT_SHARE, ACCEL_MPS2, SMOOTHING_S = 20.0, 5.0, 0.7, 5.0, 0.4
SETTLING_S, ASTRAY_M, SAME_PLACE_M, SAMPLE_S, SPILL = 0.3, 0.15, 0.5, 0.1, 0.2
RADIUS_SHARES, NARROWEST_M, MOST_LOST = (1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2), 1.0, 0.01
AHEAD_S, AHEAD_SHARE = 0.5, 0.02  # a flight may be ahead of its times by as much
TOLERANCE_M, ROUNDING = 1e-3, 1.0 + 1e-9
TRACK_S, APART_TOLERANCE_M, LAYER_M = 0.05, 0.02, 10.0
# Watts of level flight at 0, 1, 2, ... m/s at sea level.
POWER_W = (
    156.6, 155.7, 153.4, 149.8, 145.4, 140.6, 136.1, 132.5, 130.4, 130.0, 131.7, 135.2, 140.0,
    146.8, 156.3, 168.6, 183.9, 203.0, 225.8, 252.7, 285.3, 323.3, 364.6, 412.9, 468.6, 532.3,
)  # fmt: skip


class BrokenRuleError(Exception):
    """What a plan does that its problem does not allow."""


def success(channel, height_m, distance_m):
    """1 - q_bar at horizontal distances: rho Phi_LoS + (1 - rho) Phi_NLoS is what is lost."""
    r = np.abs(np.asarray(distance_m, dtype=float))
    theta = np.arctan2(height_m, r)
    rho = 1.0 / (1.0 + np.exp(channel["a2"] - channel["a1_per_rad"] * theta))
    log_d = np.log(np.maximum(np.hypot(r, height_m), 1.0))
    db, lost = math.log(10.0) / 10.0, np.zeros(r.shape)
    for segment, share in (("los", rho), ("nlos", 1.0 - rho)):
        budget_db = channel["tx_power_db"] - channel["noise_db"] + channel[f"beta_{segment}_db"]
        mean = budget_db * db - channel[f"alpha_{segment}"] * log_d
        z = (math.log(channel["snr_threshold"]) - mean) / channel[f"sigma_{segment}"]
        lost += share * np.array([math.erfc(-x / math.sqrt(2.0)) / 2.0 for x in z.flat]).reshape(
            z.shape
        )
    return 1.0 - np.minimum(lost, 1.0)


def worth(problem, height_m, waypoints, schedule):
    """The objective: importance times success, summed over who sends, and when."""
    steps, devices = np.nonzero(schedule)
    away = np.linalg.norm(waypoints[steps] - np.array(problem["devices"])[devices], axis=1)
    chances = success(problem["channel"], height_m, away)
    return float((chances * np.array(problem["importance"])[devices]).sum())


def power_w(speed, accel):
    """Watts at a speed (n,) and a size of the acceleration (n,)."""
    level = np.interp(speed, np.arange(len(POWER_W)), POWER_W)
    return level + POWER_W[0] * ((1.0 + (accel / 9.81) ** 2) ** 0.75 - 1.0)


def allowed_cut(sine, radius):
    """How far a corner may be missed: a share of the radius, less where the parabola would leave
    its legs by much outside of the circle."""
    cut = CUT_SHARE * radius
    while cut > 1e-6:
        v = math.sqrt(2.0 * cut) / sine  # with an acceleration of 1
        before, cosine = v * v * sine, math.sqrt(max(1.0 - sine * sine, 0.0))
        off = SPILL * radius
        if before <= radius or cosine * (v * sine) ** 2 / 2.0 <= off:
            break
        t = math.sqrt(2.0 * off / cosine)
        if math.hypot(before - v * t + sine * t * t / 2.0, off) <= radius:
            break
        cut *= 0.95
    return cut


def vertex_speeds(lengths, units, radius):
    """Speed at each vertex, from rest to rest, and sin(phi / 2) of the turn there."""
    n, a = len(lengths), ACCEL_MPS2
    speeds, sines = [0.0] * (n + 1), [0.0] * (n + 1)
    for i in range(1, n):
        sines[i] = s = float(np.linalg.norm(units[i] - units[i - 1])) / 2.0
        speeds[i] = SPEED_MPS
        if s > 1e-9:
            speeds[i] = min(
                SPEED_MPS,
                math.sqrt(2.0 * a * allowed_cut(s, radius)) / s,
                math.sqrt(a * min(lengths[i - 1], lengths[i]) / (2.0 * s)),
            )
    pairs = [(i, i, i + 1) for i in range(n)] + [(i, i + 1, i) for i in reversed(range(n))]
    for _ in range(2 * n):
        before = list(speeds)
        for leg, here, there in pairs:
            square = speeds[here] ** 2
            room = lengths[leg] - square * sines[here] / a
            best = (square + 2.0 * a * room) / (1.0 + 2.0 * sines[there])
            speeds[there] = min(speeds[there], math.sqrt(max(best, 0.0)))
        if speeds == before:
            break
    return speeds, sines


def run(points, radius):
    """A flight from rest to rest without a hover: when each point is passed, seconds, joules, and
    the pieces of its trajectory, of constant acceleration each."""
    apart, counts = [points[0]], [1]  # places, and how many points are passed with each
    for index, point in enumerate(points[1:], start=2):
        if math.dist(apart[-1], point) < 1e-3:
            counts[-1] = index
        else:
            apart.append(point)
            counts.append(index)
    if len(apart) == 1:
        passed = [0.0] + [SMOOTHING_S] * (len(points) - 1)
        rest = [(0.0, points[0], np.zeros(2), np.zeros(2))]
        return passed, SMOOTHING_S + SETTLING_S, POWER_W[0] * (SMOOTHING_S + SETTLING_S), rest
    vertices = np.array(apart)
    legs = np.diff(vertices, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    units = legs / lengths[:, None]
    speeds, sines = vertex_speeds(lengths.tolist(), units, radius)
    pieces, now, place, a = (
        [],
        0.0,
        vertices[0],
        ACCEL_MPS2,
    )  # (begin, position, velocity, acceleration)
    passed, half = [0.0], SMOOTHING_S / 2.0

    def add(velocity, acceleration, duration):
        nonlocal now, place
        if duration > 0.0:
            pieces.append((now, place, velocity, acceleration))
            place = place + velocity * duration + acceleration * duration**2 / 2.0
            now += duration

    for i, (length, unit) in enumerate(zip(lengths, units, strict=True)):
        v0, v1 = speeds[i], speeds[i + 1]
        straight = max(length - (v0 * v0 * sines[i] + v1 * v1 * sines[i + 1]) / a, 0.0)
        top = max(min(SPEED_MPS, math.sqrt((v0 * v0 + v1 * v1) / 2.0 + a * straight)), v0, v1)
        cruise = max(straight - (2.0 * top * top - v0 * v0 - v1 * v1) / (2.0 * a), 0.0)
        add(unit * v0, unit * a, (top - v0) / a)
        add(unit * top, unit * 0.0, cruise / top)
        add(unit * top, unit * -a, (top - v1) / a)
        blend = v1 * sines[i + 1] / a
        passed += [now + half + blend] * (counts[i + 1] - len(passed))
        if blend > 0.0:
            add(unit * v1, (units[i + 1] - unit) * v1 / (2.0 * blend), 2.0 * blend)
    at_end = counts[-1] - counts[-2]
    passed[len(passed) - at_end :] = [now + SMOOTHING_S] * at_end
    pieces.append((now, vertices[-1], np.zeros(2), np.zeros(2)))
    return (
        passed,
        passed[-1] + SETTLING_S,
        joules(pieces, now + SMOOTHING_S) + POWER_W[0] * SETTLING_S,
        pieces,
    )


def unsmoothed(pieces, t):
    """Position and velocity (n, 2) at times (n,), before averaging."""
    begin = np.array([piece[0] for piece in pieces])
    p, v, a = (np.array([piece[k] for piece in pieces]) for k in (1, 2, 3))
    at = np.maximum(np.searchsorted(begin, t, side="right") - 1, 0)
    s = (t - begin[at])[:, None]
    bent = np.where(s < 0.0, 0.0, a[at])
    return p[at] + v[at] * s + bent * s * s / 2.0, v[at] + bent * s


def joules(pieces, moving_s):
    """Of a trajectory whose velocity and acceleration are averaged over `SMOOTHING_S`."""
    half = SMOOTHING_S / 2.0
    times, step = np.linspace(0.0, moving_s, math.ceil(moving_s / SAMPLE_S) + 1, retstep=True)

    before, after = unsmoothed(pieces, times - 2.0 * half), unsmoothed(pieces, times)
    velocity, acceleration = ((y - x) / SMOOTHING_S for x, y in zip(before, after, strict=True))
    watts = power_w(np.linalg.norm(velocity, axis=1), np.linalg.norm(acceleration, axis=1))
    return float((watts.sum() - (watts[0] + watts[-1]) / 2.0) * step)


def flight(points, hold_s, radius, track=None):
    """When each stop (S, 2) is reached, seconds and joules of all, hovering (S,) seconds there.
    Into the list `track` go the runs: where and when each begins, and its trajectory."""
    arrived, now, energy, first, final = [0.0], 0.0, 0.0, 0, len(points) - 1
    for last in range(final + 1):
        if not (hold_s[last] > 0.0 or last == final > 0):
            continue
        way = points[first : last + 1]
        if first == last:  # a hover where it is begins with finding the place
            way = points[[0, 0]] + [[0.0, 0.0], [ASTRAY_M, 0.0]]
        passed, moved_s, used_j, pieces = run(way, radius)
        if track is not None:  # that little way is not looked at
            still = [(0.0, points[first], np.zeros(2), np.zeros(2))]
            track.append((now, still if first == last else pieces))
        arrived += [now + at for at in passed[1 : last - first + 1]]
        now += moved_s + hold_s[last]
        energy += used_j + POWER_W[0] * hold_s[last]
        first = last
    return arrived, now, energy


def stops(problem, route, at, schedule, wait_s=0.0):
    """Places, seconds of hover, and of each step its stop and when it begins after the arrival."""
    upload = np.array(problem.get("upload_s") or [0.0] * len(problem["devices"]))
    busy = schedule @ upload
    groups = []  # the first point of the route, and the steps
    step_of = {int(point): step for step, point in enumerate(at)}
    for index, point in enumerate(route):
        if not groups or math.dist(point, route[groups[-1][0]]) > SAME_PLACE_M:
            groups.append((index, []))
        if index in step_of:
            groups[-1][1].append(step_of[index])
    hold_s, begins = [], np.zeros(len(schedule))
    stop_of = np.zeros(len(schedule), dtype=int)
    for stop, (_, steps) in enumerate(groups):
        free = 0.0
        for step in steps:
            begins[step], stop_of[step] = free, stop
            free += busy[step]
        hold_s.append(free)
    hold_s[0] = max(hold_s[0], wait_s)
    return route[[index for index, _ in groups]], hold_s, stop_of, begins


def places(track, times):
    """(n, 2) where a flight of such runs is at times (n,): averaged over `SMOOTHING_S`."""
    begun = np.array([begin for begin, _ in track])
    of = np.maximum(np.searchsorted(begun, times, side="right") - 1, 0)
    shares, weights = np.polynomial.legendre.leggauss(12)
    found = np.zeros((len(times), 2))
    for number, (begin, pieces) in enumerate(track):
        mine = of == number
        for share, weight in zip(shares, weights, strict=True):
            t = times[mine] - begin - SMOOTHING_S * (1.0 - share) / 2.0
            found[mine] += weight / 2.0 * unsmoothed(pieces, t)[0]
    return found


def cut_corners(route, radius):
    """(P, 2) where points are passed if corners are cut along their bisectors by up to a radius."""
    new = np.r_[True, np.linalg.norm(np.diff(route, axis=0), axis=1) > SAME_PLACE_M]
    points, legs = route[new].copy(), np.diff(route[new], axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    turn = np.diff(legs / np.maximum(lengths, 1e-9)[:, None], axis=0)
    twice = np.linalg.norm(turn, axis=1)
    depth = np.minimum(radius, np.minimum(lengths[:-1], lengths[1:]) * twice / 8.0)
    bends = twice > 1e-9
    points[1:-1][bends] += (depth[bends] / twice[bends])[:, None] * turn[bends]
    return points[np.cumsum(new) - 1]


def radius_of(problem, height_m, route, at, schedule, value):
    """How far corners are cut at most: the widest of some radii that loses 1 % of the value."""
    widest = min(RADIUS_M, problem["margin_m"] / 2.0) if problem.get("areas") else RADIUS_M
    radii = [
        share * widest for share in RADIUS_SHARES if share == 1.0 or share * widest > NARROWEST_M
    ]
    for radius in radii:
        flown = worth(problem, height_m, cut_corners(route, radius)[at], schedule)
        if flown >= (1.0 - MOST_LOST) * value:
            return radius
    return radii[-1]


def segments_apart(a, b, c, d):
    """(n,) distance of segments a-b from c-d, 0 where they cross."""

    def from_segment(p, q, r):
        way = r - q
        share = ((p - q) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-300)
        return np.linalg.norm(p - q - np.clip(share, 0.0, 1.0)[:, None] * way, axis=1)

    def side(p, q, r):
        return (q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]

    crossed = (side(a, b, c) * side(a, b, d) < 0.0) & (side(c, d, a) * side(c, d, b) < 0.0)
    near = np.minimum.reduce(
        [from_segment(a, c, d), from_segment(b, c, d), from_segment(c, a, b), from_segment(d, a, b)]
    )
    return np.where(crossed, 0.0, near)


def check_areas(problem, route):
    """That every leg keeps the margin from every outline."""
    for area in problem.get("areas", ()):
        ring = np.array(area)
        for first, last in pairwise(route):
            legs = (np.broadcast_to(point, ring.shape) for point in (first, last))
            away = segments_apart(*legs, ring, np.roll(ring, -1, axis=0)).min()
            if away < problem["margin_m"] - TOLERANCE_M:
                raise BrokenRuleError(f"a leg comes within {away:.3f} m of an area")


def evaluate(problem, plan):
    """Objective, seconds and joules of a plan; of several aircraft those of all, the longest, those
    of all. Raises BrokenRuleError."""
    vehicles = problem.get("vehicles")
    if vehicles is None:
        return alone(problem, plan)
    if len(plan["vehicles"]) != len(vehicles):
        raise BrokenRuleError(f"{len(plan['vehicles'])} vehicles, there are {len(vehicles)}")
    apart_m = problem.get("separation_m", 0.0)
    layers = apart_m and not problem.get("areas")
    spare_m = (len(vehicles) - 1) / 2.0 * max(LAYER_M, apart_m) if layers else 0.0
    found, tracks = [], []
    for number, (vehicle, own) in enumerate(zip(vehicles, plan["vehicles"], strict=True)):
        one = {name: value for name, value in problem.items() if name != "vehicles"} | vehicle
        if "altitude_m" in vehicle:
            one["channel"] = problem["channel"] | {"altitude_m": vehicle["altitude_m"]}
            one.pop("altitudes_m", None)
        track = []
        try:
            found.append(alone(one, own, spare_m, track))
        except BrokenRuleError as broken:
            raise BrokenRuleError(f"vehicle {number}: {broken}") from None
        height_m = float(own.get("altitude_m", one["channel"]["altitude_m"]))
        tracks.append((track, height_m))
    if sum(np.array(own["schedule"]).sum(axis=0) for own in plan["vehicles"]).max(initial=0) > 1:
        raise BrokenRuleError("a device sends to two vehicles")
    value, seconds, used_j = np.array(found).T
    if apart_m:
        check_apart(tracks, seconds.max(), apart_m)
    return float(value.sum()), float(seconds.max()), float(used_j.sum())


def check_apart(tracks, longest_s, apart_m):
    """That each pair keeps its distance from when it has first had it, or one of them has gone so
    far from where the other started."""
    times = np.arange(0.0, longest_s + 2.0 * TRACK_S, TRACK_S)
    where = [
        np.column_stack((places(track, times), np.full(len(times), height_m)))
        for track, height_m in tracks
    ]
    for first, second in combinations(range(len(where)), 2):
        a, b = where[first], where[second]
        far = [np.linalg.norm(way, axis=1) for way in (b - a, a - b[0], b - a[0])]
        gone = np.flatnonzero(np.max(far, axis=0) >= apart_m)
        if not len(gone):
            continue
        away = (b - a)[gone[0] :]
        here, way = away[:-1], np.diff(away, axis=0)
        share = -(here * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12)
        near = np.linalg.norm(here + np.clip(share, 0.0, 1.0)[:, None] * way, axis=1)
        if near.min(initial=math.inf) < apart_m - APART_TOLERANCE_M:
            at_s = times[gone[0] + near.argmin()]
            raise BrokenRuleError(
                f"vehicles {first} and {second} are {near.min():.2f} m apart at {at_s:.1f} s, "
                f"{apart_m:g} must be"
            )


def alone(problem, plan, spare_m=0.0, track=None):
    """The same for one aircraft, which may be up to `spare_m` above or below its altitude; where
    it is goes into the list `track`."""
    waypoints, schedule = (
        np.array(plan["waypoints"], dtype=float),
        np.array(plan["schedule"], dtype=float),
    )
    count = len(problem["devices"])
    if waypoints.shape != (problem["steps"], 2) or schedule.shape != (problem["steps"], count):
        raise BrokenRuleError("waypoints or schedule have another shape")
    if not np.isfinite(waypoints).all() or not np.isin(schedule, (0.0, 1.0)).all():
        raise BrokenRuleError("a waypoint is not finite, or the schedule holds other than 0 and 1")
    if (
        schedule.sum(axis=0).max(initial=0.0) > 1
        or schedule.sum(axis=1).max() > problem["per_step"]
    ):
        raise BrokenRuleError("a device sends twice, or too many at a step")
    if math.dist(waypoints[0], problem["start"]) > TOLERANCE_M:
        raise BrokenRuleError("the first waypoint is not the start")
    height_m = problem["channel"]["altitude_m"]
    if "altitudes_m" in problem:
        height_m, (low, high) = float(plan["altitude_m"]), problem["altitudes_m"]
        if not low <= height_m <= high:
            raise BrokenRuleError(f"an altitude of {height_m:g} m")
    elif spare_m and "altitude_m" in plan:
        fixed_m, height_m = height_m, float(plan["altitude_m"])
        if not (abs(height_m - fixed_m) <= spare_m and height_m > 0.0):
            raise BrokenRuleError(f"an altitude of {height_m:g} m")
    route = np.array(plan.get("route") or plan["waypoints"], dtype=float)
    at, index = [], 0  # which points of the route are the waypoints
    for waypoint in waypoints:
        while index < len(route) and (route[index] != waypoint).any():
            index += 1
        at.append(index)
        index += 1
    if at[0] != 0 or index != len(route):
        raise BrokenRuleError("the route does not lead over the waypoints, from first to last")
    length_m = float(np.linalg.norm(np.diff(route, axis=0), axis=1).sum())
    if length_m > problem["path_budget_m"] + TOLERANCE_M:
        raise BrokenRuleError(f"{length_m:.3f} m, {problem['path_budget_m']:g} are allowed")
    check_areas(problem, route)
    wait_s = float(plan.get("wait_s", 0.0))
    if not 0.0 <= wait_s < math.inf:
        raise BrokenRuleError(f"a wait of {wait_s} s")
    points, hold_s, stop_of, begins = stops(problem, route, at, schedule, wait_s)
    in_turn = schedule
    if "ready_in_s" in problem:
        arrived, _, _ = flight(points, hold_s, RADIUS_M)
        begin_s = np.array(arrived)[stop_of] + begins
        begin_s = np.maximum(0.0, begin_s * (1.0 - AHEAD_SHARE) - AHEAD_S)
        in_turn = schedule * (begin_s[:, None] >= np.array(problem["ready_in_s"])[None, :])
    value = worth(problem, height_m, waypoints, in_turn)
    radius = radius_of(problem, height_m, route, at, schedule, value)
    _, duration_s, energy_j = flight(points, hold_s, radius, track)
    for name, taken in (("deadline_s", duration_s), ("energy_j", energy_j)):
        if taken > problem.get(name, math.inf) * ROUNDING:
            raise BrokenRuleError(f"{name}: takes {taken:.3f}, {problem[name]:g} are allowed")
    return value, duration_s, energy_j


def read(path):
    """What a JSON file holds."""
    return json.loads(path.read_text(encoding="utf-8"))


def main():
    """Print a line for each kind of problem, and one for each broken rule."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("plans", type=Path, help="for the 300 problems, or for the 60 of fleets")
    plans, here = read(parser.parse_args().plans), Path(__file__).parent
    for of in ("", "fleet-"):
        problems, reference = read(here / f"{of}problems.json"), read(here / f"{of}plans.json")
        if not reference.keys().isdisjoint(plans):
            break
    else:
        parser.error("plans: none has the id of a problem, such as plain-12x3-00 or two-12-0")
    rows = {}
    for problem in problems:
        name = problem["id"]
        kept, ratio, gap = 0, 0.0, math.nan
        try:
            value, _, _ = evaluate(problem, plans[name])
        except KeyError as missing:
            print(f"{name}: has no {missing}")
        except BrokenRuleError as broken:
            print(f"{name}: {broken}")
        else:
            known = reference[name]
            kept, ratio = 1, value / known["value"] if known["value"] else 1.0
            if known["upper_bound"]:
                gap = 1.0 - value / known["upper_bound"]
        rows.setdefault(name.rpartition("-")[0], []).append((kept, ratio, gap))
    heads = "problems", "valid", "of ours", "worst", "gap, %", "worst"
    print(f"{'kind':<16}" + "".join(f"{head:>9}" for head in heads))
    rows["all"] = [row for kind in list(rows) for row in rows[kind]]
    for kind, found in rows.items():
        kept, ratio, gap = np.array(found).T
        print(
            f"{kind:<16}{len(found):>9}{int(kept.sum()):>9}{ratio.mean():>9.4f}{ratio.min():>9.4f}"
            f"{100.0 * np.nanmedian(gap):>9.2f}{100.0 * np.nanmax(gap):>9.2f}"
        )


if __name__ == "__main__":
    main()
