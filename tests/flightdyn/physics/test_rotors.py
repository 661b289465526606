"""Rotors in forward flight: thrust and power against theories that are not theirs."""

import math

import numpy as np
import pytest
from rotor_theory import CP, KAPPA, Blades, glauert, read
from scipy.optimize import brentq
from test_physics import FT, MASS, PROP_D, G, density, drive, freeze, place, vehicle

from flightdyn.physics.airframe.parameters import QUAD_X
from mission.planner.performance import Performance

RHO, RADIUS = 1.225, PROP_D / 2
KT, RESISTANCE, NO_LOAD = 60 / (math.tau * 920.0), 0.11, 0.5
LEVEL_W = np.array(QUAD_X.level_power_w)


def test_the_tables_are_those_of_glauerts_relation() -> None:
    flown = read()
    made = glauert(flown)
    assert flown.thrust[:, 1:] == pytest.approx(made.thrust[:, 1:], abs=1e-4)
    assert flown.power[:, 1:] == pytest.approx(made.power[:, 1:], abs=1e-4)


def test_thrust_and_power_are_those_of_blades_integrated_over_the_disc() -> None:
    """At the same thrust, with what drag in the rotors' plane takes: that is the airframe's."""
    flown, blades = read(), Blades()
    for row, advance in enumerate(flown.advance):
        if not 0.0 <= advance <= 0.4:
            continue
        for column, edgewise in enumerate(flown.edgewise):
            # Level flight: the faster, the more it leans.
            if edgewise > 0.3 or (advance == 0.0 and edgewise > 0.06):
                continue
            thrust, power, dragged = blades.flow(float(advance), float(edgewise))
            mine, taken = flown.thrust[row, column], flown.power[row, column]
            assert mine == pytest.approx(thrust, rel=0.09)
            ratio = taken / mine**1.5 / ((power + dragged) / thrust**1.5)
            assert ratio == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("speed_mps", [0.0, 8.0, 15.0])
def test_jsbsim_flies_the_tables(speed_mps: float) -> None:
    """A test bench in wind from ahead; the mean tip speed counts for what comes from the side."""
    v = vehicle()
    place(v, 100.0)
    freeze(v)
    v._fdm["atmosphere/wind-north-fps"] = -speed_mps / FT
    drive(v, (0.36, 0.30, 0.42, 0.36), 500)
    flown = read()
    level = flown.thrust[flown.advance == 0.0][0]
    speeds = np.array(v.rotor_speeds_radps())
    ct = np.interp(speed_mps / (speeds.mean() * RADIUS), flown.edgewise, level)
    for thrust, omega in zip(v.rotor_thrusts_n(), speeds, strict=True):
        assert thrust == pytest.approx(
            ct * density(v) * PROP_D**4 * (omega / math.tau) ** 2, rel=1e-3
        )


def momentum_w(speed_mps: float) -> float:
    """Watts of level flight by momentum theory, with masses, areas and motors of the airframe.

    Induced velocity by Glauert's relation; profile power is what a hover has beyond its induced
    power, goes with rotor speed cubed, and thrust with its square and the angle of the blades.
    """
    area, weight = math.pi * RADIUS**2, MASS * 9.81
    ct, cp = 0.115 * 4 / math.pi**3, 0.045 / CP

    def inflow(thrust: float, along: float, up: float) -> float:
        square = thrust / (2 * RHO * area)
        return brentq(lambda vi: vi * math.hypot(along, up + vi) - square, 0.0, 30.0)

    def thrust_of(omega: float, along: float, through: float) -> float:
        # Blade-element theory, CT = s a / 2 (pitch (1/3 + mu^2 / 2) - inflow / 2); s a fitted to
        # the axial table from rest to an advance ratio of 0.1.
        tip, solidity_slope = omega * RADIUS, 0.244
        rest = ct + solidity_slope / 4 * math.sqrt(ct / 2)
        shown = rest * (1 + 1.5 * (along / tip) ** 2) - solidity_slope / 4 * through / tip
        return shown * RHO * area * tip**2

    omega, lean = 514.0, 0.0
    for _ in range(200):
        along, up = speed_mps * math.cos(lean), speed_mps * math.sin(lean)
        drag = (0.5 * RHO * 0.018 * speed_mps + 4 * 8.06e-5 * omega) * along
        thrust = (weight * math.cos(lean) + 0.5 * RHO * 0.035 * speed_mps * up) / 4
        lean += 0.5 * (math.asin(min(1.0, drag / weight)) - lean)
        through = up + inflow(thrust, along, up)
        more = thrust / thrust_of(omega, along, through)
        omega *= math.sqrt(more)
    profile = cp - KAPPA * ct * math.sqrt(ct / 2)
    shaft = thrust * (up + KAPPA * (through - up)) + profile * RHO * area * (omega * RADIUS) ** 3
    current = shaft / omega / KT + NO_LOAD
    return 4 * current * (KT * omega + RESISTANCE * current)


@pytest.mark.parametrize("speed_mps", [0, 5, 8, 10, 12, 15, 20])
def test_level_power_is_that_of_momentum_theory(speed_mps: int) -> None:
    assert LEVEL_W[speed_mps] == pytest.approx(momentum_w(float(speed_mps)), rel=0.05)


def test_level_power_has_the_shape_of_zeng_xu_and_zhang() -> None:
    """Y. Zeng, J. Xu, R. Zhang, IEEE TWC 2019, eq. 12: three shares, each above 0, up to 20 m/s."""
    speed = np.arange(21.0)
    hover_mps = math.sqrt(MASS * G / 4 / (2 * RHO * math.pi * RADIUS**2))
    over = speed / hover_mps
    tip = 514.0 * RADIUS
    induced = np.sqrt(np.sqrt(1 + over**4 / 4) - over**2 / 2)
    shape = np.column_stack((1 + 3 * (speed / tip) ** 2, induced, speed**3))
    shares = np.linalg.lstsq(shape / LEVEL_W[:21, None], np.ones(21), rcond=None)[0]
    assert (shares > 0.0).all()
    assert shape @ shares == pytest.approx(LEVEL_W[:21], rel=0.035)
    assert 1.0 < shares[1] / shares[0] < 4.0


def test_best_speeds_are_those_of_the_power() -> None:
    sea = Performance(20.0, 5.0, None)
    assert sea.best_endurance_mps == pytest.approx(np.argmin(LEVEL_W), abs=0.11)
    metres_j = LEVEL_W[1:] / np.arange(1, len(LEVEL_W))
    assert sea.best_range_mps == pytest.approx(1 + np.argmin(metres_j), abs=0.11)
    high = Performance(20.0, 5.0, None, density=0.81)
    assert high.best_range_mps == pytest.approx(sea.best_range_mps / 0.9, abs=0.11)
