"""Options that commands share: paces, ports, offsets, and `--set` for one of several."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from mission.base.errors import InputError
from mission.commands.options import (
    console,
    given_offsets,
    load,
    pace_of,
    print_json,
    single,
    tell,
)


def test_paces_are_more_than_none_and_at_most_a_thousand() -> None:
    assert pace_of("max") == math.inf
    assert [pace_of(speed) for speed in (1e-3, 1.0, 1000.0)] == [1e-3, 1.0, 1000.0]
    for wrong in (0.0, -1.0, 1000.5, math.nan):
        with pytest.raises(
            InputError, match=rf"^--speed {wrong:g}: more than 0 and at most 1000, "
        ):
            pace_of(wrong)


def test_ports_of_the_live_view() -> None:
    assert [console(quiet=True, live=True, live_port=port).live_port for port in (0, 65535)] == [
        *(0, 65535),
    ]  # fmt: skip
    shown = console(quiet=False, live=False, live_port=1)
    assert (shown.live_port, shown.out.quiet) == (None, False)
    assert console(quiet=True, live=False, live_port=1).out.quiet
    for wrong in (-1, 65536):
        with pytest.raises(InputError, match=f"^--live-port {wrong}: must be from 0 to 65535$"):
            console(quiet=True, live=False, live_port=wrong)


def test_offsets_are_seconds_by_log() -> None:
    assert given_offsets(["a=b.ulg=12.5", "c.ulg=-3", "d=1e2"]) == {
        "a=b.ulg": 12.5, "c.ulg": -3.0, "d": 100.0
    }  # fmt: skip
    assert given_offsets([]) == {}
    for wrong in ("b.ulg", "b.ulg=", "b.ulg=soon"):
        with pytest.raises(InputError, match=f"^--offset {wrong}: must be LOG=SECONDS"):
            given_offsets([wrong])


def test_what_is_set_for_one_stands_over_what_is_set_for_all() -> None:
    common, own = single(["a=1", "uav-2:a=2", "b=x:y", "uav-2:c=3", "uav-1:b=4", "uav-2:d=k=5"])
    assert common == ("a=1", "b=x:y")
    assert own == {"uav-2": ["b=x:y", "a=2", "c=3", "d=k=5"], "uav-1": ["a=1", "b=4"]}
    assert single(["a=1"]) == (("a=1",), {})
    assert single([]) == ((), {})


def test_options_stand_over_usual_values_and_clash_with_set() -> None:
    usual = {"seed": 5, "mission.rounds": 4}
    found = load(None, ["mission.rounds=3"], {"seed": None}, usual=usual)
    assert (found.seed, found.mission.rounds) == (5, 3)
    assert load(None, [], {"seed": 7}, usual=usual).seed == 7
    with pytest.raises(InputError, match=r"^--set seed: given twice"):
        load(None, ["seed=1", "seed=1"])
    clash = "^--set area.home_lat_deg: --home sets it too; leave one of them out"
    with pytest.raises(InputError, match=clash):
        load(None, ["area.home_lat_deg=1"], {"area.home_lat_deg": 2.0})
    assert load(None, ["seed=1"], {"seed": None}).seed == 1


def test_json_has_null_for_what_is_no_number(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": math.nan, "b": [math.inf, 1.5], "c": np.arange(2), "d": Path("x"), "e": "é"})
    text = capsys.readouterr().out
    assert json.loads(text) == {"a": None, "b": [None, 1.5], "c": [0, 1], "d": "x", "e": "é"}
    assert text.isascii()
    assert text.startswith('{\n  "a": null,')
    tell({"a": 1}, ["one", 2], as_json=False)
    assert capsys.readouterr().out == "one\n2\n"
    tell([1], ["one"], as_json=True)
    assert capsys.readouterr().out == "[\n  1\n]\n"
