"""The JSBSim aircraft against closed forms and an independent rigid body."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flightdyn.config import BatteryConfig, GustConfig, WindConfig
from flightdyn.frames import LocalFrame, Triple, normal_gravity, yaw_of
from flightdyn.physics.air import altitude_m, gust_ned, pressure_pa, pressure_slope, steady_wind_ned
from flightdyn.physics.airframe.parameters import QUAD_X
from flightdyn.physics.multirotor import Multirotor
from flightdyn.physics.power import Battery, open_circuit_voltage
from flightdyn.state import GeodeticPoint, Vector

DT = 0.004
MASS = 1.6
INERTIA = np.array([0.0165, 0.0175, 0.0300])
PROP_D = 0.254
CT0, CP0 = 0.115, 0.045  # static
KV, RESISTANCE, NO_LOAD = 920.0, 0.11, 0.5
G = normal_gravity(47.0, 0.0)
FT = 0.3048


def vehicle(
    alt_msl_m: float = 0.0, wind: WindConfig | None = None, seed: int = 1, dt: float = DT
) -> Multirotor:
    frame = LocalFrame(GeodeticPoint(47.0, 8.0, alt_msl_m))
    return Multirotor(frame, wind or WindConfig(), dt_s=dt, seed=seed)


def place(
    v: Multirotor,
    height_m: float,
    rates: Triple = (0.0, 0.0, 0.0),
    wind: WindConfig | None = None,
    seed: int = 1,
) -> None:
    """Start again at a height, level, at rest but for body rates."""
    fdm = v._fdm
    fdm["ic/h-sl-ft"] = height_m / FT
    for axis, rate in zip("pqr", rates, strict=True):
        fdm[f"ic/{axis}-rad_sec"] = rate
    assert fdm.run_ic()
    v._weather(wind or WindConfig(), seed)  # a new start drops it
    v.watch_ground()


def density(v: Multirotor) -> float:
    return float(v._fdm["atmosphere/rho-slugs_ft3"]) * 515.3788


def freeze(v: Multirotor) -> None:
    """A test bench: motors turn, nothing moves."""
    for name in ("rate/rotational", "rate/translational", "position/translational"):
        v._fdm[f"simulation/integrator/{name}"] = 0


def drive(v: Multirotor, duty: tuple[float, float, float, float], ticks: int) -> None:
    v.arm(True)
    v.drive(duty)
    for _ in range(ticks):
        v.run()


def test_the_files_hold_the_numbers_that_the_autopilot_knows() -> None:
    v = vehicle()
    v.run()
    assert v._fdm["inertia/weight-lbs"] * 0.45359237 == pytest.approx(QUAD_X.mass_kg, rel=1e-6)
    slug_ft2 = 1.3558179619
    moments = [v._fdm[f"inertia/i{a}{a}-slugs_ft2"] * slug_ft2 for a in "xyz"]
    assert moments == pytest.approx(INERTIA, rel=2e-4)


@pytest.mark.parametrize("duty", [0.2, 0.4, 0.7])
def test_motor_and_propeller_settle_where_their_equations_meet(duty: float) -> None:
    v = vehicle()
    place(v, 100.0)
    freeze(v)
    v.set_battery_voltage(16.8)
    drive(v, (duty,) * 4, 500)
    kt = 60 / (math.tau * KV)
    volts, rho = duty * 16.8, density(v)
    # Torque balance kt ((V - kt w) / R - I0) = CP rho D^5 w^2 / (2 pi)^3, solved for w.
    a = CP0 * rho * PROP_D**5 / math.tau**3
    b, c = kt * kt / RESISTANCE, -kt * (volts / RESISTANCE - NO_LOAD)
    speed = (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)
    thrust = CT0 * rho * PROP_D**4 * (speed / math.tau) ** 2
    assert v.rotor_speeds_radps() == pytest.approx([speed] * 4, rel=2e-3)
    assert v.rotor_thrusts_n() == pytest.approx([thrust] * 4, rel=4e-3)
    current = (volts - kt * speed) / RESISTANCE
    assert v.electrical_power_w() == pytest.approx(4 * volts * current, rel=5e-3)


def test_hover_thrust_is_weight() -> None:
    v = vehicle()
    place(v, 100.0)
    v.arm(True)
    v.set_collective(0.236)
    for _ in range(2000):
        v.run()
    # In free air the specific force is thrust and drag over mass, whatever the speed.
    drag = 0.5 * density(v) * 0.035 * abs(v.velocity_ned()[2]) * -v.velocity_ned()[2]
    force = -sum(v.rotor_thrusts_n()) + drag
    assert v.specific_force()[2] == pytest.approx(force / MASS, rel=1e-3)
    thrust = v.rotor_thrusts_n()[0]
    expected = CT0 * density(v) * PROP_D**4 * (v.rotor_speeds_radps()[0] / math.tau) ** 2
    # The collective's scale: 1 is 16.6 N at sea level, at rest.
    assert thrust == pytest.approx(0.236 * 16.6, rel=0.05)
    assert thrust == pytest.approx(expected, rel=0.05)  # a slow climb: a little less


@pytest.mark.parametrize(
    ("duty", "sign"), [((0.42, 0.42, 0.36, 0.36), 1), ((0.36, 0.36, 0.42, 0.42), -1)]
)
def test_counter_clockwise_rotors_turn_the_nose_right(
    duty: tuple[float, float, float, float], sign: int
) -> None:
    v = vehicle()
    place(v, 100.0)
    freeze(v)
    drive(v, duty, 500)
    rho = density(v)
    kinds = (1, 1, -1, -1)  # front right, rear left; front left, rear right
    torque = sum(
        kind * CP0 * rho * PROP_D**5 * w * w / math.tau**3
        for kind, w in zip(kinds, v.rotor_speeds_radps(), strict=True)
    )
    shown = v._fdm["moments/n-prop-lbsft"] * 1.3558179483
    assert shown == pytest.approx(torque, rel=1e-2)
    assert math.copysign(1, shown) == sign


def test_front_motors_raise_the_nose_and_left_ones_lower_the_right_side() -> None:
    arm = 0.25 / math.sqrt(2)
    for duty, axis, pairs in (
        ((0.42, 0.36, 0.42, 0.36), "m", (1, -1, 1, -1)),
        ((0.36, 0.42, 0.42, 0.36), "l", (-1, 1, 1, -1)),
    ):
        v = vehicle()
        place(v, 100.0)
        freeze(v)
        drive(v, duty, 500)
        moment = arm * sum(k * t for k, t in zip(pairs, v.rotor_thrusts_n(), strict=True))
        shown = v._fdm[f"moments/{axis}-prop-lbsft"] * 1.3558179483
        assert shown == pytest.approx(moment, rel=1e-2)
        assert shown > 0


def test_spinning_rotors_resist_a_roll_with_the_gyroscopic_moment() -> None:
    """M = -omega x H, with H along -z for rotors counter-clockwise from above."""
    v = vehicle()
    rate = 2.0  # frozen: what damps the roll does not show in the propellers' moments
    place(v, 100.0, (rate, 0.0, 0.0))
    freeze(v)
    drive(v, (0.4, 0.4, 0.0, 0.0), 500)
    momentum = -5.0e-5 * sum(v.rotor_speeds_radps()[:2])
    gyroscopic = -np.cross([rate, 0.0, 0.0], [0.0, 0.0, momentum])
    arm = 0.25 / math.sqrt(2)
    thrusts = v.rotor_thrusts_n()
    pitch = arm * (thrusts[0] - thrusts[1]) + gyroscopic[1]
    shown = v._fdm["moments/m-prop-lbsft"] * 1.3558179483
    assert abs(gyroscopic[1]) > 0.05
    assert shown == pytest.approx(pitch, rel=2e-2)


def test_free_fall_and_terminal_speed() -> None:
    """Motors off, level: m v' = m g - rho A v^2 / 2, so v = u tanh(g t / u)."""
    v = vehicle()
    place(v, 600.0)
    terminal = 0.0
    for tick in range(1, 4001):
        v.run()
        if tick == 250:
            rho = density(v)
            u = math.sqrt(2 * MASS * G / (rho * 0.035))
            assert v.velocity_ned()[2] == pytest.approx(u * math.tanh(G * 1.0 / u), rel=2e-3)
        terminal = v.velocity_ned()[2]
    assert terminal == pytest.approx(math.sqrt(2 * MASS * G / (density(v) * 0.035)), rel=5e-3)


