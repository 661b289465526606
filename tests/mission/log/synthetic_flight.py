"""Flights made up for tests of the log: a point mass that follows its plan imperfectly."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from one_aircraft import one_path, round_problem

from fl.radio.channel import CHANNEL_PRESETS, average_per
from fl.radio.city import Building
from flightdyn.state import BatteryState, GeodeticPoint, GnssFix, Innovation, Kinematics
from mission.base.area import Area
from mission.log.records import UNKNOWN_ROUND, RoundRecord, UplinkRecord
from mission.log.sink import Sink
from mission.log.tables import Table
from mission.log.values import Devices, Zone
from mission.log.writer import FlightLog
from mission.planner.plan import RoundPlan
from mission.planner.problem import RoundProblem
from sitl.observer import VehicleEvent, VehicleSample

Floats = NDArray[np.float64]

HALL = Building((np.array([[90.0, 90.0], [110.0, 90.0], [110.0, 110.0]]),), 12.0)
HOME = GeodeticPoint(43.6145, 7.0715, 130.0)
AREA = Area.at((800.0, 800.0), (400.0, 300.0), HOME, buildings=(HALL,))
CHANNEL = CHANNEL_PRESETS["suburban"]
SPEED_MPS = 20.0
CONFIG = b"seed = 1\n[vehicle.aircraft.wind]\nspeed_mps = 4.5\n"
DT_NS = 100_000_000


def devices(rng: np.random.Generator) -> Devices:
    names = ("digits",) * 6 + ("colour-shapes",) * 6
    return Devices(rng.uniform((0, 0), AREA.size_m, (len(names), 2)), names)


@dataclass
class PointMass:
    """Flies to points with limited acceleration; belief is truth plus slow noise."""

    rng: np.random.Generator
    t_ns: int
    pos_m: Floats  # area x, y, height
    vel_mps: Floats
    bias_m: Floats

    def sample(self, *, mode: str = "mission", battery: float = 1.0) -> VehicleSample:
        truth, belief = self.kinematics()
        gnss = None
        if self.t_ns % (2 * DT_NS) == 0:
            noise = self.rng.normal(0.0, 1.0, 3)
            gnss = GnssFix(self.t_ns, truth.pos_ned_m + noise, truth.vel_ned_mps, 0.9, 1.5, 0.1, 14)
        state = BatteryState(22.2 * (0.9 + 0.1 * battery), 31.0, 9000 * (1 - battery), battery)
        return VehicleSample(
            self.t_ns, truth, belief, gnss, state, mode, armed=True,
            wind_ned_mps=np.array([3.0, 0.0, 0.5]) + self.rng.normal(0.0, 0.3, 3),
            innovations=() if gnss is None else self.innovations(),
            control=np.array(
                [[self.t_ns, *belief.q_frd_to_ned, *[0.0] * 3, *belief.q_frd_to_ned, *[0.0] * 19]]
            ),
        )  # fmt: skip

    def innovations(self) -> tuple[Innovation, ...]:
        """Of the size that is expected, but for a heading half a minute after the start."""
        found = []
        for kind, axes in (("gnss position", 3), ("baro", 1), ("heading", 1)):
            values = self.rng.normal(0.0, 1.0, axes)
            if kind == "heading" and self.t_ns == 300 * DT_NS:
                values += 9.0
            nis = float(values @ values)
            found.append(
                Innovation(self.t_ns, kind, tuple(values.tolist()), (1.0,) * axes, nis, 21.0)
            )
        return tuple(found)

    def kinematics(self) -> tuple[Kinematics, Kinematics]:
        yaw = np.arctan2(self.vel_mps[0], self.vel_mps[1])
        q = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
        vel = np.array([self.vel_mps[1], self.vel_mps[0], -self.vel_mps[2]])
        still = np.zeros(3)
        truth, belief = (
            Kinematics(self.t_ns, np.append(AREA.to_ned(at[:2], 0.0)[:2], -at[2]), vel, q, still)
            for at in (self.pos_m, self.pos_m + self.bias_m)
        )
        return truth, belief

    def step_to(self, target_m: Floats, speed_mps: float) -> None:
        dt = DT_NS / 1e9
        want = target_m - self.pos_m
        away = float(np.linalg.norm(want))
        speed = min(speed_mps, np.sqrt(2 * 4.0 * away))
        change = want / max(away, 1e-9) * speed - self.vel_mps
        limit = 5.0 * dt
        size = float(np.linalg.norm(change))
        self.vel_mps = self.vel_mps + change * min(1.0, limit / max(size, 1e-9))
        self.pos_m = self.pos_m + self.vel_mps * dt
        self.bias_m = self.bias_m * 0.98 + self.rng.normal(0.0, 0.08, 3)
        self.t_ns += DT_NS


def plan_round(
    world: Devices, start_m: Floats, order: Sequence[int]
) -> tuple[RoundProblem, RoundPlan]:
    """A path over some devices; each is served at its waypoint, with a neighbour."""
    steps = len(order) + 1
    importance = np.where(np.arange(len(world.pos_m)) % 3 == 0, 0.25, 0.1)
    waypoints = np.vstack((start_m, world.pos_m[list(order)]))
    schedule = np.zeros((steps, len(world.pos_m)), dtype=bool)
    for step, device in enumerate(order, start=1):
        schedule[step, device] = True
    problem = round_problem(world.pos_m, importance, start_m, steps, 3, 800.0, CHANNEL)
    per = average_per(CHANNEL, np.linalg.norm(waypoints[:, None] - world.pos_m, axis=-1))
    value = float((schedule * (1 - per) * importance).sum())
    return problem, one_path(waypoints, schedule, value, value * 1.1)


@dataclass(frozen=True)
class Fixed:
    """A made-up run: what was handed to the writers."""

    world: Devices
    problems: list[RoundProblem]
    plans: list[RoundPlan]
    samples: list[VehicleSample]
    rounds: list[RoundRecord]
    uplinks: list[UplinkRecord]
    log: Path


def fly(folder: Path, *, rounds: int = 3, seed: int = 1, serves: bool = True) -> Fixed:
    """`fly_anew`, once for all tests of a process that ask for the same: the files are copied."""
    made, files = _flown(rounds, seed, serves)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return replace(made, log=folder / made.log.name)


@cache
def _flown(rounds: int, seed: int, serves: bool) -> tuple[Fixed, dict[str, bytes]]:
    with TemporaryDirectory() as folder:
        made = fly_anew(Path(folder), rounds=rounds, seed=seed, serves=serves)
        return made, {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def fly_anew(
    folder: Path,
    *,
    rounds: int = 3,
    seed: int = 1,
    mirrors: Sequence[Sink] = (),
    fence: Sequence[Zone] = (),
    serves: bool = True,
) -> Fixed:
    """Write a whole made-up run into `folder`: log and tables; it serves those it passes."""
    rng = np.random.default_rng(seed)
    world = devices(rng)
    path = folder / "flight.mcap"
    made = Fixed(world, [], [], [], [], [], path)
    drone = PointMass(rng, 0, np.array([*AREA.home_m, 0.0]), np.zeros(3), np.zeros(3))
    with (
        FlightLog(path, area=AREA, devices=world, fence=fence, mirrors=mirrors) as log,
        Table(folder / "rounds.csv", RoundRecord, communities=world.communities) as round_table,
        Table(folder / "uplinks.csv", UplinkRecord) as uplink_table,
    ):
        log.metadata("run", {"seed": str(seed)})
        log.attach("config.toml", "application/toml", CONFIG)
        log.note("take-off")
        for sample in _climb(drone):
            made.samples.append(sample)
            log.sampled(sample)
        for index in range(1, rounds + 1):
            _round(drone, index, made, log, serves=serves)
            log.round(made.rounds[-1])
            round_table.extend([made.rounds[-1]])
            uplink_table.extend(u for u in made.uplinks if u.round == index)
    return made


def _climb(drone: PointMass) -> Iterator[VehicleSample]:
    up = np.array([*AREA.home_m, CHANNEL.altitude_m])
    yield drone.sample(mode="takeoff")
    while np.linalg.norm(drone.pos_m - up) > 0.5:
        drone.step_to(up, 4.0)
        yield drone.sample(mode="takeoff")


def _round(drone: PointMass, index: int, made: Fixed, log: FlightLog, *, serves: bool) -> None:
    world, rng = made.world, drone.rng
    start = (drone.pos_m + drone.bias_m)[:2]
    order = _walk(world.pos_m, start, 850.0, rng)
    problem, plan = plan_round(world, start, order)
    if not serves:
        plan = replace(plan, schedule=np.zeros_like(plan.schedule), value=0.0)
    made.problems.append(problem)
    made.plans.append(plan)
    start_ns, reached = drone.t_ns, {}
    log.plan(start_ns, index, problem, plan, speed_mps=SPEED_MPS)
    flown = 0.0
    for step, waypoint in enumerate(plan.waypoints_m):
        target = np.array([*waypoint, CHANNEL.altitude_m])
        last = step == len(plan.waypoints_m) - 1
        while np.linalg.norm(drone.pos_m + drone.bias_m - target) > (0.5 if last else 6.0):
            before = drone.pos_m
            drone.step_to(target - drone.bias_m, SPEED_MPS)
            flown += float(np.linalg.norm((drone.pos_m - before)[:2]))
            made.samples.append(drone.sample(battery=1 - drone.t_ns / 1.2e12))
            log.sampled(made.samples[-1])
        truth, belief = drone.kinematics()
        reached[step] = drone.t_ns, drone.pos_m, drone.pos_m + drone.bias_m
        log.happened(
            VehicleEvent(drone.t_ns, "reached", f"reached item {step}", truth, belief, seq=step)
        )
    records = _uplinks(index, world, problem, plan, reached, rng)
    made.uplinks.extend(records)
    log.uplinks(records)
    gain = 1 - math.exp(-index / 4)
    accuracy = {"digits": 0.35 + 0.6 * gain, "colour-shapes": 0.15 + 0.5 * gain}
    cov = {"digits": 0.9 * (1 - gain), "colour-shapes": 1.1 - 0.6 * gain}
    log.learning(index, accuracy=accuracy, cov=cov, loss={"digits": 0.4, "colour-shapes": 1.2})
    made.rounds.append(
        replace(
            UNKNOWN_ROUND,
            round=index,
            start_t_s=start_ns / 1e9,
            duration_s=(drone.t_ns - start_ns) / 1e9,
            plan_objective=plan.value,
            est_objective=sum(u.importance * (1 - u.est_per) for u in records),
            true_objective=sum(u.importance * (1 - u.true_per) for u in records),
            upper_bound=plan.upper_bound,
            plan_path_m=plan.path_m,
            flown_path_m=flown,
            budget_used_m=flown + (made.rounds[-1].budget_used_m if made.rounds else 0.0),
            scheduled=len(records),
            delivered=sum(u.delivered for u in records),
            battery_remaining=1 - drone.t_ns / 1.2e12,
            accuracy=accuracy,
            cov=cov,
        )
    )


def _walk(points: Floats, start: Floats, budget_m: float, rng: np.random.Generator) -> list[int]:
    order: list[int] = []
    here, left = start, budget_m
    for device in rng.permutation(len(points)):
        away = float(np.linalg.norm(points[device] - here))
        if away <= left:
            order.append(int(device))
            here, left = points[device], left - away
    return order


def _uplinks(
    index: int,
    world: Devices,
    problem: RoundProblem,
    plan: RoundPlan,
    reached: dict[int, tuple[int, Floats, Floats]],
    rng: np.random.Generator,
) -> list[UplinkRecord]:
    records = []
    for step, device in np.argwhere(plan.schedule[0]):
        t_ns, true, est = reached[int(step)]
        waypoint = plan.waypoints_m[step]

        def per(at: Floats, device: int = int(device)) -> float:
            return float(average_per(CHANNEL, np.linalg.norm(at[:2] - world.pos_m[device])))

        records.append(
            UplinkRecord(
                index, int(device), world.community[device], int(step), t_ns / 1e9,
                float(waypoint[0]), float(waypoint[1]),
                float(est[0]), float(est[1]), float(est[2]),
                float(true[0]), float(true[1]), float(true[2]),
                per(waypoint), per(est), per(true),
                float(problem.importance[device]), bool(rng.random() >= per(true)),
            )
        )  # fmt: skip
    return records
