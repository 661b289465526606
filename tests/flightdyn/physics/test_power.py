"""The table of power against the aircraft itself, in JSBSim."""

import numpy as np
import pytest
from flights import legs, make, path_along, run, take_off

from flightdyn.guidance.path import FlightPath
from flightdyn.physics.airframe.parameters import QUAD_X
from flightdyn.physics.power import density_ratio, least_power_w, open_circuit_voltage, power_w
from flightdyn.state import GeodeticPoint

HEIGHT_M = 30.0


@pytest.mark.parametrize(("speed_mps", "alt_m"), [(0.0, 0.0), (0.0, 1500.0), (17.0, 1500.0)])
def test_steady_flight_takes_what_the_table_says(speed_mps: float, alt_m: float) -> None:
    aircraft = make(home=GeodeticPoint(45.0, 5.0, alt_m))
    take_off(aircraft, HEIGHT_M)
    if speed_mps:
        start = np.array([0.0, 0.0, -HEIGHT_M])
        aircraft.follow(path_along(legs(start, (0.0,), 1000.0), speed_mps=speed_mps))
    run(aircraft, 12)
    watts = []
    for _ in range(50):
        run(aircraft, 0.1)
        watts.append(aircraft.battery.voltage_v * aircraft.battery.current_a)
    expected = power_w(np.array([speed_mps]), density=density_ratio(alt_m + HEIGHT_M))
    # What the motors' currents lose does not thin out with the air.
    assert np.mean(watts) == pytest.approx(expected[0], rel=0.02 if alt_m else 0.005)


def test_every_speed_of_the_table_takes_what_it_says() -> None:
    """One flight, of a leg at each speed: by the middle of a leg it is steady."""
    aircraft = make(home=GeodeticPoint(45.0, 5.0, 0.0))
    take_off(aircraft, HEIGHT_M)
    rows = len(QUAD_X.level_power_w)
    speeds_mps = np.append(np.arange(1.0, rows), rows - 1.0)  # on the last leg it brakes
    north_m = np.append(0.0, np.cumsum(8.0 * speeds_mps))
    points = np.column_stack((north_m, np.zeros(rows + 1), np.full(rows + 1, -HEIGHT_M)))
    aircraft.follow(FlightPath(points, speeds_mps, np.full(rows + 1, 5.0)))
    watts: list[list[float]] = [[] for _ in speeds_mps]
    while (flown_m := float(aircraft.vehicle.position_ned()[0])) < north_m[-2]:
        leg = max(0, int(np.searchsorted(north_m, flown_m)) - 1)
        if 0.6 < (flown_m - north_m[leg]) / (8.0 * speeds_mps[leg]) < 0.9:
            watts[leg].append(aircraft.battery.voltage_v * aircraft.battery.current_a)
        run(aircraft, 0.1)
    measured = [np.mean(of_leg) for of_leg in watts[:-1]]
    expected = power_w(speeds_mps[:-1], density=density_ratio(HEIGHT_M))
    np.testing.assert_allclose(measured, expected, rtol=5e-4)  # the table is to 0.1 W


def test_acceleration_costs_and_thin_air_as_well() -> None:
    hover, pushing = power_w(np.zeros(2), accel_mps2=np.array([0.0, 5.0]))
    assert pushing / hover == pytest.approx((1 + (5 / 9.81) ** 2) ** 0.75)
    fast, faster = power_w(np.full(2, 15.0), accel_mps2=np.array([0.0, 5.0]))
    assert faster - fast == pytest.approx(pushing - hover)  # its drag is overcome already
    assert power_w(np.zeros(1), density=0.81)[0] == pytest.approx(hover / 0.9)


@pytest.mark.parametrize(
    ("charge", "cell_v"),
    [
        (-0.1, 3.27), (0.0, 3.27), (0.025, 3.44), (0.05, 3.61), (0.1, 3.69), (0.2, 3.73),
        (0.25, 3.745), (0.4, 3.79), (0.6, 3.87), (0.8, 4.02), (0.9, 4.11), (1.0, 4.2), (1.1, 4.2),
    ],
)  # fmt: skip
def test_four_cells_have_the_usual_voltage(charge: float, cell_v: float) -> None:
    assert open_circuit_voltage(charge) == pytest.approx(4 * cell_v, rel=1e-12)


def test_air_thins_as_in_the_standard_atmosphere() -> None:
    """ICAO 7488: 1.2250, 1.1116, 1.0065 and 0.7361 kg/m3."""
    for alt_m, density in ((0.0, 1.2250), (1000.0, 1.1116), (2000.0, 1.0065), (5000.0, 0.7361)):
        assert density_ratio(alt_m) == pytest.approx(density / 1.225, abs=1e-4)


def test_the_least_power_of_a_speed_or_more() -> None:
    """Before the cheapest speed it is that one's, and beyond each its own."""
    speeds_mps = np.arange(0.0, len(QUAD_X.level_power_w) - 1, 0.5)
    watts, least = power_w(speeds_mps), least_power_w(speeds_mps)
    expected = [watts[at:].min() for at in range(len(watts))]
    assert least.tolist() == pytest.approx(expected)
    assert watts[0] > least[0]
