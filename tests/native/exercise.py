"""Everything that the libraries do, on data from seeds; prints a digest of what comes out."""

import ctypes
import hashlib
import socket
import sys
from dataclasses import replace

import numpy as np
from firmware_stand_ins import ArduPilotStandIn, Px4StandIn, plant

from fl.config import ConvNetConfig
from fl.data.dataset import Split
from fl.radio.channel import CHANNEL_PRESETS
from fl.radio.city import Building, City
from fl.radio.per_grid import PerGrid
from fl.radio.place import LinkTerms, PlacedRadio
from fl.training.local import LocalSettings, LocalTask, scaling_of
from fl.training.networks import make_network
from flightdyn.config import LimitsConfig
from flightdyn.frames import quaternion_from_euler
from flightdyn.guidance.path import FlightPath, brake_and_go, passing_times, plan_path
from flightdyn.native.library import (
    ATTITUDE,
    NOTHING,
    TARGET,
    TRACK,
    Guide,
    Increments,
    Innovations,
    Loop,
    Probe,
    Strapdown,
    Transition,
)
from flightdyn.native.ticks import Gauges, Imu, Inner
from mission.base.airspace import Airspace
from mission.planner import improving
from mission.planner.certified import CertifiedPlanner
from mission.planner.config import PlannerConfig
from mission.planner.factory import make_planner
from mission.planner.fleet.joint import first_plans
from mission.planner.fleet.team import team_of
from mission.planner.flyable import foresee_round
from mission.planner.improving import fitted, serving_fewer
from mission.planner.limits import RoundLimits
from mission.planner.native.crews import search_orders
from mission.planner.native.library import Goal
from mission.planner.performance import Performance
from mission.planner.problem import RoundProblem, Start
from sitl.firmware.ardupilot import RATE_HZ, ArduPilotBridge
from sitl.firmware.native import library as bridge
from sitl.firmware.px4 import Px4Bridge

improving._CHANGES = 1000  # at random: of the usual 40,000 each is the same code
digest = hashlib.sha256()
rng = np.random.Generator(np.random.PCG64(3))


TURNS = np.array([(np.cos(a), np.sin(a)) for a in np.arange(5) * 1.2566])


def contents(structure, *names):
    """What the fields have, by their names: wherever they lie."""
    for name in names or sorted(name for name, _ in structure._fields_):
        field, value = getattr(type(structure), name), getattr(structure, name)
        if isinstance(value, ctypes.Structure):
            contents(value)
        else:
            digest.update(bytes(structure)[field.offset : field.offset + field.size])


def learn(name, shape, dtype, count, convnet=None):
    net = make_network(name, convnet=convnet, image_shape=shape, classes=10)
    pixels = rng.integers(0, 256, (count, *shape)).astype(dtype)
    split = Split(pixels, rng.integers(0, 10, count))
    scaling, model = scaling_of(split), net.initial(rng)
    correction = rng.normal(0.0, 1e-3, model.shape).astype(np.float32)
    for extra in (None, correction):
        settings, seeded = LocalSettings(0.05, 0.9, 0.1, 20, 1), np.random.default_rng(1)
        task = LocalTask(split, np.arange(count), scaling, model, settings, seeded, extra)
        result = net.train(task)
        digest.update(result.model.tobytes())
        digest.update(np.float64(result.loss).tobytes())
        digest.update(net.correct_per_class(split, result.model, scaling=scaling).tobytes())


def plan_alone(channel, devices, steps, per_step, side_m=800.0, **asked):
    problem = RoundProblem(
        rng.uniform(0.0, side_m, (devices, 2)), rng.uniform(0.5, 1.5, devices),
        (Start(rng.uniform(0.0, side_m, 2), 0.875 * side_m),), steps, per_step,
        CHANNEL_PRESETS[channel],
    )  # fmt: skip
    made = CertifiedPlanner(**{"max_nodes": 60, **asked}).plan(problem)
    digest.update(made.waypoints_m.tobytes())
    digest.update(made.schedule.tobytes())
    digest.update(np.array([made.value, made.upper_bound, made.nodes]).tobytes())