def test_energy_is_lost_to_drag_alone() -> None:
    v = vehicle()
    place(v, 500.0)
    v._fdm["ic/vn-fps"] = 15 / FT
    v._fdm.run_ic()

    def energy() -> float:
        speed2 = sum(s * s for s in v.velocity_ned())
        return MASS * (speed2 / 2 - G * v.position_ned()[2])

    start, lost = energy(), 0.0
    for _ in range(1500):
        v.run()
        fx, fy, fz = v.specific_force()
        fdm = v._fdm
        body = [float(fdm[f"velocities/{c}-fps"]) * FT for c in "uvw"]
        lost += MASS * (fx * body[0] + fy * body[1] + fz * body[2]) * DT
    assert lost < -50
    assert energy() - start == pytest.approx(lost, rel=2e-3)


def test_tumbling_is_that_of_an_independent_rigid_body() -> None:
    """Euler's equations with the drag in yaw, motors off, integrated by SciPy at high order."""
    start = (4.0, 3.0, 5.0)

    def tumble(dt: float) -> Vector:
        v = vehicle(dt=dt)
        place(v, 900.0, start)
        for _ in range(round(2.0 / dt)):
            v.run()
        return np.array(v.rates())

    def euler(_: float, w: Vector) -> Vector:
        drag = 2.75e-3 * w[2] + 1e-4 * w[2] * abs(w[2])
        return (-np.cross(w, INERTIA * w) - np.array([0.0, 0.0, drag])) / INERTIA

    expected = solve_ivp(euler, (0, 2.0), start, rtol=1e-10, atol=1e-12).y[:, -1]
    # JSBSim integrates rates at first order: two steps extrapolate to none.
    assert 2 * tumble(0.0005) - tumble(0.001) == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("height", [0.15, 0.3, 2.0])
