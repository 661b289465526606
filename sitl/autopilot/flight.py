"""What the aircraft is doing: mode, manoeuvre and mission, and what follows what."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from flightdyn.aircraft import Aircraft
from flightdyn.frames import yaw_of
from flightdyn.path import FlightPath
from flightdyn.state import GeodeticPoint, Vector
from sitl.autopilot import manoeuvres as do
from sitl.autopilot import route
from sitl.autopilot.enums import LandedState, Severity
from sitl.autopilot.items import NAVIGATION
from sitl.autopilot.mission import Mission
from sitl.autopilot.modes import Mode, Need, Trigger, transition
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.reporter import Reporter

_SAME_PLACE_M = 2.0  # the guidance's own reference is as good as the estimate within this


class Flight:
    """Mode and manoeuvre of one aircraft.

    Orders return None when they are carried out, or the reason why not. An order for what is
    already being done changes nothing, so that a repeated command repeats nothing.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        parameters: Parameters,
        *,
        home: GeodeticPoint,
        reporter: Reporter,
    ) -> None:
        self.mode = Mode.HOLD
        self.mission = Mission()
        self.home = home
        self.position_ok: Callable[[], bool] = lambda: aircraft.ready
        self.flights = 0
        self.armed_t_ns = 0
        self._aircraft = aircraft
        self._parameters = parameters
        self._report = reporter
        self._ordered_speed_mps: float | None = None
        self._goal_ned_m: Vector | None = None  # of a position order under way
        self._after_mission: Trigger | None = Trigger.DONE
        self._manoeuvre: do.Manoeuvre | None = do.Settle(aircraft)
        self._settling = True

    # --- what is going on -----------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """Whether something is being done that needs simulated time."""
        return self._manoeuvre is not None

    @property
    def landed_state(self) -> LandedState:
        """On the ground, climbing from it, sinking to it, or in the air."""
        if self._aircraft.on_ground:
            return LandedState.ON_GROUND
        if self.mode is Mode.TAKEOFF:
            return LandedState.TAKEOFF
        return LandedState.LANDING if self.mode is Mode.LAND else LandedState.IN_AIR

    @property
    def home_ned_m(self) -> Vector:
        """Home in the aircraft's frame."""
        return self._aircraft.frame.to_ned(
            self.home.lat_deg, self.home.lon_deg, self.home.alt_msl_m
        )

    def not_ready(self) -> str:
        """Why the aircraft cannot be armed; empty if it can."""
        if self.mode is Mode.TERMINATED:
            return "flight was terminated"
        if not self._aircraft.ready:
            return self._aircraft.why_not_ready
        return "" if self.position_ok() else Need.POSITION.value

    def tick(self) -> None:
        """Look after the manoeuvre; after every physics tick."""
        manoeuvre = self._manoeuvre
        if manoeuvre is not None and manoeuvre.tick():
            self._finished()

    # --- orders ---------------------------------------------------------------------------------

    def arm(self) -> str | None:
        """Release the motors."""
        if self._aircraft.armed:
            return None
        reason = self.not_ready()
        if reason:
            return reason
        self._aircraft.arm()
        self.flights += 1
        self.armed_t_ns = self._aircraft.t_ns
        self._report.armed(True)
        return None

    def disarm(self, *, force: bool = False) -> str | None:
        """Stop the motors; in the air only by force, which ends the flight."""
        if not self._aircraft.armed:
            return None
        if not self._aircraft.on_ground:
            return self.terminate("forced disarming in the air") if force else "in the air"
        self._stop_motors()
        if self.mode is not Mode.TERMINATED:
            self._enter(Mode.HOLD, "disarmed", None)
        return None

    def terminate(self, why: str = Trigger.ORDER_TERMINATE.value) -> str | None:
        """Stop the motors wherever the aircraft is."""
        self._stop_motors()
        self._enter(Mode.TERMINATED, why, do.Fall(self._aircraft))
        return None

    def take_off(self, altitude_msl_m: float | None) -> str | None:
        """Climb straight up to an altitude, or to the parameter's height above home."""
        if self.mode is Mode.TAKEOFF and self.moving:
            return None
        height = self._parameters["MIS_TAKEOFF_ALT"]
        altitude = self.home.alt_msl_m + height if altitude_msl_m is None else altitude_msl_m
        here = self._here()
        up = np.array([here[0], here[1], self._aircraft.frame.origin.alt_msl_m - altitude])
        if up[2] > here[2] - 0.5:
            return f"take-off altitude {altitude:.1f} m is not above the aircraft"
        speed = self._parameters["MPC_TKO_SPEED"]
        return self._order(Trigger.ORDER_TAKEOFF, lambda: self._follow([here, up], [speed]))

    def fly_mission(self) -> str | None:
        """Start the mission, or go on with it."""
        if self.mode is Mode.MISSION:
            return None
        return self._order(Trigger.ORDER_MISSION, self._mission_manoeuvre)

    def rewind_mission(self, seq: int) -> str | None:
        """Go on with item `seq`, at once if the mission is being flown."""
        if seq >= max(len(self.mission.items), 1):
            return f"mission has {len(self.mission.items)} items, no item {seq}"
        flying = self.mode is Mode.MISSION
        if not (flying and seq == self.mission.current):
            self.mission.rewind(seq)
            if flying:
                self._manoeuvre = self._mission_manoeuvre()
        self._report.mission_changed()
        return None

    def hold(self, why: str | None = None) -> str | None:
        """Brake and stay."""
        if self.mode is Mode.HOLD and self._goal_ned_m is None:
            return None
        return self._order(Trigger.ORDER_HOLD, self._stop_manoeuvre, why)

    def go_to(self, pos_ned_m: Vector, *, yaw_rad: float | None = None) -> str | None:
        """Fly straight to a position and stay there."""
        goal = np.array(pos_ned_m, dtype=float)
        under_way = self._goal_ned_m
        if under_way is not None and np.array_equal(under_way, goal):
            return None
        return self._order(
            Trigger.ORDER_GOTO, lambda: self._goto_manoeuvre(goal, yaw_rad), goal_ned_m=goal
        )

    def turn_to(self, yaw_rad: float) -> str | None:
        """Turn to a heading on the spot."""
        if self.mode is not Mode.HOLD or self.moving:
            return "the heading can be set only while holding"
        place = self._here()
        return self._order(
            Trigger.ORDER_GOTO,
            lambda: do.Turn(self._aircraft, pos_ned_m=place, yaw_rad=yaw_rad),
        )

    def return_home(self, why: str | None = None) -> str | None:
        """Fly home at a safe height and land."""
        if self.mode is Mode.RETURN:
            return None
        return self._order(Trigger.ORDER_RETURN, self._return_manoeuvre, why)

    def land(self, why: str | None = None) -> str | None:
        """Land here."""
        if self.mode is Mode.LAND:
            return None
        return self._order(Trigger.ORDER_LAND, self._land_manoeuvre, why)

    def change_speed(self, speed_mps: float | None) -> None:
        """Speed for what is being flown and what will be, until disarmed; None for the default."""
        self._ordered_speed_mps = speed_mps
        self.mission.item_speed_mps = None
        if self.mode is Mode.MISSION and self.moving:
            self._manoeuvre = self._mission_manoeuvre()
        elif self.mode is Mode.HOLD and self._goal_ned_m is not None:
            self._manoeuvre = self._goto_manoeuvre(self._goal_ned_m, None)

    def set_home(self, home: GeodeticPoint) -> None:
        """Home is there from now on."""
        self.home = home
        self._report.home_changed()

    # --- transitions ----------------------------------------------------------------------------

    def _order(
        self,
        trigger: Trigger,
        make: Callable[[], do.Manoeuvre],
        why: str | None = None,
        *,
        goal_ned_m: Vector | None = None,
    ) -> str | None:
        if self._settling:
            return "starting up"
        row = transition(self.mode, trigger)
        if row is None:
            return f"not possible in mode {self.mode.name}"
        for need in row.needs:
            if not self._met(need):
                return need.value
        airborne = self._aircraft.armed and not self._aircraft.on_ground
        idle_hold = row.target is Mode.HOLD and not airborne
        self._enter(row.target, why or trigger.value, None if idle_hold else make())
        self._goal_ned_m = goal_ned_m
        return None

    def _met(self, need: Need) -> bool:
        match need:
            case Need.ARMED:
                return self._aircraft.armed
            case Need.ON_GROUND:
                return self._aircraft.on_ground
            case Need.AIRBORNE:
                return not self._aircraft.on_ground
            case Need.MISSION:
                return bool(self.mission.items)
            case Need.POSITION:
                return self.position_ok()

    def _enter(self, mode: Mode, why: str, manoeuvre: do.Manoeuvre | None) -> None:
        self._manoeuvre = manoeuvre
        self._goal_ned_m = None
        self._report.landed_state()
        if mode is not self.mode:
            self.mode = mode
            self._report.mode(mode, why)

    def _finished(self) -> None:
        self._manoeuvre = None
        if self._settling:
            self._settling = False
            self._ready()
        elif self.mode is Mode.MISSION:
            self._mission_ended()
        elif self.mode is Mode.RETURN:
            self._enter(Mode.LAND, Trigger.DONE_LAND_NEXT.value, self._land_manoeuvre())
        elif self.mode is Mode.LAND:
            self._landed()
        else:
            self._follow_up(Trigger.DONE)

    def _follow_up(self, trigger: Trigger) -> None:
        row = transition(self.mode, trigger)
        if row is not None:
            self._enter(row.target, trigger.value, None)

    def _ready(self) -> None:
        if self._aircraft.ready:
            self._report.say(Severity.INFO, "Ready for takeoff")
        else:
            self._report.say(Severity.ERROR, f"Not ready: {self._aircraft.why_not_ready}")

    def _mission_ended(self) -> None:
        after = self._after_mission
        if after is None:
            return  # stays in the mission, at an item without end
        self.mission.finish()
        self._report.mission_changed()
        if after is Trigger.ORDER_RETURN and self.return_home("mission") is None:
            return
        if after is Trigger.DONE_LAND_NEXT:
            self._landed()
        else:
            self._follow_up(Trigger.DONE)

    def _landed(self) -> None:
        self._stop_motors()
        self._follow_up(Trigger.DONE)

    def _stop_motors(self) -> None:
        if self._aircraft.armed:
            self._aircraft.disarm()
            self._ordered_speed_mps = None
            self._report.armed(False)

    # --- manoeuvres -----------------------------------------------------------------------------

    def _here(self) -> Vector:
        """Where paths begin: the point being held, or where the aircraft believes it is."""
        belief = np.asarray(self._aircraft.belief.pos_ned_m)
        held = self._aircraft.cmd_pos_ned_m
        if held is None or self.moving or self._aircraft.on_ground:
            return np.array(belief)
        near = float(np.linalg.norm(held - belief)) < _SAME_PLACE_M
        return np.array(held if near else belief)

    def _limits(self) -> route.Limits:
        p = self._parameters
        return route.Limits(
            cruise_mps=p["MPC_XY_CRUISE"],
            max_speed_mps=p["MPC_XY_VEL_MAX"],
            climb_mps=p["MPC_Z_VEL_MAX_UP"],
            descent_mps=p["MPC_Z_VEL_MAX_DN"],
            takeoff_mps=p["MPC_TKO_SPEED"],
            acceptance_m=p["NAV_ACC_RAD"],
        )

    def _follow(self, points: Sequence[Vector], speeds: Sequence[float]) -> do.Follow:
        limits = self._limits()
        allowed = [
            route.leg_speed(points[i], points[i + 1], speed_mps=speed, limits=limits)
            for i, speed in enumerate(speeds)
        ]
        radii = np.full(len(points), limits.acceptance_m)
        return do.Follow(self._aircraft, FlightPath(np.array(points), np.array(allowed), radii))

    def _stop_manoeuvre(self) -> do.Manoeuvre:
        return do.Stop(self._aircraft, deceleration_mps2=self._parameters["MPC_ACC_HOR"])

    def _speed(self) -> float:
        ordered = self._ordered_speed_mps
        return self._parameters["MPC_XY_CRUISE"] if ordered is None else ordered

    def _goto_manoeuvre(self, goal_ned_m: Vector, yaw_rad: float | None) -> do.Manoeuvre:
        def parts() -> Iterator[do.Manoeuvre]:
            yield self._follow([self._here(), goal_ned_m], [self._speed()])
            if yaw_rad is not None:
                yield do.Turn(self._aircraft, pos_ned_m=goal_ned_m, yaw_rad=yaw_rad)

        return do.Sequence(parts())

    def _return_manoeuvre(self) -> do.Manoeuvre:
        here, home = self._here(), self.home_ned_m
        far = float(np.hypot(*(here - home)[:2])) > self._parameters["RTL_MIN_DIST"]
        ceiling = float(home[2]) - self._parameters["RTL_RETURN_ALT"]
        down = min(float(here[2]), ceiling) if far else float(here[2])
        above_here = np.array([here[0], here[1], down])
        above_home = np.array([home[0], home[1], down])
        return self._follow([here, above_here, above_home], [self._speed(), self._speed()])

    def _land_manoeuvre(self) -> do.Manoeuvre:
        p = self._parameters
        return do.Descend(
            self._aircraft,
            start_ned_m=self._here(),
            ground_down_m=float(self.home_ned_m[2]),
            descent_mps=p["MPC_Z_VEL_MAX_DN"],
            landing_mps=p["MPC_LAND_SPEED"],
            landing_height_m=p["MPC_LAND_ALT2"],
            settle_s=p["COM_DISARM_LAND"],
        )

    def _mission_manoeuvre(self) -> do.Manoeuvre:
        mission = self.mission
        mission.start()
        speed = mission.item_speed_mps
        start = route.Start(
            self._here(),
            on_ground=self._aircraft.on_ground,
            speed_mps=self._ordered_speed_mps if speed is None else speed,
        )
        stages = route.compile_route(
            mission.items,
            first=mission.current,
            start=start,
            frame=self._aircraft.frame,
            home=self.home,
            limits=self._limits(),
        )
        self._after_mission = Trigger.DONE
        self._report.mission_changed()
        return do.Sequence(self._mission_parts(stages))

    def _mission_parts(self, stages: Sequence[route.Stage]) -> Iterator[do.Manoeuvre]:
        for stage in stages:
            match stage:
                case route.Fly(path, reached):
                    yield do.Follow(self._aircraft, path, self._passer(reached))
                case route.Wait(duration_s, seq, reports):
                    if duration_s > 0:
                        yield do.Pause(self._aircraft, duration_s)
                    if reports:
                        self._reached(seq)
                case route.Turn(yaw_rad, relative, seq):
                    now = yaw_of(self._aircraft.belief.q_frd_to_ned) if relative else 0.0
                    yield do.Turn(self._aircraft, pos_ned_m=self._here(), yaw_rad=now + yaw_rad)
                    self._reached(seq)
                case route.Land(seq):
                    yield self._land_manoeuvre()
                    self._reached(seq)
                    self._after_mission = Trigger.DONE_LAND_NEXT
                    return
                case route.GoHome(seq):
                    self._reached(seq)
                    self._after_mission = Trigger.ORDER_RETURN
                    return
                case route.Loiter():
                    self._after_mission = None
                    return

    def _passer(self, reached: Sequence[Sequence[int]]) -> Callable[[int], None]:
        def passed(point: int) -> None:
            for seq in reached[point]:
                self._reached(seq)

        return passed

    def _reached(self, seq: int) -> None:
        self.mission.reached(seq)
        self._report.reached(seq, place=self.mission.items[seq].command in NAVIGATION)