def plan_within_limits(**more):
    """What a plan under every limit is, and what it takes."""
    flying = Performance(20.0, 5.0, LimitsConfig(), 0.9, (3.0, -1.0), 1.1)
    start = Start(np.full(2, 400.0), 700.0, RoundLimits(flying, 60.0, 9e3))
    problem = RoundProblem(
        rng.uniform(0.0, 800.0, (12, 2)), rng.uniform(0.5, 1.5, 12), (start,), 8, 3,
        CHANNEL_PRESETS["suburban+10dB"], upload_s=rng.uniform(0.0, 4.0, 12),
        ready_in_s=rng.uniform(0.0, 20.0, 12), **more,
    )  # fmt: skip
    way = np.vstack((problem.start_m, rng.uniform(0.0, 800.0, (7, 2))))
    made = fitted(problem, way)
    assert made is not None
    everybody = np.ones_like(made.schedule)
    fewer = serving_fewer(problem, replace(made, schedule=everybody))
    digest.update(np.packbits(fewer.schedule).tobytes())
    taken = foresee_round(problem, made)
    digest.update(made.route_m.tobytes())
    digest.update(np.packbits(made.schedule).tobytes())
    digest.update(np.array([made.value, *taken.arrived_s, taken.energy_j]).tobytes())
    followed = flying.follow(way, [2.0, *(0.0 for _ in way[2:]), 3.0], 5.0, step_s=0.2, count=400)
    digest.update(followed.tobytes())
    evaluation = problem.as_judged.judged(made.as_candidate)
    digest.update(np.array([evaluation.share, *evaluation.begins_s]).tobytes())
    planned = make_planner(PlannerConfig(max_nodes=60)).plan(problem)
    digest.update(planned.waypoints_m.tobytes())
    digest.update(np.array([planned.value, planned.upper_bound]).tobytes())


def plan_on_grid(devices, steps, per_step, **more):
    """A plan by what is believed of each place."""
    grid = PerGrid(rng.uniform(0.0, 1.0, (devices, 9, 8)) ** 2, (0.0, 0.0), 100.0)
    problem = RoundProblem(
        rng.uniform(0.0, 800.0, (devices, 2)), rng.uniform(0.5, 1.5, devices),
        (Start(rng.uniform(0.0, 800.0, 2), 500.0),), steps, per_step, CHANNEL_PRESETS["suburban"],
        per_grid=grid, **more,
    )  # fmt: skip
    made = make_planner(PlannerConfig(max_nodes=60)).plan(problem)
    digest.update(made.waypoints_m.tobytes())
    digest.update(np.array([made.value, made.upper_bound]).tobytes())


def plan_around():
    """Ways around areas, through places of which some are in them."""
    rings = [rng.uniform(50.0, 90.0, (5, 1)) * TURNS + rng.uniform(0.0, 600.0, 2) for _ in range(6)]
    airspace = Airspace(tuple(rings), margin_m=3.0)
    places = rng.uniform(0.0, 600.0, (40, 2))
    route, at = airspace.route(places)
    digest.update(route.tobytes())
    digest.update(at.tobytes())
    digest.update(airspace.away(places).tobytes())
    digest.update(airspace.moved(places).tobytes())


def plan_together(starts, devices, steps, per_step):
    """A plan of several aircraft, which are not alike."""
    problem = RoundProblem(
        rng.uniform(0.0, 800.0, (devices, 2)), rng.uniform(0.5, 1.5, devices),
        tuple(Start(rng.uniform(0.0, 800.0, 2), rng.uniform(300.0, 500.0)) for _ in range(starts)),
        steps, per_step, CHANNEL_PRESETS["suburban"],
    )  # fmt: skip
    made = make_planner(PlannerConfig(max_nodes=60)).plan(problem)
    for path in made.paths:
        digest.update(path.waypoints_m.tobytes())
    digest.update(np.packbits(made.schedule).tobytes())
    team = team_of([problem.alone(a) for a in range(starts)])
    found = search_orders(
        team.joint, plan=first_plans(team)[-1], goal=Goal(1e-4, 500, max_open=500)
    )
    digest.update(np.array([made.value, made.upper_bound, found.value, found.bound]).tobytes())


def radio(environment):
    """Gains of paths among buildings, and the packet error rates that follow."""
    corners = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 30.0], [0.0, 30.0]])
    houses = [Building((corners + at,), float(h)) for *at, h in rng.uniform(5.0, 90.0, (30, 3)) * 8]
    city = City(
        houses, rng.uniform(0.0, 800.0, (6, 2)), device_height_m=1.5, carrier_hz=2.4e9,
        environment=environment, walls="high-loss", rng=rng,
    )  # fmt: skip
    device, places = rng.integers(0, 6, 500), rng.uniform(0.0, 800.0, (500, 3)) / (1.0, 1.0, 8.0)
    digest.update(city.gain_db(device, places).tobytes())
    placed = PlacedRadio(city, LinkTerms(10.0, 1e6, 7.0, 10.0, 3.0))
    digest.update(placed.per(device, places).tobytes())


