"""Is the aircraft on the ground? Told from the belief and the thrust alone."""

_CONTACT_S = 0.4  # no descent in spite of the order
_SETTLED_S = 0.3  # and still none with the motors idling
_DESCENT_ORDER_MPS = 0.15
_STILL_MPS = 0.25


class LandDetector:
    """Ground contact, then landed; in the air again once the thrust lifts the aircraft."""

    def __init__(self, *, dt_s: float) -> None:
        self._dt = dt_s
        self._quiet_s = 0.0
        self.contact = True
        self.landed = True

    def update(self, *, armed: bool, descend_mps: float, sink_mps: float, lift: float) -> None:
        """One guidance step.

        `descend_mps`: ordered descent; `sink_mps`: believed one; `lift`: thrust over weight.
        """
        if not armed:
            still = abs(sink_mps) < _STILL_MPS
            self._quiet_s = self._quiet_s + self._dt if still else 0.0
            if self._quiet_s >= _CONTACT_S:
                self.contact = self.landed = True
            return
        if self.landed:
            # Lift beyond weight leaves the ground; a climb tells it too.
            if lift > 1.02 or sink_mps < -0.5:
                self.contact = self.landed = False
                self._quiet_s = 0.0
            return
        ordered = descend_mps > _DESCENT_ORDER_MPS
        if ordered and abs(sink_mps) < _STILL_MPS and lift < 0.92:
            self._quiet_s += self._dt
        else:
            self._quiet_s = 0.0
            self.contact = False
        if self._quiet_s >= _CONTACT_S:
            self.contact = True
        if self._quiet_s >= _CONTACT_S + _SETTLED_S:
            self.landed = True
