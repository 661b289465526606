"""A rotor in air that comes from the side: Glauert's relation, and blades integrated over the disc.

`glauert` makes the propeller's tables, columns above 0, out of their axial column. `Blades` shares
nothing with it but the axial column, to which its section is fitted. In this file coefficients and
speeds are over tip speed (T / rho A (Omega R)^2, V / Omega R); the tables, and what is compared,
are JSBSim's: T / rho n^2 D^4 and P / rho n^3 D^5.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.optimize import brentq

from flightdyn.physics import airframe
from flightdyn.state import Vector

PROPELLER = Path(airframe.__file__).parent / "engine" / "prop_10x45.xml"
CT, CP = math.pi**3 / 4, math.pi**4 / 4  # JSBSim's coefficients over those of this file
KAPPA = 1.15  # induced power over the ideal (J. G. Leishman, Principles of Helicopter Aerodynamics)


@dataclass(frozen=True)
class Tables:
    """Coefficients of the propeller: rows are advance J = V / n D, columns edgewise V / Omega R."""

    advance: Vector
    edgewise: Vector
    thrust: Vector
    power: Vector


def read() -> Tables:
    """Tables of the propeller that JSBSim flies."""
    found = {}
    for table in ElementTree.parse(PROPELLER).getroot().iter("table"):
        first, *rows = (table.findtext("tableData") or "").strip().splitlines()
        found[table.get("name")] = np.loadtxt(rows)
    thrust, power = found["C_THRUST"], found["C_POWER"]
    return Tables(thrust[:, 0], np.array(first.split(), float), thrust[:, 1:], power[:, 1:])


def _straight(x: Vector, y: Vector) -> Callable[[float], float]:
    """Linear between points and beyond them."""

    def at(value: float) -> float:
        i = int(np.clip(np.searchsorted(x, value) - 1, 0, len(x) - 2))
        return float(y[i] + (y[i + 1] - y[i]) / (x[i + 1] - x[i]) * (value - x[i]))

    return at


def glauert(known: Tables) -> Tables:
    """Tables whose columns above 0 follow from the axial column.

    Inflow i and thrust c: i = i_c + c / (2 sqrt(mu^2 + i^2)), the branch that helicopters fly on.
    Thrust and profile power are those of the axial column at the same inflow, linear below that of
    hover and constant from none on; edgewise speed adds 3/2 mu^2 of the thrust of no inflow, and
    mu^2 of profile power (blade-element theory; what the rotor's drag costs is the airframe's).
    """
    climb, thrust, power = known.advance / math.pi, known.thrust[:, 0] / CT, known.power[:, 0] / CP
    up = climb >= 0.0
    inflow = climb / 2 + np.sqrt(climb**2 / 4 + thrust / 2)
    profile = power - thrust * (climb + KAPPA * (inflow - climb))
    lifting, dragging = (_straight(inflow[up], of[up]) for of in (thrust, profile))

    def at(climb: float, mu: float) -> tuple[float, float]:
        def lift(inflow: float) -> float:
            return lifting(max(inflow, 0.0)) + 1.5 * mu**2 * lifting(0.0)

        def gap(inflow: float) -> float:
            return inflow - climb - lift(inflow) / (2 * math.hypot(mu, inflow))

        falling = np.linspace(0.5, -0.4, 240)
        below = next(i for i, tried in enumerate(falling) if gap(tried) <= 0.0)
        found = brentq(gap, falling[below], falling[below - 1])
        induced = climb + KAPPA * (found - climb)
        drag = dragging(max(found, 0.0)) * (1 + mu**2)
        return lift(found), lift(found) * induced + drag

    made = np.array([[at(c, mu) for mu in known.edgewise[1:]] for c in climb.tolist()])
    columns = (
        np.column_stack((axial[:, 0], scale * made[..., i]))
        for i, (axial, scale) in enumerate(((known.thrust, CT), (known.power, CP)))
    )
    return Tables(known.advance, known.edgewise, *columns)


@dataclass(frozen=True)
class Blades:
    """Two blades of a 10 x 4.5 propeller: forces of their sections, integrated over the disc.

    Each annulus has its own momentum, with Prandtl's loss at the tip; edgewise flow adds its speed
    to the mass flow and Drees' slopes to the inflow. The section is chosen so that the axial column
    comes out, J = 0 to 0.5, to 2.5 %.
    """

    slope: float = 5.943  # of lift over angle
    zero_lift_rad: float = -0.140
    drag: tuple[float, float] = (0.0107, 0.0222)  # at no lift, and times lift squared

    def flow(self, advance: float, mu: float) -> tuple[float, float, float]:
        """Thrust and power coefficient, and power that drag in the rotor's plane takes as well."""
        x = np.linspace(0.15, 0.985, 30)  # of the radius
        psi = np.linspace(0.0, math.tau, 36, endpoint=False)
        chord = np.interp(
            x, [0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0], [0.109, 0.16, 0.178, 0.165, 0.135, 0.1, 0.06]
        )[:, None]
        pitch = np.arctan(4.5 / 5.0 / math.tau / x)[:, None]
        along = x[:, None] + mu * np.sin(psi)  # past the section, in the plane
        climb, induced = advance / math.pi, np.full(along.shape, 0.06)
        while True:
            through = climb + induced
            phi, ahead = np.arctan2(through, np.abs(along)), np.sign(along)
            turned = ahead * pitch - phi - self.zero_lift_rad
            lift = np.clip(self.slope * np.sin(turned) * np.cos(turned), -1.1, 1.25)
            drag = self.drag[0] + self.drag[1] * lift**2
            pressure = (along**2 + through**2) * chord  # of two blades, each half of it
            thrust = pressure * (lift * np.cos(phi) - drag * np.sin(phi))
            back = ahead * pressure * (lift * np.sin(phi) + drag * np.cos(phi))
            mean = induced.mean(axis=1)
            tip = np.arccos(np.exp(-(1 - x) / x / np.abs(np.sin(np.arctan2(climb + mean, x)))))
            mass = 8 * x * tip * np.hypot(mu, climb + mean)
            wanted = (thrust.mean(axis=1) / mass)[:, None] * np.ones_like(psi)
            if mu:
                skew = math.atan2(mu, climb + np.average(wanted[:, 0], weights=x))
                front = 4 / 3 * (1 - math.cos(skew) - 1.8 * mu**2) / math.sin(skew)
                wanted *= 1 + x[:, None] * (front * np.cos(psi) - 2 * mu * np.sin(psi))
            if np.abs(wanted - induced).max() < 1e-7:
                break
            induced += 0.2 * (wanted - induced)

        def over_radius(of: Vector) -> float:
            return float(np.trapezoid(of.mean(axis=1), x)) / math.pi

        lost = mu * over_radius(back * np.sin(psi))
        return CT * over_radius(thrust), CP * over_radius(back * x[:, None]), CP * lost