def hil(ticks):
    """PX4's stream, in which anything may come at any time."""
    ours, theirs = socket.socketpair()
    link = bridge.Hil(socket=ours.fileno())
    at = ctypes.addressof(link)
    for tick in range(1, ticks):
        link.world.t_ns = 1000 * tick
        link.sensor.sample[:] = rng.normal(0.0, 3.0, 6)
        bridge.hil_send(at, rng.bytes(36) if tick % 5 == 0 else None)
        digest.update(theirs.recv(65536))
        junk = bytearray(rng.bytes(int(rng.integers(1, 700))))
        for marker in rng.integers(0, len(junk), 5):
            junk[marker] = 0xFD
        theirs.sendall(junk)
        bridge.hil_wait(at, False)
        contents(link, "sensor", "motors", "sent_us", "answered_us")
    theirs.close()
    bridge.hil_wait(at, False)
    contents(link, "error")


def json(ticks):
    """ArduPilot's datagrams, of whatever length."""
    ours, theirs = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    for end in (ours, theirs):
        end.bind(("127.0.0.1", 0))
    ours.setblocking(False)
    theirs.connect(ours.getsockname())
    host, port = theirs.getsockname()
    peer = int.from_bytes(socket.inet_aton(host), sys.byteorder) << 16 | socket.htons(port)
    link = bridge.Json(socket=ours.fileno(), peer=peer)
    at = ctypes.addressof(link)
    for _ in range(ticks):
        numbers = rng.normal(0.0, 10.0 ** rng.integers(-9, 300), 21)
        link.sample[:], link.state[:], link.errors[:] = numbers[:6], numbers[6:15], numbers[15:]
        link.answered = -1
        bridge.json_send(at)
        digest.update(theirs.recv(65536))
        theirs.send(rng.bytes(int(rng.integers(1, 300))))
        theirs.send(b"\x1a\x48" + rng.bytes(38))
        for _ in range(2):
            digest.update(bytes((bridge.json_wait(at),)))
        contents(link, "sample", "state", "errors", "motors", "count", "answered", "asked", "came")


