"""Health monitoring: snapshots for telemetry, and reports of changes."""

import math

import numpy as np
from pymavlink.dialects.v20 import common as mav

from flightdyn.aircraft import Aircraft
from sitl.autopilot.codec.instruments import DeferredValues, Snapshot
from sitl.autopilot.failsafe import Cause, Failsafes
from sitl.autopilot.flying.flight import Flight
from sitl.autopilot.flying.modes import Mode
from sitl.autopilot.flying.orbit import Orbit
from sitl.autopilot.guard import Guard
from sitl.autopilot.reporter import Reporter

_PRESENT = (
    mav.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mav.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mav.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mav.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mav.MAV_SYS_STATUS_SENSOR_GPS
    | mav.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
    | mav.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | mav.MAV_SYS_STATUS_SENSOR_YAW_POSITION
    | mav.MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
    | mav.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
    | mav.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | mav.MAV_SYS_STATUS_AHRS
    | mav.MAV_SYS_STATUS_SENSOR_BATTERY
    | mav.MAV_SYS_STATUS_PREARM_CHECK
)
_POSITION_CONTROL = mav.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
_CHARGE_STATES = {
    Cause.BATTERY_LOW: mav.MAV_BATTERY_CHARGE_STATE_LOW,
    Cause.BATTERY_CRITICAL: mav.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    Cause.BATTERY_EMERGENCY: mav.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
}
_NEEDS_GNSS = mav.MAV_SYS_STATUS_SENSOR_GPS | _POSITION_CONTROL
_ALIGNED = (
    mav.MAV_SYS_STATUS_AHRS | _POSITION_CONTROL | mav.MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
)


class Monitor:
    """Watches the aircraft in simulated time and describes it for telemetry."""

    def __init__(
        self, aircraft: Aircraft, flight: Flight, *, guard: Guard, reporter: Reporter
    ) -> None:
        self._aircraft = aircraft
        self._flight = flight
        self._guard = guard
        self._report = reporter
        self._landed = mav.MAV_LANDED_STATE_UNDEFINED
        self._limited = False
        self._told = 0  # of the news of faults

    def watch(self) -> None:
        """Report changes of GNSS, faults and landed state; call a few times a simulated second."""
        self._guard.look_for_gnss()
        self.watch_faults()
        self._flight.notice_crash()
        landed = self._flight.landed_state
        if self._flight.airborne:
            self._aircraft.faults.happened("take-off")
        if landed != self._landed:
            if self._flight.airborne and self._landed == mav.MAV_LANDED_STATE_ON_GROUND:
                self._flight.took_off_t_ns = self._aircraft.t_ns
            elif self._flight.took_off_t_ns and landed == mav.MAV_LANDED_STATE_ON_GROUND:
                self._flight.landed_t_ns = self._aircraft.t_ns
            self._landed = landed
            self._report.nudge(mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
        limited = self._aircraft.progress.speed_limited
        if limited is not self._limited:
            self._limited = limited
            if limited:
                self._report.say("Ordered speed cannot be held")

    def watch_faults(self) -> None:
        """Tell of faults that have begun or ended."""
        news = self._aircraft.faults.news
        while self._told < len(news):
            self._told += 1
            self._report.say(news[self._told - 1][1], kind="fault")

    def snapshot(self, failsafes: Failsafes, orbit: Orbit | None, booted_ns: int) -> Snapshot:
        """The values that telemetry messages are made from, at this instant."""
        low = [state for cause, state in _CHARGE_STATES.items() if failsafes.present(cause)]
        aircraft, flight = self._aircraft, self._flight
        belief, truth = aircraft.belief, aircraft.truth
        fix, fenced = self._guard.gnss(), self._guard.fenced
        return Snapshot(
            t_ns=aircraft.t_ns,
            booted_ns=booted_ns,
            belief=belief,
            position=aircraft.frame.to_geodetic(np.asarray(belief.pos_ned_m)),
            truth=truth,
            true_position=aircraft.frame.to_geodetic(np.asarray(truth.pos_ned_m)),
            origin=aircraft.frame.origin,
            home=self._guard.home,
            home_ned_m=self._guard.home_ned_m,
            home_yaw_rad=self._guard.home_yaw_rad,
            gnss=fix,
            gnss_position=None if fix is None else aircraft.frame.to_geodetic(fix.pos_ned_m),
            battery=aircraft.battery,
            charge_state=max(low, default=mav.MAV_BATTERY_CHARGE_STATE_OK),
            custom_mode=flight.mode.custom_mode,
            armed=aircraft.armed,
            system_state=self._system_state(failsafes),
            landed_state=flight.landed_state,
            sensors_present=_PRESENT | (mav.MAV_SYS_STATUS_GEOFENCE if fenced else 0),
            sensors_healthy=self._healthy(failsafes, gnss=fix is not None),
            armed_t_ns=flight.armed_t_ns,
            took_off_t_ns=flight.took_off_t_ns,
            landed_t_ns=flight.landed_t_ns,
            flights=flight.flights,
            mission=flight.mission.message(in_mission_mode=flight.mode is Mode.MISSION),
            read_deferred=lambda: self._deferred_values(orbit),
        )

    def _deferred_values(self, orbit: Orbit | None) -> DeferredValues:
        aircraft = self._aircraft
        instruments, frame = aircraft.instruments(), aircraft.frame
        to = instruments.setpoint
        ratios = {i.kind: i.ratio for i in aircraft.innovations_after(-(2**63))}
        circle = None
        if orbit is not None:
            middle = frame.to_geodetic(np.array(orbit.center_ned_m))
            circle = (math.copysign(orbit.radius_m, orbit.speed_mps), middle)
        return DeferredValues(
            instruments=instruments,
            target=None if to is None else frame.to_geodetic(np.array(to.p)),
            innovation_ratios=ratios,
            orbit=circle,
        )

    def _system_state(self, failsafes: Failsafes) -> int:
        if self._flight.mode is Mode.TERMINATED:
            return mav.MAV_STATE_FLIGHT_TERMINATION
        if failsafes.acting and self._aircraft.armed:
            return mav.MAV_STATE_CRITICAL
        if self._aircraft.armed:
            return mav.MAV_STATE_ACTIVE
        return mav.MAV_STATE_STANDBY if self._aircraft.ready else mav.MAV_STATE_CALIBRATING

    def _healthy(self, failsafes: Failsafes, *, gnss: bool) -> int:
        healthy = _PRESENT
        if not failsafes.present(Cause.FENCE_BREACHED):
            healthy |= mav.MAV_SYS_STATUS_GEOFENCE
        if not self._aircraft.ready:
            healthy &= ~_ALIGNED
        if not gnss:
            healthy &= ~_NEEDS_GNSS
        if not self._aircraft.armed and self._flight.not_ready():
            healthy &= ~mav.MAV_SYS_STATUS_PREARM_CHECK
        return healthy
