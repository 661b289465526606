"""Named random streams from one root seed.

Every consumer of randomness asks for its stream by name, so that adding a consumer changes
nobody else's draws and no draw depends on the order in which consumers were made.
"""

import hashlib

import numpy as np

_WEATHER = "wind"  # the stream that turbulence is made from


class RandomStreams:
    """Independent random streams, each a function of the root seed and a name alone."""

    def __init__(self, root_seed: int, place: "RandomStreams | None" = None) -> None:
        """`place`: where the weather is made, if it is not made from this seed."""
        self.root_seed, self._place = root_seed, place

    def of_vehicle(self, number: int) -> "RandomStreams":
        """Streams of one of several vehicles, from 0: its own, but for the weather, which all
        share. Number 0 has those of a single one."""
        return RandomStreams(self.seed(f"vehicle/{number}"), self) if number else self

    def sequence(self, name: str) -> np.random.SeedSequence:
        """The seed sequence of `name`; the same for the same root seed and name, always."""
        if self._place is not None and name == _WEATHER:
            return self._place.sequence(name)
        digest = hashlib.sha256(name.encode()).digest()
        words = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
        return np.random.SeedSequence(self.root_seed, spawn_key=words)

    def generator(self, name: str) -> np.random.Generator:
        """A fresh generator at the start of the stream `name`."""
        return np.random.Generator(np.random.PCG64(self.sequence(name)))

    def seed(self, name: str) -> int:
        """A 63-bit seed for libraries with generators of their own (torch, JSBSim)."""
        return int(self.sequence(name).generate_state(1, np.uint64)[0] >> np.uint64(1))
