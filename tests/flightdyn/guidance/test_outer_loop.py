"""The outer loop in C against the same in numpy, over orders and states of all kinds."""

import math
from typing import Any

import numpy as np
import pytest
from gains import DT_S, GAINS
from scipy.spatial.transform import Rotation

from flightdyn.native.library import ATTITUDE, NEAR, NOTHING, TARGET, Guide, Strapdown
from flightdyn.native.ticks import Inner

K: Any = type("K", (), GAINS)
NAMES = (
    "p", "v", "a", "integral", "drag", "lagged", "effectiveness", "thrust", "yaw", "yaw_rate",
    "yaw_order", "spin", "saturated", "thrust_order", "climb", "q", "rates", "wanted_yaw", "error",
    "feed", "collective", "lift",
)  # fmt: skip


def wrapped(angle: float) -> float:
    return (angle + math.pi) % math.tau - math.pi


class Loop:
    """Guidance with a memory that is set, and what it orders."""

    def __init__(self) -> None:
        self.orders: dict[str, float] = {}

        def setter(name: str) -> Any:
            return lambda value: self.orders.__setitem__(name, value)

        rates, errors, feeds = (
            [setter(f"{kind} {axis}") for axis in "xyz"] for kind in ("rate", "error", "feed")
        )
        inner = Inner(rates, errors, feeds, setter("collective"), dt_s=DT_S)
        self._guide = Guide(GAINS, inner)
        self.passed = self._guide.passed
        self.memory = self._guide.memory
        self._carried = Strapdown((9.81, 0.0, 0.0), most=1)

    def step(self, state: dict[str, Any]) -> None:
        self._carried.place(tuple(state["at"]), tuple(state["moves"]), tuple(state["turned"]))
        self._carried.set_force(tuple(state["force"]))
        self._guide.step(self._carried)

    def read(self) -> dict[str, Any]:
        found = {}
        for name in NAMES:
            value = getattr(self.memory, name)
            found[name] = value if isinstance(value, int | float) else np.array(value[:])
        return found


def some_state(rng: np.random.Generator) -> dict[str, Any]:
    size = float(rng.choice([0.1, 1.0, 4.0]))
    lean, tilt = rng.uniform(0.0, float(rng.choice([0.2, 1.0, 3.0]))), rng.uniform(-3.0, 3.0)
    body = Rotation.from_euler("Z", rng.uniform(-3, 3)) * Rotation.from_rotvec(
        lean * np.array([math.cos(tilt), math.sin(tilt), 0.0])
    )
    x, y, z, w = body.as_quat().tolist()
    return {
        "at": rng.normal(0, size, 3).tolist(), "moves": rng.normal(0, size, 3).tolist(),
        "turned": (w, x, y, z),
        "force": [*rng.normal(0, 5 * size, 2).tolist(), float(rng.uniform(-40.0, 2.0))],
    }  # fmt: skip


def some_orders(memory: Any, rng: np.random.Generator) -> None:
    for name in ("p", "v", "a", "rates"):
        getattr(memory, name)[:] = rng.normal(0, 1.0, 3).tolist()
    memory.integral[:] = rng.uniform(-6, 6, 3).tolist()
    memory.drag[:] = rng.uniform(-12, 12, 2).tolist()
    memory.lagged, memory.effectiveness = rng.uniform(0.0, 0.6), rng.uniform(0.4, 1.8)
    memory.yaw, memory.yaw_order = rng.uniform(-3, 3, 2).tolist()
    memory.yaw_rate, memory.spin = rng.uniform(-1, 1, 2).tolist()
    memory.saturated = int(rng.random() < 0.3)
    turned = Rotation.from_rotvec(rng.normal(0, 0.4, 3)) * Rotation.from_euler(
        "Z", rng.uniform(-3, 3)
    )
    x, y, z, w = turned.as_quat().tolist()
    memory.q[:] = w, x, y, z
    memory.oriented = int(rng.random() < 0.7)
    memory.thrust_order = math.nan if rng.random() < 0.5 else float(rng.uniform(0.0, 1.0))
    memory.climb = float(rng.uniform(-3.0, 3.0))
    memory.touching = memory.contact = memory.landed = 0
    memory.quiet = 0.0
    match int(rng.integers(4)):
        case 0:
            memory.touching = 1
        case 1:
            memory.touching = memory.contact = 1
        case 2:
            memory.touching = memory.contact = memory.landed = 1


