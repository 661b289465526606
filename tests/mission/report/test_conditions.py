"""Wind and the estimator's innovations: from the aircraft into the log and back."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from synthetic_flight import AREA, devices

from flightdyn.config import AircraftConfig, WindConfig
from flightdyn.faults import GnssJump
from flightdyn.random import RandomStreams
from flightdyn.state import Innovation
from mission.log.export import tables
from mission.log.reader import read_log
from mission.log.topics import fields
from mission.log.values import FlightData
from mission.log.vehicle import RATES_HZ
from mission.log.writer import FlightLog
from sitl.config import VehicleConfig
from sitl.observer import VehicleEvent, VehicleSample
from sitl.vehicle import Vehicle

SECONDS = 8
WIND = WindConfig(speed_mps=5.0, from_deg=270.0)


class Samples:
    def __init__(self) -> None:
        self.samples: list[VehicleSample] = []

    def sampled(self, sample: VehicleSample) -> None:
        self.samples.append(sample)

    def happened(self, event: VehicleEvent) -> None:
        del event

    @property
    def innovations(self) -> list[Innovation]:
        return [item for sample in self.samples for item in sample.innovations]


def record(path: Path, *, sample_rate_hz: float = 10.0) -> Samples:
    """A vehicle at rest in the wind, whose receiver jumps away for a second."""
    config = VehicleConfig(aircraft=AircraftConfig(wind=WIND), sample_rate_hz=sample_rate_hz)
    vehicle = Vehicle(config, home=AREA.home, streams=RandomStreams(3))
    kept = Samples()
    with FlightLog(path, area=AREA, devices=devices(np.random.default_rng(1))) as log:
        vehicle.add_observer(log)
        vehicle.add_observer(kept)
        while vehicle.t_ns < SECONDS * 1_000_000_000:
            if vehicle.t_ns == 4_000_000_000:
                vehicle.aircraft.inject(GnssJump(east_m=60.0, duration_s=1.0))
            vehicle.step()
    return kept


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Samples, FlightData]:
    path = tmp_path_factory.mktemp("full") / "a.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(RATES_HZ, "innovations", 10.0)
        kept = record(path)
    return kept, read_log(path)


def test_every_innovation_is_sampled_once(flown: tuple[Samples, FlightData]) -> None:
    found = [(item.t_ns, item.kind) for item in flown[0].innovations]
    assert len(found) == len(set(found))
    assert found == sorted(found, key=lambda item: item[0])
    for kind in ("gnss position", "gnss velocity", "baro", "heading"):
        instants = np.array([t_ns for t_ns, name in found if name == kind])
        np.testing.assert_array_equal(np.diff(instants)[1:], 200_000_000)  # as the receiver
        assert instants[-1] > (SECONDS - 1) * 1e9


def test_slow_sampling_loses_none(tmp_path: Path, flown: tuple[Samples, FlightData]) -> None:
    slow = record(tmp_path / "slow.mcap", sample_rate_hz=1.0)
    fast = flown[0].innovations
    assert slow.innovations == [i for i in fast if i.t_ns <= slow.innovations[-1].t_ns]


def test_what_the_log_says_is_what_was_sampled(flown: tuple[Samples, FlightData]) -> None:
    kept, data = flown
    for kind, track in data.innovations.items():
        mine = [item for item in kept.innovations if item.kind == kind]
        np.testing.assert_array_equal(track.t_ns, [item.t_ns for item in mine])
        np.testing.assert_allclose(track.values, [item.values for item in mine], rtol=5e-4)
        np.testing.assert_allclose(track.stds, [item.stds for item in mine], rtol=5e-4)
        np.testing.assert_allclose(track.ratio, [item.ratio for item in mine], rtol=5e-4)
        np.testing.assert_array_equal(track.accepted, [item.accepted for item in mine])
    refused = data.innovations["gnss position"]
    assert refused.t_ns[~refused.accepted][0] == pytest.approx(4e9, abs=0.3e9)
    np.testing.assert_allclose(refused.values[~refused.accepted][:, 1], 60.0, atol=4.0)
    rows = tables(data)["innovations"]
    assert len(rows["t_s"]) == sum(track.values.size for track in data.innovations.values())


def test_at_the_default_rate_what_was_refused_is_still_all_there(tmp_path: Path) -> None:
    path = tmp_path / "default.mcap"
    kept = record(path)
    track = read_log(path).innovations["gnss position"]
    mine = [item for item in kept.innovations if item.kind == "gnss position"]
    assert SECONDS - 1 <= track.accepted.sum() <= SECONDS + 1
    np.testing.assert_array_equal(
        track.t_ns[~track.accepted], [item.t_ns for item in mine if not item.accepted]
    )
    assert (~track.accepted).sum() >= 4


def test_wind_blows_east_where_it_comes_from_the_west(
    flown: tuple[Samples, FlightData],
) -> None:
    wind = flown[1].wind
    np.testing.assert_allclose(np.diff(wind.t_ns)[1:], 1e9)
    np.testing.assert_allclose(wind.vel_mps, [(5.0, 0.0, 0.0)] * len(wind.t_ns), atol=1e-3)
    assert list(tables(flown[1])["wind"]) == ["t_s", "east_mps", "north_mps", "up_mps"]


def test_the_schema_names_every_sensor(tmp_path: Path) -> None:
    path = tmp_path / "schema.mcap"
    record(path)
    with path.open("rb") as stream:
        for schema, _, message in make_reader(stream).iter_messages(topics=["/innovations"]):
            assert schema is not None
            values = json.loads(message.data)
            assert list(values) == list(fields(schema.data))
