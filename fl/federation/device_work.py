"""How long devices train, and what each of them is at work on.

A device takes the model that comes down at the start of a round, trains, and then has something
to send. Where it is late, it either loses what it has done or goes on with it (`learning.late`).
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from fl.arrays import Bools, Floats, Ints
from fl.config import CommunityConfig


def compute_times(
    config: CommunityConfig, samples: Ints, *, epochs: int, rng: np.random.Generator
) -> Floats:
    """Return the training time of each device of a community in seconds, (K_c,).

    `samples` (K_c,): of each device. `rng`: the community's own stream of compute times.
    """
    own_s: Floats = (config.compute_s_per_sample or 0.0) * epochs * samples.astype(np.float64)
    if config.compute_times_s is not None:
        return np.array(config.compute_times_s, dtype=np.float64) + own_s
    if isinstance(config.compute_s, tuple):
        return rng.uniform(*config.compute_s, len(samples)) + own_s
    return (config.compute_s or 0.0) + own_s


@dataclass(frozen=True, eq=False)
class DeviceWork:
    """Work of the devices: which round's model each trains from, and when it is or was done."""

    compute_s: Floats  # (K,)
    goes_on: bool  # a device that is late, or still trains as a round begins, keeps at it
    begun: Ints  # (K,) round whose model it took; 0: none yet
    ready_ns: Ints  # (K,) when its update is ready to be sent
    owed: Bools  # (K,) was asked for this update before it was ready, and has not sent it yet

    @classmethod
    def before(cls, compute_s: Floats, *, goes_on: bool) -> Self:
        """Return the work before the first round: every device is idle."""
        none = np.zeros(len(compute_s), dtype=np.int64)
        return cls(compute_s, goes_on, none, none, none.astype(np.bool_))

    def round_begins(self, number: int, t_ns: int) -> Self:
        """Return the work after the model of round `number` (from 1) came down at `t_ns`.

        Every device begins anew from it, except those that go on with older work: they still train,
        or have not sent an update that they were asked for too early.
        """
        anew = ~self.kept(t_ns)
        done_ns = t_ns + np.rint(1e9 * self.compute_s).astype(np.int64)
        return replace(
            self,
            begun=np.where(anew, number, self.begun),
            ready_ns=np.where(anew, done_ns, self.ready_ns),
        )

    def round_ends(self, *, late: Bools, sent: Bools) -> Self:
        """Return the work after a round: `late` (K,) were asked before ready, `sent` (K,) sent."""
        return replace(self, owed=(self.owed | late) & ~sent)

    def kept(self, t_ns: int) -> Bools:
        """Return which devices (K,) go on with older work when a model comes down at `t_ns`."""
        return self.goes_on & (self.owed | (self.ready_ns > t_ns))