def expected(mode: int, m: dict[str, Any], flags: tuple[int, int, int, int], s: dict[str, Any]):
    """What the loop makes of its memory in a step."""
    touching, contact, landed, oriented = flags
    w, x, y, z = s["turned"]
    body = Rotation.from_quat([x, y, z, w])
    R, force, e = body.as_matrix(), np.array(s["force"]), dict(m)
    down, full = R[:, 2], K.full * m["effectiveness"]

    def by_thrust() -> None:
        """The shares of a step learn what the thrust is worth."""
        if m["lagged"] > 0.05:
            ratio = np.clip(-force[2] / (K.full * m["lagged"]), 0.3, 2.0)
            share = min(0.4, DT_S / K.thrust_lag)
            e["effectiveness"] = m["effectiveness"] + share * (ratio - m["effectiveness"])

    def lift(collective: float, full: float) -> None:
        e["lagged"] = m["lagged"] + DT_S / K.motor_lag * (collective - m["lagged"])
        e["lift"], e["collective"] = collective * full / K.gravity, collective

    def errors(thrust: Any, yaw: float) -> Any:
        axis = body.inv().apply(-np.array(thrust) / np.linalg.norm(thrust))
        across = np.cross([0.0, 0.0, 1.0], axis)
        sine = np.linalg.norm(across)
        angle = math.atan2(sine, axis[2])
        error = across * (angle / sine if sine > 1e-9 else 1.0)
        error[2] = wrapped(yaw - math.atan2(R[1, 0], R[0, 0])) * max(0.0, R[2, 2])
        return error

    def idle(collective: float) -> None:
        e.update(
            integral=np.zeros(3), drag=np.zeros(2), lagged=0.0, lift=0.0, saturated=0,
            effectiveness=1.0, thrust=np.array([0, 0, -1.0]), error=np.zeros(3), feed=np.zeros(3),
            collective=collective,
        )  # fmt: skip

    if mode == TARGET:
        rate = np.clip(m["spin"] + 2 * wrapped(m["yaw_order"] - m["yaw"]), -K.yaw_rate, K.yaw_rate)
        most = 4 * K.yaw_rate * DT_S
        e["yaw_rate"] = np.clip(rate, m["yaw_rate"] - most, m["yaw_rate"] + most)
        e["yaw"] = wrapped(m["yaw"] + e["yaw_rate"] * DT_S)
        if contact and m["v"][2] > 0:
            idle(K.idle)
            return e
        flying = not touching
        if flying:
            drag = m["drag"] + DT_S / K.drag_lag * (force[:2] - m["drag"])
            e["drag"] = np.clip(drag, -K.drag_limit, K.drag_limit)
            by_thrust()
        slip = m["v"] + K.position * (m["p"] - s["at"]) - s["moves"]
        if flying and not m["saturated"]:
            integral = m["integral"] + K.integral * DT_S * slip
            e["integral"] = np.clip(integral, -K.integral_limit, K.integral_limit)
        wanted = m["a"] + K.velocity * slip + e["integral"] - R[:, :2] @ e["drag"]
        wanted *= [flying, flying, 1.0]
        wanted[2] -= K.gravity
        full, most = K.full * e["effectiveness"], K.most_thrust * K.full * e["effectiveness"]
        up = min(max(-wanted[2], 0.25 * K.gravity), most)
        room = min(math.sqrt(max(0.0, most**2 - up**2)), up * K.slope)
        across = math.hypot(wanted[0], wanted[1])
        if across > room:
            wanted[:2] *= room / across
        wanted[2], e["saturated"] = -up, int(across > 1.01 * room)
        lift(float(np.clip(-wanted @ down / full, 0.02, K.most_thrust)), full)
        e["error"], e["thrust"] = errors(wanted, e["yaw"]), wanted
        e["feed"], e["wanted_yaw"] = R[2] * e["yaw_rate"], e["yaw"]
        return e
    heading = math.atan2(R[1, 0], R[0, 0])
    collective = m["thrust_order"]
    if math.isnan(collective):
        gap = -m["climb"] - s["moves"][2]
        if not landed:
            integral = m["integral"] + [0, 0, K.integral * DT_S * gap]
            e["integral"] = np.clip(integral, -K.integral_limit, K.integral_limit)
        push = K.gravity - K.velocity * gap - e["integral"][2]
        collective = push / max(0.5, R[2, 2]) / full
    if not landed:
        by_thrust()
    lift(float(np.clip(collective, K.idle, K.most_thrust)), full)
    e["error"], e["feed"] = np.zeros(3), np.zeros(3)
    if e["lift"] > 0.2:
        e["feed"] = m["rates"]
        if oriented:
            w, x, y, z = m["q"]
            to = Rotation.from_quat([x, y, z, w]).as_matrix()
            e["thrust"], e["wanted_yaw"] = -to[:, 2], math.atan2(to[1, 0], to[0, 0])
            e["error"] = errors(e["thrust"], e["wanted_yaw"])
    e["yaw"] = e["yaw_order"] = heading
    return e


