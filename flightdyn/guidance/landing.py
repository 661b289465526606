"""Is the aircraft on the ground? Told from the belief and the thrust alone."""

_TOUCH_S = 0.08  # the descent has stopped: the legs may be on the ground
_CONTACT_S = 0.4  # no descent in spite of the order
_SETTLED_S = 0.3  # and still none with the motors idling
_DESCENT_ORDER_MPS = 0.15
_STILL_MPS = 0.25
_FALLING_MPS = 0.9  # motors idle and sinking that fast: that was not the ground
_KNOCK_MPS2 = 8.0  # specific force beyond the thrust: legs on something hard


class LandDetector:
    """Ground contact, then landed; in the air again once the thrust lifts the aircraft."""

    def __init__(self, *, dt_s: float) -> None:
        self._dt = dt_s
        self._quiet_s = 0.0
        self.contact = True
        self.landed = True
        self._told = (True, True, True)

    @property
    def changed(self) -> bool:
        """Whether any of these is another than when this was asked last."""
        before, self._told = self._told, (self.touching, self.contact, self.landed)
        return self._told != before

    @property
    def touching(self) -> bool:
        """The legs may be on the ground: no leaning, no learning from what the sensors feel."""
        return self.contact or self._quiet_s >= _TOUCH_S

    def update(
        self, *, armed: bool, descend_mps: float, sink_mps: float, lift: float, knock_mps2: float
    ) -> None:
        """One guidance step.

        `descend_mps`: ordered descent; `sink_mps`: believed one; `lift`: thrust over weight;
        `knock_mps2`: upward specific force beyond that of the thrust.
        """
        still = abs(sink_mps) < _STILL_MPS
        if self.landed:
            # Lift beyond weight leaves the ground; a climb tells it too.
            if armed and (lift > 1.02 or sink_mps < -0.5):
                self.contact = self.landed = False
                self._quiet_s = 0.0
            return
        if not armed:
            self._count(still)
            self.contact = self.landed = self._quiet_s >= _CONTACT_S
            return
        ordered = descend_mps > _DESCENT_ORDER_MPS
        if self.contact:
            self._count(still)
            if sink_mps > _FALLING_MPS or not ordered:
                self.contact = False
                self._quiet_s = 0.0
            self.landed = self.contact and self._quiet_s >= _SETTLED_S
            return
        self._count(ordered and still and lift < 0.95)
        if self._quiet_s >= _CONTACT_S or (ordered and knock_mps2 > _KNOCK_MPS2):
            self.contact = True
            self._quiet_s = 0.0

    def _count(self, quiet: bool) -> None:
        self._quiet_s = self._quiet_s + self._dt if quiet else 0.0
