"""Cells of the tables of a comparison, of numbers that are given."""

import math
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mission.analysis.comparison_text import (
    COLUMNS,
    in_words,
    leg_rows,
    pair_rows,
    stretch_rows,
)
from mission.analysis.measure import Leg
from mission.analysis.numbers import Comparison, Made, Told, told_numbers
from mission.analysis.spikes import Spike
from mission.analysis.told import Values
from mission.base.tables import annotated

NAN = math.nan


def test_legs_have_their_pass_where_there_are_several() -> None:
    legs = [
        Leg(1, 1, 3, 123.456, 10.04, 20.06, 1.234, 5.678, 0.125, 9.87),
        Leg(1, 2, None, 0.6, NAN, NAN, NAN, NAN, NAN, NAN),
    ]
    heads, rows = leg_rows(legs)
    assert len(heads) == 7
    assert rows == [
        ["1", "3", "123", "10.0 / 20.1", "1.23 / 5.68", "0.12", "9.9"],
        ["2", "-", "1", "- / -", "- / -", "-", "-"],
    ]
    assert [row[0] for row in leg_rows([*legs, Leg(2, 1, 3, *[1.0] * 7)])[1]] == [
        "1.1",
        "1.2",
        "2.1",
    ]


@pytest.mark.parametrize(
    ("reference", "cells"),
    [
        ("mission", ["1.00 / 2.00", "3.00 / 4.00"]), ("position", ["5.00 / 6.00", "7.00 / 8.00"]),
        ("target", ["9.00 / 10.00", "7.00 / 8.00"]), ("velocity", ["5.00 / 6.00", "7.00 / 8.00"]),
    ],
)  # fmt: skip
def test_a_stretch_has_the_errors_against_its_reference(reference: str, cells: list[str]) -> None:
    names = "cross_track_{}_m height_{}_m tracking_{}_m height_tracking_{}_m across_target_{}_m"
    row: dict[str, Any] = {
        name.format(how): float(2 * n + m)
        for n, name in enumerate(names.split())
        for m, how in enumerate(("rms", "max"), start=1)
    }
    row |= {"start_s": 3.4, "end_s": 17.6, "mode": "HOLD", "reference": reference}
    row |= {"attitude_tracking_rms_deg": 0.125, "delay_s": NAN}
    told: Any = SimpleNamespace(stretches=[row])
    heads, rows = stretch_rows(told)
    assert rows == [["3-18", "HOLD", reference, *cells, "0.12", "-"]]
    assert len(heads) == len(rows[0])
    bare: Any = SimpleNamespace(stretches=[{k: v for k, v in row.items() if "rms_m" not in k}])
    assert stretch_rows(bare)[1][0][3].startswith("- / ")


def test_a_pair_has_its_distances_planned_and_flown() -> None:
    row: dict[str, Any] = {"first": "a", "second": "b"}
    for n, way in enumerate(("", "_horizontal", "_vertical"), start=1):
        row |= {f"separation{way}_min_m": 10.0 + n, f"separation{way}_min_t_s": 100.04 + n,
                f"plan_separation{way}_min_m": NAN if n == 2 else 20.0 + n}  # fmt: skip
    row |= {"separation_min_lat_deg": 47.12345678, "separation_min_lon_deg": -8.5,
            "separation_min_height_m": 49.96}  # fmt: skip
    for lost, words in (("", ["11.00", "12.00", "13.00"]), ("a hole", ["not known"] * 3)):
        pair = SimpleNamespace(lost=lambda said=lost: said)
        world: Any = SimpleNamespace(pairs=[pair], rows=[row])
        heads, rows = pair_rows(world)
        assert rows == [[
            "a\nb", f"21.00 / {words[0]}\nat 101.0 s", f"- / {words[1]}\nat 102.0 s",
            f"23.00 / {words[2]}\nat 103.0 s", "47.1234568\n-8.5000000\n50.0 m high",
        ]]  # fmt: skip
        assert len(heads) == 5


def test_what_was_not_compared_or_not_reached_is_said() -> None:
    def passage(seq: int, t_s: float) -> Any:
        return SimpleNamespace(seq=seq, t_s=t_s)

    passes = [SimpleNamespace(passages=[passage(1, 5.0), passage(2, NAN)]),
              SimpleNamespace(passages=[passage(7, NAN)])]  # fmt: skip
    source = SimpleNamespace(skipped={"message": 1, "row": 3})
    data = SimpleNamespace(source=source, battery=SimpleNamespace(t_ns=np.zeros(0)))
    found: Any = SimpleNamespace(
        data=data, apart={"HOLD": 12.34, "LAND": 3.0}, left_out={"DO_X": 2}, passes=passes
    )
    assert in_words(found) == [
        "1 message not read", "3 rows not read",
        "energy not known: the log has no numbers of a battery",
        "flown outside the plan, not compared: HOLD 12.3 s, LAND 3.0 s",
        "items that lead nowhere known here: DO_X (2)", "items never reached: 2, 7",
    ]  # fmt: skip
    assert in_words(found, holes=True)[-1] == "items never reached outside holes: 2, 7"
    known = SimpleNamespace(t_ns=np.zeros(1))
    all_well: Any = SimpleNamespace(
        data=SimpleNamespace(source=SimpleNamespace(skipped={}), battery=known),
        apart={}, left_out={}, passes=[SimpleNamespace(passages=[passage(1, 0.0)])],
    )  # fmt: skip
    assert in_words(all_well) == []


