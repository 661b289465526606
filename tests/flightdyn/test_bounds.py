"""What is documented as allowed can be flown: take-off and landing at the ends of bounds.

The bounds are read from the configuration, so that a wider one has to pass here.
"""

from typing import Any

import annotated_types
import numpy as np
import pytest
from flights import make, run, take_off
from pydantic import BaseModel, ValidationError

from flightdyn.aircraft import Aircraft
from flightdyn.config import AircraftConfig, GnssConfig, ImuConfig, MagConfig, SensorsConfig
from flightdyn.guidance.pursuit import Target


def least(model: type[BaseModel], key: str) -> Any:
    return next(m.ge for m in model.model_fields[key].metadata if isinstance(m, annotated_types.Ge))


def most(model: type[BaseModel], key: str) -> Any:
    return next(m.le for m in model.model_fields[key].metadata if isinstance(m, annotated_types.Le))


def met_and_bounced(aircraft: Aircraft) -> tuple[float, float]:
    """Up and down at 0.7 m/s: the speed (m/s) that the ground is met with, the height (m) after."""
    take_off(aircraft, 3.0)
    aircraft.pursue(Target(vel=(0.0, 0.0, 0.7), yaw=0.0))
    seen: list[tuple[float, float]] = []

    def stands() -> bool:
        seen.append((-aircraft.truth.pos_ned_m[2], aircraft.truth.vel_ned_mps[2]))
        return aircraft.on_ground

    assert run(aircraft, 20.0, stands)
    assert not aircraft.crashed
    heights_m, down_mps = np.array(seen).T
    met = int((heights_m < 0.02).argmax())
    return float(down_mps[met]), float(heights_m[met:].max())


def test_at_the_lowest_rate_the_ground_is_met_softly() -> None:
    hz = least(AircraftConfig, "physics_hz")
    for seed in (1, 2):
        met_mps, bounced_m = met_and_bounced(
            make(seed=seed, sensors=SensorsConfig(), physics_hz=hz)
        )
        assert 0.5 < met_mps < 0.8
        assert bounced_m < 0.04


@pytest.mark.parametrize("rates", [(200, 0.1), (1000, 0.02)], ids=["slow", "fast"])
def test_with_the_noisiest_imu_it_lands(rates: tuple[int, float]) -> None:
    """White noise grows with the rate of the samples, and less of it is averaged at some rates."""
    keys = ("gyro_noise_density", "accel_noise_density")
    imu = ImuConfig(**{key: most(ImuConfig, key) for key in keys})
    hz, interval_s = rates
    for seed in (1, 2):
        aircraft = make(
            seed=seed,
            sensors=SensorsConfig(imu=imu),
            physics_hz=hz,
            guidance_interval_s=interval_s,
        )
        met_mps, bounced_m = met_and_bounced(aircraft)
        assert met_mps < 0.9
        assert bounced_m < 0.1


def test_with_the_worst_receiver_and_magnetometer_it_gets_ready() -> None:
    receiver = GnssConfig(std_horizontal_m=most(GnssConfig, "std_horizontal_m"))
    magnetometer = MagConfig(hard_iron_gauss=most(MagConfig, "hard_iron_gauss"))
    for seed in range(1, 9):
        sensors = SensorsConfig(gnss=receiver, mag=magnetometer)
        assert not make(seed=seed, sensors=sensors).why_not_ready
    with pytest.raises(ValidationError, match="less than or equal to"):
        GnssConfig(std_horizontal_m=20.0)
