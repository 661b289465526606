"""A belief of one number a device: by how much it is heard better, or worse, than the channel says.

Each pilot tone is set beside what was believed at its place before; the mean of that, drawn towards
0 while little was heard, moves the device's SNR everywhere alike. It knows no walls, and needs few
tones (`radio.belief = "learned"` knows places, and needs many).

    aerofed run city --set radio.belief=examples.mean_gain:make
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from aerofed import Heard, LinkTerms, Radio

Floats, Ints = NDArray[np.float64], NDArray[np.int64]

DEVIATION_DB, DOUBT = 10.0, 5.0  # of a place about the channel; counts as so many tones of 0 dB


@dataclass(frozen=True)
class MeanGain:
    """What the channel gives, moved by a mean."""

    prior: Radio
    terms: LinkTerms
    count: int  # K

    def success(self, heard: Heard, place_m: Floats) -> Floats:
        """Of all devices (K,) with the aircraft at places (n, 3)."""
        off_db = heard.snr_db - self._snr_db(heard.device, heard.place_m)
        total_db = np.bincount(heard.device, off_db, self.count)
        mean_db = total_db / (np.bincount(heard.device, minlength=self.count) + DOUBT)
        device = np.repeat(np.arange(self.count), len(place_m))
        snr_db = self._snr_db(device, np.tile(place_m, (self.count, 1))) + mean_db[device]
        over = (snr_db - self.terms.snr_threshold_db) / self._spread_db
        return ndtr(over).reshape(self.count, -1)

    @property
    def _spread_db(self) -> float:
        return float(np.hypot(self.terms.fading_db, DEVIATION_DB))

    def _snr_db(self, device: Ints, place_m: Floats) -> Floats:
        """(n,) the SNR whose PER the channel gives."""
        success = np.clip(1.0 - self.prior.per(device, place_m), 1e-6, 1.0 - 1e-6)
        return self.terms.snr_threshold_db + self._spread_db * ndtri(success)


def make(prior: Radio, terms: LinkTerms, devices_m: Floats) -> MeanGain:
    """What `radio.belief` names."""
    return MeanGain(prior, terms, len(devices_m))
