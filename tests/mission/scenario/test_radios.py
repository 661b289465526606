"""The radio of a run as its configuration says, true and believed, against its parts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fl.radio.city import Building, City
from fl.radio.per_grid import PerGrid
from fl.radio.place import AverageRadio, LinkTerms, PlacedRadio, Radio, RadioMap, SettledRadio
from flightdyn.random import RandomStreams
from mission.base.arrays import Floats
from mission.config.models import RunConfig
from mission.scenario.radio_maps import home_of, write_map
from mission.scenario.radios import believed, radio_grid, radio_of

HALL = np.array([[90.0, 40.0], [110.0, 40.0], [110.0, 160.0], [90.0, 160.0]])
DEVICES_M = np.array([[20.0, 100.0], [180.0, 90.0]])
TERMS = LinkTerms(4.0, 2e6, 6.0, 9.0, 2.0)


def config(area: dict[str, Any] | None = None, **more: Any) -> RunConfig:
    radio = {
        "tx_power_dbm": 4.0, "bandwidth_hz": 2e6, "noise_figure_db": 6.0, "snr_threshold_db": 9.0,
        "fading_db": 2.0, "device_height_m": 2.0, "carrier_hz": 5.8e9, **more.pop("radio", {}),
    }  # fmt: skip
    hall = {"polygon_m": HALL.tolist(), "height_m": 30.0}
    return RunConfig.model_validate({
        "area": {
            "size_m": (200.0, 200.0), "home_m": (20.0, 30.0), "buildings": [hall], **(area or {}),
        },
        "communities": [{"name": "a", "task": "digits", "devices": 2, "partition": "iid"}],
        "radio": radio, **more,
    })  # fmt: skip


def truth(of: RunConfig, seed: int = 1) -> Radio:
    channel = of.channel.channel(altitude_m=60.0)
    return radio_of(of, channel, of.area.build(), DEVICES_M, RandomStreams(seed))


def belief(of: RunConfig) -> PerGrid:
    channel, area = of.channel.channel(altitude_m=60.0), of.area.build()
    grid, listener = believed(of, channel, truth(of), area, DEVICES_M)
    assert grid is not None
    assert (listener is not None) == of.radio.listens
    return grid


def city(rng: np.random.Generator | None = None) -> City:
    return City(
        [Building((HALL,), 30.0)], DEVICES_M, device_height_m=2.0, carrier_hz=5.8e9,
        environment="UMi", walls="low-loss", rng=rng,
    )  # fmt: skip


def same(one: Radio, other: Radio) -> bool:
    """Whether both give the same rates at the points of a grid of 5 m."""
    x, y = (at.ravel() for at in np.meshgrid(np.arange(0, 201, 5.0), np.arange(0, 201, 5.0)))
    places_m = np.column_stack((x, y, np.full(len(x), 60.0)))
    return all(
        np.allclose(one.per(whom, places_m), other.per(whom, places_m), atol=1e-9)
        for whom in (np.zeros(len(x), dtype=np.int64), np.ones(len(x), dtype=np.int64))
    )


def test_a_channel_may_be_drawn_once_for_each_device_and_run() -> None:
    drawn = config(channel={"correlation_m": 30.0})
    radio = truth(drawn)
    assert isinstance(radio, SettledRadio)
    assert same(radio, truth(drawn))
    assert not same(radio, truth(drawn, seed=2))
    average = truth(config())
    assert isinstance(average, AverageRadio)
    rng = np.random.default_rng(0)
    places_m = np.column_stack((rng.uniform(0, 2e3, (1500, 2)), np.full(1500, 60.0)))
    first = radio.per(np.zeros(1500, dtype=np.int64), places_m)
    assert set(first.tolist()) == {0.0, 1.0}
    rates = average.per(np.zeros(1500, dtype=np.int64), places_m)
    assert first.mean() == pytest.approx(rates.mean(), abs=0.06)
    beside = radio.per(np.zeros(1500, dtype=np.int64), places_m + (0.3, 0.0, 0.0))  # noqa: RUF005
    assert (first == beside).mean() > 0.97


def test_without_a_belief_the_channel_is_planned_with() -> None:
    of = config()
    channel, area = of.channel.channel(altitude_m=60.0), of.area.build()
    assert believed(of, channel, truth(of), area, DEVICES_M) == (None, None)
    believing = config(radio={"belief": "truth"})
    assert same(belief(believing), AverageRadio(channel, DEVICES_M))


def test_buildings_shadow_as_they_are_drawn_or_not_at_all() -> None:
    known, plain = config(radio={"truth": "buildings"}), {"shadowing": False}
    fields = city(RandomStreams(1).generator("shadowing"))
    assert same(truth(known), PlacedRadio(fields, TERMS))
    assert not same(truth(known, seed=2), PlacedRadio(fields, TERMS))
    clear = config(radio={"truth": "buildings", **plain})
    assert same(truth(clear), PlacedRadio(city(), TERMS))
    # Nobody knows the shadowing before: what is believed has its deviation.
    guessed = {"belief": "buildings"}
    assert same(belief(config(radio=guessed)), PlacedRadio(city(), TERMS, city().unknown_db))
    assert same(belief(config(radio={**guessed, **plain})), PlacedRadio(city(), TERMS))
    assert not same(belief(config(radio=guessed)), PlacedRadio(city(), TERMS))
    assert same(belief(config(radio={"truth": "buildings", "belief": "truth"})), truth(known))


def test_a_map_is_believed_or_true(tmp_path: Path) -> None:
    line: Floats = np.arange(2.5, 200.0, 5.0)
    gain_db = -np.random.default_rng(3).uniform(80.0, 120.0, (2, 1, len(line), len(line)))
    made = RadioMap(gain_db, np.array([60.0]), line, line, DEVICES_M)
    write_map(tmp_path / "w.nc", made, {**home_of(config())})
    mapped, file = PlacedRadio(made, TERMS), {"map_file": tmp_path / "w.nc"}
    for roles in ({"truth": "map"}, {"truth": "map", "belief": "map"}):
        radio = truth(config(radio={**roles, **file}))
        assert isinstance(radio, PlacedRadio)
        np.testing.assert_allclose(radio.gains.gain_db(*ASKED), made.gain_db(*ASKED), atol=1e-4)
    for roles in ({"belief": "map"}, {"truth": "map", "belief": "map"},
                  {"truth": "map", "belief": "truth"}):  # fmt: skip
        found = belief(config(radio={**roles, **file}))
        assert np.abs(found.per(*ASKED) - mapped.per(*ASKED)).max() < 1e-3
    learning = {"truth": "map", "belief": "learned", **file}
    by_channel = belief(config(radio=learning))
    by_map = belief(config(radio={**learning, "prior": "map"}))
    assert np.abs(by_map.per(*ASKED) - by_channel.per(*ASKED)).max() > 0.1


ASKED = np.array([0, 1, 1]), np.array([[50.0, 100.0, 60.0], [150.0, 15.0, 60.0], [5.0, 5.0, 60.0]])


@pytest.mark.parametrize(
    ("size_m", "places", "cell_m"),
    [
        ((200.0, 100.0), (21, 41), 5.0),
        ((1600.0, 100.0), (21, 321), 5.0),
        ((3200.0, 1600.0), (161, 321), 10.0),
        ((800.0, 4800.0), (321, 55), 15.0),
    ],
)
def test_a_grid_has_cells_of_5_m_and_no_more_than_320(
    size_m: tuple[float, float], places: tuple[int, int], cell_m: float
) -> None:
    area = config({"size_m": size_m, "buildings": []}).area.build()
    channel = config().channel.channel(altitude_m=60.0)
    grid = radio_grid(AverageRadio(channel, DEVICES_M), channel, area, 2)
    assert grid.success.shape == (2, *places)
    assert (grid.cell_m, grid.first_m) == (cell_m, (0.0, 0.0))
    there_m = np.array([[cell_m * 3, cell_m * 2, 60.0]])
    only = np.array([1])
    per = AverageRadio(channel, DEVICES_M).per(only, there_m)
    assert 1.0 - grid.success[1, 2, 3] == pytest.approx(per[0])
