"""A researcher's own packet error rates, held to what every radio must keep."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fl.arrays import Floats
from fl.plugins import PluginError, guarded, make
from fl.radio.channel import Channel

KEY = "channel.gate"
MODES = ("average", "instantaneous")


class Radio(Protocol):
    """What decides whose packet arrives. `Channel` is one."""

    def per(self, distance_m: Floats, height_m: Floats) -> ArrayLike:
        """Packet error rates, (n,), each in [0, 1].

        `distance_m` (n,), 0 or more: horizontal, in metres, from the device to the aircraft.
        `height_m` (n,): of the aircraft above home, in metres; 0 or less on the ground. Where a
        device sent nothing, both are anything, and its rate is not looked at. The answer may
        depend on the arguments alone, so that a run can be resumed.
        """


@dataclass(frozen=True)
class CustomRadio:
    """Checks the rates that the researcher's radio gives."""

    name: str
    inner: Radio = field(repr=False)

    def per(self, distance_m: Floats, height_m: Floats) -> Floats:
        """The researcher's rates.

        Raises:
            PluginError: the wrong number of them, or one that is no probability.
        """
        doing = "per()"
        with guarded(self.name, key=KEY, doing=doing):
            rates = np.array(self.inner.per(distance_m, height_m), dtype=np.float64)
        if rates.shape != np.shape(distance_m):
            raise PluginError(
                KEY, self.name, f"per() gives shape {rates.shape}, not {np.shape(distance_m)}"
            )
        wrong = np.flatnonzero(~((rates >= 0.0) & (rates <= 1.0)))
        if wrong.size:
            at = wrong[0]
            raise PluginError(
                KEY,
                self.name,
                f"per() gives {rates[at]} at {distance_m[at]:.1f} m, {height_m[at]:.1f} m high: "
                "must be from 0 to 1",
            )
        return rates


def make_radio(gate: str, channel: Channel) -> Channel | CustomRadio:
    """The channel itself, or what the factory that `gate` names makes of it.

    Raises:
        PluginError: it cannot be imported, or what it makes is no radio.
    """
    if gate in MODES:
        return channel
    return CustomRadio(gate, make(gate, channel, key=KEY, members=("per",)))