def under_firmwares(ticks):
    """Ticks that a firmware asks for, one by one."""
    px4 = Px4Bridge(plant(), port=0)
    px4.open()
    client = Px4StandIn(px4.port)
    for _ in range(ticks):
        client.control(px4.plant.t_ns // 1000, (0.7, 0.6, 0.7, 0.65))
        while not px4.run(1):
            pass
    ardupilot = ArduPilotBridge(plant(RATE_HZ), port=0)
    ardupilot.open()
    asking = ArduPilotStandIn(ardupilot.port)
    for tick in range(ticks):
        asking.ask(tick, (1700, 1600, 1700, 1650))
        while not ardupilot.run(1):
            pass
        asking.answer()
    for end in (client, asking, px4, ardupilot):
        end.close()
    for flown in (px4.plant, ardupilot.plant):
        digest.update(np.array([*flown.truth.pos_ned_m, *flown.truth.vel_ned_mps]).tobytes())


def fly():
    """Every order of the guidance where IMU samples lead to, and the filter's matrices."""
    earth, dt = (9.81, 5e-5, -5e-5), 0.004
    increments, carried = Increments(3), Strapdown(earth, most=3)
    carried.place((0.0, 0.0, -30.0), (1.0, 0.0, 0.0), quaternion_from_euler(0.1, -0.2, 0.7))
    carried.correct((0.01, -0.02, 0.003), (0.1, 0.0, -0.2))
    corners = np.array([(0, 0, -30), (60, 0, -30), (60, 50, -32), (20, 50, -32)], dtype=float)
    path = FlightPath(corners, np.full(3, 12.0), np.full(4, 5.0))
    trajectory, _ = plan_path(path, LimitsConfig())
    digest.update(np.array(passing_times(path, LimitsConfig())).tobytes())
    joined = brake_and_go(
        (0.0, 0.0, -30.0), (9.0, 2.0, 0.0), goal=(5.0, 5.0, -40.0), limits=LimitsConfig()
    )
    digest.update(np.array(joined.at(joined.end_s / 2)).tobytes())
    gains = {
        "dt": 0.02, "gravity": 9.81, "full": 41.5, "slope": 1.7, "idle": 0.05, "position": 1.6,
        "velocity": 4.5, "integral": 2.5, "integral_limit": 6.0, "lead": 0.16, "drag_lag": 0.1,
        "drag_limit": 12.0, "thrust_lag": 0.25, "motor_lag": 0.06, "most_thrust": 0.9,
        "yaw_rate": 1.0,
    }  # fmt: skip
    told: list[float] = []
    axes = [told.append] * 3
    inner = Inner(axes, axes, axes, told.append, dt_s=dt)
    guide = Guide(gains, inner)
    guide.track(trajectory.pieces)
    memory = guide.memory
    memory.armed = memory.course = memory.path = True
    memory.effectiveness = 1.0
    memory.rate = memory.smooth_rate = memory.room = 1.0
    for step in range(2000):
        memory.mode = (TRACK, TRACK, TARGET, ATTITUDE, NOTHING)[step // 100 % 5]
        memory.oriented, memory.q[0] = True, 1.0
        memory.thrust_order = float("nan") if step % 2 else 0.4
        samples = rng.normal(0.0, 1.0, (5, 6)) - (0, 0, 0, 0, 0, 9.81)
        increments.add(samples.ravel().tolist(), dt_s=dt)
        carried.carry(increments, 0, increments.count)
        if increments.count == 3:
            increments.drop(3)
            place, speed, (w, x, y, z) = memory.p, memory.v, carried.numbers[6:]
            carried.place(
                (place[0], place[1], place[2]), (speed[0], speed[1], speed[2]), (w, x, y, z)
            )
        guide.step(carried)
        digest.update(np.array([*carried.numbers, *carried.gained, *carried.downs(1)]).tobytes())
        contents(memory)
    memory.mode = TRACK
    imu = Imu(Gauges([(rng.standard_normal, 0.1, 0.3)] * 6), lambda: rng.normal(size=(50, 6)))
    probe = Probe(Gauges([(rng.standard_normal, 0.1, 0.3)]), every=3)
    ahead = Strapdown(earth, most=1)
    loop = Loop(imu, inner, carried, interval=5, dt_s=dt, ahead=ahead, probe=probe)
    memory.soon = 0.0  # the corner at the origin is near from time to time
    for _ in range(200):
        increments.drop(increments.count)
        digest.update(np.array([loop.fly(dict, 12, increments, guide), *carried.numbers]).tobytes())
        digest.update(np.array([*probe.take(), guide.passed((1, 2, 3), (4, 5, 6))]).tobytes())
        contents(memory)
    digest.update(np.array(told).tobytes())
    matrix, noise = rng.normal(size=(8, 22)), np.eye(8)
    innovations, root = Innovations(matrix, noise), rng.normal(size=(22, 22))
    innovations.residual[:] = rng.normal(size=8)
    stds, squares = innovations.measure(root * root.T + 40 * np.eye(22))
    digest.update(np.array([*stds, *squares]).tobytes())
    transition = np.zeros((22, 22))
    Transition(transition).write((0.5, 0.5, -0.5, 0.5), (1.0, 2.0, 3.0), 0.2)
    digest.update(transition.tobytes())


hil(300)
json(300)
under_firmwares(60)
learn("lenet", (12, 12, 3), np.uint8, 30)
learn("lenet", (9, 11, 1), np.float32, 21)
learn("mcmahan", (4, 5, 1), np.uint8, 17)
learn("convnet", (9, 8, 2), np.uint8, 18, ConvNetConfig(channels=(5, 3, 6), hidden=(7, 9)))
learn("convnet", (3, 4, 1), np.float32, 18, ConvNetConfig(channels=(), hidden=()))
plan_alone("suburban", 12, 8, 3)
plan_alone("high-rise", 9, 4, 1)
plan_alone("suburban+30dB", 11, 5, 3)
plan_alone("suburban+10dB", 60, 3, 4)
plan_alone("suburban+10dB", 45, 10, 2)
plan_alone("suburban", 18, 7, 2, 400.0)  # more stops than steps
plan_alone("suburban", 5, 3, 2, gap=1e-5, max_nodes=300)  # to squares that are not quartered
plan_together(2, 7, 4, 1)
plan_together(3, 9, 3, 2)
plan_on_grid(7, 5, 2)
plan_on_grid(4, 3, 1)
plan_around()
plan_within_limits()
plan_within_limits(airspace=Airspace((np.array([[450.0, 300.0], [500, 300], [500, 500]]),)))
for channel in CHANNEL_PRESETS.values():
    digest.update(channel.per(np.r_[np.linspace(0.0, 4e3, 4001), np.inf]).tobytes())
    digest.update(channel.per(30.0, np.array([-1.0, 0.0, 0.5, 4e3])).tobytes())
for environment in ("UMi", "UMa"):
    radio(environment)
fly()
sys.stdout.write(digest.hexdigest())
