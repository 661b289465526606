"""The multirotor in JSBSim, whose one home this is: SI units outside, feet and slugs inside.

JSBSim flies over a ground at its own sea level, with the atmosphere shifted so that air and
temperature are those of home's altitude: height above its sea level is then height above ground
wherever home is, which is the height that its Milspec turbulence takes for its scales.
"""

import math
import os
from collections.abc import Callable
from pathlib import Path

from flightdyn.config import WindConfig
from flightdyn.frames import (
    LocalFrame,
    Quaternion,
    Triple,
    normal_gravity,
    quaternion_from_euler,
    rotation_matrix,
    wrap_pi,
)
from flightdyn.native.ticks import Gauges, Getter, Inner, Setter
from flightdyn.physics.air import FT_M, pressure_pa, steady_wind_ned, temperature_k, wind_at_20ft
from flightdyn.physics.airframe.parameters import QUAD_X, Airframe
from flightdyn.state import Kinematics
from native.errors import InputError, ModelDivergedError

os.environ.setdefault("JSBSIM_DEBUG", "0")  # read by JSBSim when it is loaded
import jsbsim

_ROOT = Path(__file__).parent / "airframe"
_CONTACT_HEIGHT_FT = 20.0
_LEGS, _GUARDS = 4, 4  # contacts, in JSBSim's order
_ABSURD_FT = 1e5
_MILSPEC = 3  # JSBSim's number of the MIL-F-8785C model
_RANKINE_PER_K = 1.8
_PA_PER_PSF = 47.880258980336
_RPM_PER_RADPS = 60 / math.tau
_N_PER_LBF = 4.4482216152605


def _load(fdm: "jsbsim.FGFDMExec", name: str) -> None:
    """Load the aircraft `name` with JSBSim's console notes held back."""
    before = jsbsim.get_logger()
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.ERROR))
    try:
        loaded = fdm.load_model(name)
    finally:
        jsbsim.set_logger(before)
    if not loaded:
        raise InputError(f"JSBSim cannot load {name} from {_ROOT}")


def _still(value: float) -> Getter:
    return lambda: value