def test_a_spike_alone_names_no_event() -> None:
    assert Spike(1.04, 2.06, "height error", 3.25, 1.5, 1, 4, ()).words == (
        "at 1.0-2.1 s height error 3.2 m, leg 4"
    )


def numbered(**more: Any) -> Any:
    """A comparison whose numbers are 1.23456, 2.23456 and so on, in the order of its fields."""
    names = [field.name for field in fields(Comparison)]
    values: dict[str, Any] = {name: n + 1.23456 for n, name in enumerate(names)}
    return Comparison(**{**values, "round": 1, **more}), values


def test_cells_of_a_round_have_as_many_decimals_as_they_need() -> None:
    counts = {"delivered": 3, "scheduled": 7, "unready": 2, "slots": 9, "slots_missed": 4}
    one, of = numbered(
        plan_duration_s=80.0, duration_s=100.0, plan_objective=0.5, true_objective=0.4, **counts
    )

    def pair(name: str, digits: int, first: str = "rms", unit: str = "m") -> str:
        both = (of[f"{name}_{how}_{unit}"] for how in (first, "max"))
        return " / ".join(f"{value:.{digits}f}" for value in both)

    rates = " / ".join(f"{of[f'{which}_per_mean']:.4f}" for which in ("plan", "est", "true"))
    assert [cell(one) for _, cell in COLUMNS] == [
        f"{of['plan_path_m']:.0f} / {of['flown_path_m']:.0f}", pair("cross_track", 2),
        pair("straight", 2), pair("corner_cut", 2, "mean"), "80.0 / 100.0", "-20.0 %",
        pair("slot_late", 2, "mean", "s"), f"{of['plan_energy_j']:.0f} / {of['energy_j']:.0f}",
        pair("slot_miss", 2), pair("height", 2), pair("estimate", 2), rates,
        f"{of['per_shift_max']:.4f}", f"0.500 / {of['est_objective']:.3f} / 0.400", "3/7", "2",
        "20.00", f"{of['upper_bound']:.3f}", "4 of 9",
    ]  # fmt: skip
    nothing, _ = numbered(duration_s=0.0, plan_objective=0.0, upper_bound=NAN)
    cells = {head: cell(nothing) for head, cell in COLUMNS}
    assert (cells["plan off\nby"], cells["lost %"], cells["proven bound"]) == ("-", "-", "-")


SIGNED = {"height_max_m", "slot_along_max_m", "per_shift_max", "height_tracking_max_m"}
SIGNED |= {"speed_tracking_max_mps", "yaw_tracking_max_deg"}


def reduced(name: str, values: np.ndarray) -> float:
    """By what the name of a number says."""
    known = values[np.isfinite(values)]
    if "_rms" in name:
        return float(np.sqrt(np.mean(np.square(known))))
    if "_mean" in name or "delay" in name:
        return float(np.mean(known))
    if "_min" in name:
        return float(min(known))
    return float(max(abs(known) if name in SIGNED else known))


def test_numbers_are_made_as_they_are_called() -> None:
    """Of two rounds whose samples and slots are pooled, not of their means; NaN where none is."""
    rng = np.random.default_rng(5)
    arrays = {
        how.of: [rng.normal(-1.0, 2.0, n) for n in (5, 9)] for _, how in annotated(Comparison, Made)
    }
    for first, _ in arrays.values():
        first[2] = NAN
    totals = {of: [float(rng.integers(1, 9)), float(rng.integers(10, 19))] for of in arrays}
    rounds: Any = [
        SimpleNamespace(numbers={of: each[n] for of, each in totals.items()},
                        **{of: each[n] for of, each in arrays.items()})
        for n in range(2)
    ]  # fmt: skip
    nothing: Any = [SimpleNamespace(numbers={}, **{of: np.full(3, NAN) for of in arrays})]
    for name, how in annotated(Comparison, Made):
        found = how.by(rounds)
        if name in ("gap_max_s", "gnss_gap_max_s"):
            assert found == max(totals[name]), name
        elif name == "battery_remaining":
            assert found == totals[name][1]
        elif name == "expected":
            assert how.by([rounds[1]]) == pytest.approx((1.0 - arrays["true_per"][1]).sum())
        elif name == how.of:
            assert found == sum(totals[name]), name
            assert math.isnan(how.by(nothing)), name
        else:
            assert found == pytest.approx(reduced(name, np.concatenate(arrays[how.of]))), name
            assert math.isnan(how.by(nothing)), name


def test_numbers_over_time_are_made_as_they_are_called_and_have_a_worst() -> None:
    rng, t_s = np.random.default_rng(6), np.arange(10.0, 20.0)
    series = {
        how.of: Values(t_s, rng.normal(-1.0, 2.0, 10)) for _, how in annotated(Comparison, Told)
    }
    found = told_numbers(series)
    for name, how in annotated(Comparison, Told):
        values = series[how.of].values
        least = "_min" in name
        assert found[name] == pytest.approx(reduced(name, values)), name
        worst = values.argmin() if least else np.abs(values).argmax()
        assert how.worst_s(series[how.of]) == t_s[worst], name
        assert math.isnan(how.worst_s(Values(np.full(1, NAN), values[:1])))
        assert math.isnan(how.worst_s(Values(t_s, np.full(10, NAN))))
    assert all(map(math.isnan, told_numbers({}).values()))
    assert len(found) == len(told_numbers({})) > 30