def test_ground_effect_is_that_of_cheeseman_and_bennett(height: float) -> None:
    v = vehicle()
    place(v, height)
    freeze(v)
    drive(v, (0.4,) * 4, 250)
    thrust = sum(v.rotor_thrusts_n())
    gain = -v._fdm["forces/fbz-aero-lbs"] * 4.4482216152605 / thrust
    expected = 1 / (1 - (0.127 / (4 * height)) ** 2) - 1
    assert gain == pytest.approx(expected if height < 1 else 0.0, rel=0.03, abs=1e-6)


def test_it_stands_still_on_its_legs() -> None:
    v = vehicle(488.0)
    for _ in range(15_000):
        v.run()
    assert np.linalg.norm(v.position_ned()) < 1e-3
    assert v.specific_force() == pytest.approx((0, 0, -G), abs=2e-3)
    assert yaw_of(v.attitude()) == pytest.approx(0, abs=1e-4)


def test_a_crash_upside_down_stays_above_ground() -> None:
    v = vehicle()
    place(v, 3.0, (12.0, 5.0, 0.0))
    for tick in range(2500):
        v.run()
        if tick % 25 == 0:
            v.watch_ground()
    assert -0.6 < v.position_ned()[2] < 0.15
    assert np.linalg.norm(v.velocity_ned()) < 0.1