class Multirotor:
    """Rigid body, motors, propellers, inner loops and air, in SI units."""

    def __init__(
        self,
        frame: LocalFrame,
        wind: WindConfig,
        *,
        dt_s: float,
        seed: int,
        heading_rad: float = 0.0,
    ) -> None:
        """Start at rest on the ground at the origin of `frame`; `seed` feeds the turbulence.

        Raises InputError where the airframe's files are incomplete.
        """
        self.airframe: Airframe = QUAD_X
        self._dt_s = dt_s
        self._latitude_deg = frame.origin.lat_deg
        fdm = jsbsim.FGFDMExec(str(_ROOT))
        fdm.set_debug_level(0)
        fdm.set_dt(dt_s)  # before loading: filters and integrators take it when they are made
        _load(fdm, self.airframe.name)
        self._fdm = fdm
        self._air(frame.origin.alt_msl_m)
        self._place(frame.origin.lat_deg, frame.origin.lon_deg, heading_rad)
        self._weather(wind, seed)
        self._bind()
        self.run: Callable[[], bool] = fdm.run
        self._origin_u = self._up()
        self._origin_n = self._north()
        self._origin_e = self._east()
        rates = [(get, 0.0, 1.0) for get in self._rates]
        # Body rates (rad/s) and specific force (m/s2), as an IMU feels them.
        self.imu = Gauges([*rates, *((get, 0.0, FT_M) for get in self._accel)])
        # Position (m), velocity (m/s), Euler angles (rad), rates, velocity of the air (m/s).
        self.all = Gauges(
            [
                (self._north, self._origin_n, FT_M),
                (self._east, self._origin_e, FT_M),
                (self._up, self._origin_u, -FT_M),
                *((get, 0.0, FT_M) for get in self._vel),
                *((get, 0.0, 1.0) for get in self._euler),
                *rates,
                *((get, 0.0, FT_M) for get in self._wind),
            ]
        )

        self.static = Gauges([(self._pressure, 0.0, _PA_PER_PSF)])  # pressure (Pa)
        # Body rates that the inner loops want (rad/s), duty cycles of the motors.
        self.actuators = Gauges([(get, 0.0, 1.0) for get in (*self._wanted, *self._throttle)])

    def _rebind(self) -> None:
        """Point the gauges of the native loop at this model's properties."""
        self.imu.bind((*self._rates, *self._accel))
        self.static.bind((self._pressure,))
        place = (self._north, self._east, self._up)
        self.actuators.bind((*self._wanted, *self._throttle))
        self.all.bind((*place, *self._vel, *self._euler, *self._rates, *self._wind))

    def _air(self, alt_msl_m: float) -> None:
        warmer = temperature_k(alt_msl_m) - temperature_k(0.0)
        self._set("atmosphere/delta-T", warmer * _RANKINE_PER_K)
        self._set("atmosphere/P-sl-psf", pressure_pa(alt_msl_m) / _PA_PER_PSF)

    def _place(self, lat_deg: float, lon_deg: float, heading_rad: float) -> None:
        self._set("ic/lat-geod-deg", lat_deg)
        self._set("ic/long-gc-deg", lon_deg)
        self._set("ic/terrain-elevation-ft", 0.0)
        self._set("ic/h-sl-ft", self.airframe.rest_height_m / FT_M)
        self._set("ic/psi-true-rad", heading_rad)
        if not self._fdm.run_ic():
            raise InputError(f"JSBSim cannot start {self.airframe.name} at rest")

    def _weather(self, wind: WindConfig, seed: int) -> None:
        self._set("simulation/randomseed", float(seed % 2**31))
        north, east, down = steady_wind_ned(wind)
        self._set("atmosphere/wind-north-fps", north / FT_M)
        self._set("atmosphere/wind-east-fps", east / FT_M)
        self._set("atmosphere/wind-down-fps", down / FT_M)
        self._set("atmosphere/turb-type", _MILSPEC if wind.turbulence_severity else 0)
        self._set("atmosphere/turbulence/milspec/severity", wind.turbulence_severity)
        self._set(
            "atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps", wind_at_20ft(wind) / FT_M
        )

    def _set(self, name: str, value: float) -> None:
        self._node(name).set_double_value(float(value))

    def _node(self, name: str) -> "jsbsim.FGPropertyNode":
        node = self._fdm.get_property_manager().get_node(name)
        if node is None:  # get_node makes none
            raise InputError(f"JSBSim has no property {name!r} for {self.airframe.name}")
        return node

    def _getter(self, name: str) -> Getter:
        getter: Getter = self._node(name).get_double_value
        return getter

    def _setter(self, name: str) -> Setter:
        setter: Setter = self._node(name).set_double_value
        return setter

    def _bind(self) -> None:
        get, put = self._getter, self._setter
        self._north = get("position/from-start-neu-n-ft")
        self._east = get("position/from-start-neu-e-ft")
        self._up = get("position/from-start-neu-u-ft")
        self._vel = [get(f"velocities/v-{axis}-fps") for axis in ("north", "east", "down")]
        self._euler = [get(f"attitude/{angle}-rad") for angle in ("phi", "theta", "psi")]
        self._rates = [get(f"velocities/{rate}-rad_sec") for rate in "pqr"]
        self._accel = [get(f"accelerations/a-pilot-{axis}-ft_sec2") for axis in "xyz"]
        self._pressure = get("atmosphere/P-psf")
        self._wind = [
            get(f"atmosphere/total-wind-{axis}-fps") for axis in ("north", "east", "down")
        ]
        self._gust = [put(f"atmosphere/gust-{axis}-fps") for axis in ("north", "east", "down")]
        engines = [f"propulsion/engine[{i}]" for i in range(4)]
        self._current = [get(f"{engine}/current-amperes") for engine in engines]
        self._throttle = [get(f"fcs/throttle-pos-norm[{i}]") for i in range(4)]
        self._wanted = [get(f"fcs/rate-wanted-{axis}") for axis in "pqr"]
        self._rpm = [get(f"{engine}/propeller-rpm") for engine in engines]
        self._thrust = [get(f"{engine}/thrust-lbs") for engine in engines]
        rates, errors, feeds = (
            [put(f"fcs/in/{order}-{axis}") for axis in "pqr"] for order in ("rate", "error", "feed")
        )
        self.set_collective = put("fcs/in/collective")
        # Where rates and orders are written to, by a native loop. The FCS takes the rotation from
        # the believed to the wanted attitude, in body axes. The guidance gives it at its own rate;
        # between its steps the rotation is carried on with the believed body rates, so that the
        # attitude loop closes at every tick.
        self.inner_loops = Inner(rates, errors, feeds, self.set_collective, dt_s=self._dt_s)
        self._hold = put("fcs/in/hold")
        self.set_battery_voltage = put("fcs/in/battery-v")
        self._direct = put("fcs/in/direct")
        self.set_motors = [put(f"fcs/in/motor-{i}") for i in range(4)]
        self._height = get("position/h-agl-ft")
        self._contacts = put("simulation/models/FGGroundReactions/enabled")
        self._health = [put(f"fcs/in/health-{i}") for i in range(4)]
        self._touching = [get(f"gear/unit[{i}]/WOW") for i in range(_LEGS)]
        self._touching += [get(f"contact/unit[{_LEGS + i}]/WOW") for i in range(_GUARDS)]

    def arm(self, armed: bool) -> None:
        """Let the inner loops drive the motors, or stop them and zero their integrators."""
        self._hold(0.0 if armed else -1.0)

    def watch_ground(self) -> bool:
        """Switch ground contacts on near the ground, else off, which saves a fifth of the time.

        To be called at least ten times a second: nothing falls 6 m in that time. Returns whether
        the ground is that near. Raises ModelDivergedError where the height is no sane number.
        """
        height = self._height()
        if not abs(height) < _ABSURD_FT:  # NaN is not less either
            raise ModelDivergedError(
                f"the simulated aircraft failed: height above ground is {height * FT_M:g} m"
            )
        near = height < _CONTACT_HEIGHT_FT
        self._contacts(1.0 if near else 0.0)
        return near

    def impact_mps(self) -> float:
        """Speed of the fastest part while the ground is touched; 0 while it is not.

        Of the very tick at which contact begins: the ground slows the aircraft in the ticks after.
        """
        reach_m = self.airframe.reach_m
        if self._height() * FT_M > reach_m or not any(touch() for touch in self._touching):
            return 0.0
        return math.hypot(*self.velocity_ned()) + reach_m * math.hypot(*self.rates())

    def wreck(self) -> None:
        """Stop dead: the wreck lies where it struck, and JSBSim is run no more.

        The accelerometers feel the blow in this tick, then rest.
        """
        r = rotation_matrix(self.attitude())
        n, e, d = (get() / self._dt_s for get in self._vel)
        g = normal_gravity(self._latitude_deg, 0.0) / FT_M
        x, y, z = (get() for get in self._accel)
        self._accel = [
            _still(x - (r[0] * n + r[3] * e + r[6] * d)),
            _still(y - (r[1] * n + r[4] * e + r[7] * d)),
            _still(z - (r[2] * n + r[5] * e + r[8] * d)),
        ]
        zero = _still(0.0)
        self._north, self._east = _still(self._north()), _still(self._east())
        self._up, self._height = _still(self._up()), _still(self._height())
        self._vel = [zero] * 3
        self._euler = [_still(get()) for get in self._euler]
        self._rates = [zero] * 3
        self._pressure = _still(self._pressure())
        self._current = self._throttle = self._rpm = self._thrust = [zero] * 4

        self._rebind()

        def rest() -> bool:
            self._accel = [_still(-part * g) for part in r[6:]]
            self._rebind()
            self.run = lambda: True
            return True

        self.run = rest

    def drive(self, motors: tuple[float, ...]) -> None:
        """Set the motors' duty cycles (0..1) from now on, bypassing the inner loops.

        For firmware, and for a test bench of motors, propellers and rigid body.
        """
        self._direct(1.0)
        for put, value in zip(self.set_motors, motors, strict=True):
            put(min(1.0, max(0.0, value)))

    def set_motor_health(self, motor: int, share: float) -> None:
        """Set the share (0..1) of the ordered voltage that reaches motor 0..3."""
        self._health[motor](share)

    def set_gust(self, gust_ned_mps: Triple) -> None:
        """Set the velocity of the air (m/s, NED) that is added to wind and turbulence."""
        for put, value in zip(self._gust, gust_ned_mps, strict=True):
            put(value / FT_M)

    def electrical_power_w(self) -> float:
        """Electrical power of the motors, winding losses included; braking gives nothing back."""
        volts, power = self.airframe.motor_full_voltage_v, 0.0
        for current, throttle in zip(self._current, self._throttle, strict=True):
            power += current() * throttle() * volts
        return max(0.0, power)

    def position_ned(self) -> Triple:
        """Position (m) from where the aircraft stood at rest."""
        return (
            (self._north() - self._origin_n) * FT_M,
            (self._east() - self._origin_e) * FT_M,
            (self._origin_u - self._up()) * FT_M,
        )

    def velocity_ned(self) -> Triple:
        """Velocity over ground (m/s)."""
        n, e, d = self._vel
        return n() * FT_M, e() * FT_M, d() * FT_M

    def attitude(self) -> Quaternion:
        """Attitude, body to NED."""
        roll, pitch, yaw = self._euler
        return quaternion_from_euler(roll(), pitch(), wrap_pi(yaw()))

    def rates(self) -> Triple:
        """Body rates (rad/s)."""
        p, q, r = self._rates
        return p(), q(), r()

    def specific_force(self) -> Triple:
        """Force other than gravity over mass (m/s2, body axes): what an accelerometer feels."""
        x, y, z = self._accel
        return x() * FT_M, y() * FT_M, z() * FT_M

    def pressure_pa(self) -> float:
        """Static pressure of the air around the aircraft."""
        return self._pressure() * _PA_PER_PSF

    def wind_ned(self) -> Triple:
        """Velocity of the air (m/s), gusts and turbulence included."""
        n, e, d = self._wind
        return n() * FT_M, e() * FT_M, d() * FT_M

    def rotor_speeds_radps(self) -> tuple[float, ...]:
        """Speed of the four rotors."""
        return tuple(rpm() / _RPM_PER_RADPS for rpm in self._rpm)

    def rotor_thrusts_n(self) -> tuple[float, ...]:
        """Thrust of the four rotors."""
        return tuple(thrust() * _N_PER_LBF for thrust in self._thrust)

    def kinematics(self, t_ns: int) -> Kinematics:
        """The true state, stamped `t_ns`."""
        n, e, d, vn, ve, vd, roll, pitch, yaw, p, q, r, *_wind = self.all.read()
        turned = quaternion_from_euler(roll, pitch, wrap_pi(yaw))
        return Kinematics.of(t_ns, n, e, d, vn, ve, vd, *turned, p, q, r)