@pytest.mark.parametrize("mode", [TARGET, ATTITUDE])
def test_a_step_is_what_numpy_makes_of_it(mode: int) -> None:
    rng, loop, saturated = np.random.default_rng(mode), Loop(), 0
    memory = loop.memory
    for _ in range(150):
        some_orders(memory, rng)
        memory.mode, memory.armed = mode, 1
        state, before = some_state(rng), loop.read()
        flags = memory.touching, memory.contact, memory.landed, memory.oriented
        loop.step(state)
        after = expected(mode, before, flags, state)
        for name, value in loop.read().items():
            np.testing.assert_allclose(
                value, after[name], rtol=1e-9, atol=1e-9, equal_nan=True, err_msg=name
            )
        saturated += memory.saturated
        knock = -state["force"][2] - memory.lagged * K.full * memory.effectiveness
        assert memory.knock == pytest.approx(knock)
        assert memory.sink == state["moves"][2]
        descend = before["v"][2] if mode == TARGET else float(memory.lift < 0.9)
        assert memory.descend == descend
        assert memory.pointed == (mode == TARGET)
        told = [loop.orders[f"{kind} {axis}"] for kind in ("error", "feed") for axis in "xyz"]
        assert told == [*memory.error[:], *memory.feed[:]]
        assert loop.orders["collective"] == memory.collective
    assert 15 < saturated < 135 or mode == ATTITUDE


def test_what_is_not_armed_or_has_no_order_idles() -> None:
    rng, loop = np.random.default_rng(3), Loop()
    memory = loop.memory
    for mode, armed in ((NOTHING, 1), (TARGET, 0), (ATTITUDE, 0)):
        some_orders(memory, rng)
        memory.mode, memory.armed, memory.pointed = mode, armed, 1
        state, yaw = some_state(rng), memory.yaw
        loop.step(state)
        assert (memory.collective, memory.pointed) == (K.idle if armed else 0.0, 0)
        assert memory.thrust[:] == [0.0, 0.0, -1.0]
        assert (memory.lift, memory.lagged, memory.effectiveness) == (0.0, 0.0, 1.0)
        assert {*memory.integral, *memory.drag, *memory.error, *memory.feed} == {0.0}
        w, x, y, z = state["turned"]
        R = Rotation.from_quat([x, y, z, w]).as_matrix()
        heading = math.atan2(R[1, 0], R[0, 0])
        assert memory.yaw == pytest.approx(yaw if armed else heading)
        if not armed:
            assert (memory.yaw_order, memory.yaw_rate) == (memory.yaw, 0.0)


@pytest.mark.parametrize(
    ("t", "past_m", "passed"),
    [
        (4.99, 1.0, False), (5.0, 0.0, True), (5.0, -0.01, False), (8.0, -0.01, False),
        (8.01, -0.01, True), (8.01, 1.0, True),
    ],
)  # fmt: skip
def test_a_corner_is_passed_at_its_plane_or_when_it_is_late(
    t: float, past_m: float, passed: bool
) -> None:
    loop, normal = Loop(), np.array([0.48, 0.6, -0.64])
    memory, across = loop.memory, np.array([0.6, -0.48, 0.0])
    memory.t, memory.soon, memory.late = t, 5.0, 8.005
    memory.corner[:], memory.normal[:] = (10.0, -20.0, -30.0), normal.tolist()
    x, y, z = (np.array([10.0, -20.0, -30.0]) + past_m * normal + 7.0 * across).tolist()
    assert loop.passed((x, y, z), (0.0, 0.0, 0.0)) == passed
    # At a reversal there is no plane: it is one across the way that is flown.
    memory.normal[:] = 0.0, 0.0, 0.0
    u, v, w = (3.0 * normal).tolist()
    assert loop.passed((x, y, z), (u, v, w)) == passed


@pytest.mark.parametrize(
    ("before_s", "short_m", "near"),
    [
        (0.019, 0.0, True), (0.021, 0.0, False), (0.0, 0.55, True), (0.0, 0.57, False),
        (-9.0, -5.0, True),
    ],
)  # fmt: skip
def test_a_corner_is_near_where_two_steps_may_reach_it(
    before_s: float, short_m: float, near: bool
) -> None:
    """Two steps at the sum of 3, 4 and 2 m/s are 36 cm, and 20 cm more."""
    loop = Loop()
    memory = loop.memory
    memory.mode, memory.armed, memory.effectiveness = TARGET, 1, 1.0
    memory.soon, memory.t = 5.0, 5.0 - before_s
    memory.corner[:], memory.normal[:] = (10.0, 0.0, -30.0), (1.0, 0.0, 0.0)
    loop.step({
        "at": (10.0 - short_m, 40.0, -60.0), "moves": (3.0, -4.0, 2.0), "force": (0.0, 0.0, -9.8),
        "turned": (1.0, 0.0, 0.0, 0.0),
    })  # fmt: skip
    assert bool(memory.noted & NEAR) == near