@pytest.mark.parametrize("alt", [0.0, 488.0, 2500.0])
def test_air_is_that_of_homes_altitude(alt: float) -> None:
    # ICAO 7488: density of the standard atmosphere.
    table = {0.0: 1.2250, 488.0: 1.1687, 2500.0: 0.95686}
    v = vehicle(alt)
    v.run()
    assert density(v) == pytest.approx(table[alt], rel=3e-4)
    assert v.pressure_pa() == pytest.approx(pressure_pa(alt + QUAD_X.rest_height_m), rel=1e-6)
    place(v, 300.0)
    v.run()
    # The column above home is that of the standard atmosphere too.
    assert v.pressure_pa() == pytest.approx(pressure_pa(alt + 300.0), rel=2e-5)
    assert altitude_m(v.pressure_pa()) == pytest.approx(alt + 300, abs=0.3)
    assert pressure_slope(v.pressure_pa()) == pytest.approx(density(v) * 9.80665, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("alt", [0.0, 1500.0])
def test_turbulence_has_the_strength_of_its_height_above_ground(alt: float) -> None:
    """MIL-F-8785C, 3.7.3.4 and figures 10, 11, at 60 m in a wind of 8 m/s at 20 ft."""
    upright = 0.1 * 8.0
    level = upright / (0.177 + 0.000823 * 60.0 / FT) ** 0.4
    samples = []
    for seed in range(6):
        v = vehicle(alt, dt=0.02)
        wind = WindConfig(speed_mps=8.0, from_deg=180.0, turbulence_severity=4)
        place(v, 60.0, wind=wind, seed=seed)
        v._fdm["simulation/integrator/rate/translational"] = 0
        v._fdm["simulation/integrator/position/translational"] = 0
        for tick in range(40_000):
            v.run()
            if tick > 2000 and tick % 10 == 0:
                samples.append(v.wind_ned())
    air = np.array(samples)
    # The model's time scales with airspeed, so that lulls last longer than gusts.
    assert air[:, 0].mean() == pytest.approx(8.0, abs=0.8)
    assert air[:, 2].std() == pytest.approx(upright, rel=0.08)
    assert air[:, :2].std(axis=0).mean() == pytest.approx(level, rel=0.15)


def test_wind_blows_from_where_it_comes_and_drags_along() -> None:
    assert steady_wind_ned(WindConfig(speed_mps=5.0, from_deg=270.0)) == pytest.approx(
        (0.0, 5.0, 0.0), abs=1e-12
    )
    v = vehicle()
    place(v, 300.0, wind=WindConfig(speed_mps=10.0, from_deg=0.0))
    for _ in range(250):
        v.run()
    assert v.wind_ned() == pytest.approx((-10, 0, 0), abs=1e-9)
    assert v.velocity_ned()[0] < -0.5


def test_gust_rises_and_falls_as_one_minus_cosine() -> None:
    gusts = (GustConfig(start_s=10, duration_s=4, north_mps=6, down_mps=-2),)
    assert gust_ned(gusts, 9.9) == (0.0, 0.0, 0.0)
    assert gust_ned(gusts, 12.0) == pytest.approx((6.0, 0.0, -2.0))
    assert gust_ned(gusts, 11.0)[0] == pytest.approx(3.0)
    assert gust_ned(gusts, 14.1) == (0.0, 0.0, 0.0)
    v = vehicle()
    v.set_gust((3.0, -2.0, 1.0))
    v.run()
    assert v.wind_ned() == pytest.approx((3.0, -2.0, 1.0))


def test_battery_gives_its_power_at_the_sagged_voltage() -> None:
    battery = Battery(BatteryConfig(capacity_mah=1000, resistance_ohm=0.05))
    volts = battery.draw(200.0, 1.0)
    assert volts * battery.current_a == pytest.approx(200.0)
    assert volts == pytest.approx(16.8 - 0.05 * battery.current_a)
    assert battery.consumed_mah == pytest.approx(battery.current_a / 3.6)
    assert battery.charge == pytest.approx(1 - battery.consumed_mah / 1000)


def test_battery_cannot_give_more_than_half_its_open_voltage_allows() -> None:
    battery = Battery(BatteryConfig(resistance_ohm=0.1))
    assert battery.draw(1e6, 0.01) == pytest.approx(16.8 / 2)
    assert battery.current_a == pytest.approx(84.0)


def test_battery_runs_down_and_its_voltage_falls_with_it() -> None:
    battery = Battery(BatteryConfig(capacity_mah=500, resistance_ohm=0.0))
    last = battery.voltage_v
    while battery.charge > 0:
        assert battery.draw(150.0, 1.0) <= last
        last = battery.voltage_v
    assert open_circuit_voltage(0.0) == pytest.approx(4 * 3.27)
    # Energy given: 500 mAh at the mean of the table's voltages, within a few percent.
    assert battery.consumed_mah == pytest.approx(500, rel=0.02)
