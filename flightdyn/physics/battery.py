"""The battery: open-circuit voltage over charge, sag over resistance, charge drawn."""

from dataclasses import dataclass
from itertools import pairwise

from flightdyn.config import BatteryConfig
from flightdyn.state import BatteryState

CELLS = 4
# Open-circuit volts per cell over the state of charge: usual lithium-polymer values, chosen.
_OPEN_CIRCUIT = (
    (0.00, 3.27),
    (0.05, 3.61),
    (0.10, 3.69),
    (0.20, 3.73),
    (0.40, 3.79),
    (0.60, 3.87),
    (0.80, 4.02),
    (1.00, 4.20),
)


def open_circuit_voltage(charge: float) -> float:
    """Volts of the unloaded pack at `charge` (0..1), linear between the table's rows."""
    charge = min(1.0, max(0.0, charge))
    for (low, low_v), (high, high_v) in pairwise(_OPEN_CIRCUIT):
        if charge <= high:
            return CELLS * (low_v + (high_v - low_v) * (charge - low) / (high - low))
    return CELLS * _OPEN_CIRCUIT[-1][1]


@dataclass(slots=True)
class Battery:
    """State of a battery pack: charge, current and terminal voltage."""

    config: BatteryConfig
    consumed_mah: float = 0.0
    current_a: float = 0.0
    voltage_v: float = 0.0

    def __post_init__(self) -> None:
        self.voltage_v = open_circuit_voltage(self.config.initial)

    @property
    def charge(self) -> float:
        """Share of the full charge that is left."""
        return max(0.0, self.config.initial - self.consumed_mah / self.config.capacity_mah)

    def draw(self, power_w: float, dt_s: float) -> float:
        """Give `power_w` for `dt_s`; returns the terminal voltage.

        The current solves I (E - R I) = P, E the open-circuit voltage; where the pack cannot give
        P, it gives its largest power at half of E.
        """
        open_v = open_circuit_voltage(self.charge)
        resistance = self.config.resistance_ohm
        if resistance > 0:
            root = open_v * open_v - 4 * resistance * power_w
            self.current_a = (open_v - max(0.0, root) ** 0.5) / (2 * resistance)
        else:
            self.current_a = power_w / open_v
        self.voltage_v = open_v - resistance * self.current_a
        self.consumed_mah += self.current_a * dt_s / 3.6
        return self.voltage_v

    def state(self) -> BatteryState:
        """Present voltage, current, charge consumed and charge left."""
        return BatteryState(
            voltage_v=self.voltage_v,
            current_a=self.current_a,
            consumed_mah=self.consumed_mah,
            remaining=self.charge,
        )
