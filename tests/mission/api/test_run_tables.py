"""Tables, figures and ends of runs as Python is given them, without a flight."""

from pathlib import Path
from typing import Any

import pytest
from synthetic_flight import fly

import aerofed
from mission.api.runs import Figure, chosen, flown, frame
from mission.base.errors import INTERRUPTED
from mission.log.records import DeviceRecord, RoundRecord


def test_samples_are_of_the_round_that_they_lie_in_the_ends_included(tmp_path: Path) -> None:
    fly(tmp_path, rounds=2)
    run = aerofed.load(tmp_path)
    ends = (run.rounds["start_t_s"] + run.rounds["duration_s"]).tolist()
    assert (run.rounds["start_t_s"].tolist(), ends) == ([15.4, 71.5], [71.5, 115.9])
    by_time = dict(zip(run.track["t_s"], run.track["round"], strict=True))
    assert [by_time[t_s] for t_s in (0.0, 15.3, 15.4, 40.0, 71.4)] == [0, 0, 1, 1, 1]
    assert [by_time[t_s] for t_s in (71.5, 100.0, 115.9)] == [2, 2, 2]
    assert run.track.columns[:3].tolist() == ["t_s", "round", "true_x_m"]
    assert run.status == "finished"
    with pytest.raises(aerofed.InputError, match="no table 'tracks'; there are: track, plans, "):
        run.table("tracks")
    log = aerofed.load(tmp_path / "flight.mcap")
    with pytest.raises(aerofed.InputError, match=r'a log has no table of devices; .*"learning"'):
        _ = log.learning


def test_a_table_without_rows_has_its_columns() -> None:
    empty = frame(DeviceRecord, [])
    assert empty.columns.tolist()[:3] == ["round", "device", "community"]
    assert empty["loss"].dtype == float
    assert len(empty) == 0
    rounds = frame(RoundRecord, []).columns
    assert "delivered" in rounds
    assert not any("accuracy" in name for name in rounds)  # of no community
    assert len(frame(None, []).columns) == 0
    assert frame(DeviceRecord, [{"a": 1}]).columns.tolist() == ["a"]


def test_a_figure_that_is_none_of_a_run_is_named_beside_those_that_are() -> None:
    charts: dict[str, Any] = {"map.png": {"m": 1}, "rounds.png": {}}
    assert chosen(charts, "map", of=Path("r")) == Figure("map", {"m": 1})
    assert repr(chosen(charts, "map", of=Path("r"))) == "Figure(name='map')"
    with pytest.raises(aerofed.InputError, match=r"^r: no figure 'x'; there are: 'map', 'rounds'$"):
        chosen(charts, "x", of=Path("r"))
    with pytest.raises(aerofed.InputError, match=r"^r: no figure 'map'; there are: none$"):
        chosen({}, "map", of=Path("r"))


def test_an_interrupted_run_says_how_it_goes_on(tmp_path: Path) -> None:
    seen: list[Any] = []

    def fly(around: Any) -> int:
        seen.append(around)
        return INTERRUPTED if len(seen) < 3 else 0

    with pytest.raises(KeyboardInterrupt, match=r"r was interrupted; resume\('r'\) goes on$"):
        flown(fly, Path("r"), None, quiet=True)
    with pytest.raises(KeyboardInterrupt, match=r"^r was interrupted$"):
        flown(fly, Path("r"), None, quiet=False, goes_on=False, figures=False)
    assert flown(fly, tmp_path, {}, quiet=True) == aerofed.Run(tmp_path)
    assert [around.figures for around in seen] == [True, False, True]
    assert [around.console.out.quiet for around in seen] == [True, False, True]
    with pytest.raises(aerofed.InputError, match="height_maxi_m"):
        flown(fly, tmp_path, {"height_maxi_m": 3.0}, quiet=True)
    assert len(seen) == 3
