"""Tables: exact there and back, and every kind of damage refused with its place."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.base.errors import InputError
from mission.log.records import UNKNOWN_ROUND, RoundRecord, UplinkRecord, flat
from mission.log.tables import Table, read_table

FLOATS = st.floats(allow_nan=False)


def round_record(number: int = 0, **changes: Any) -> RoundRecord:
    values: dict[str, Any] = {
        "round": number, "start_t_s": 15.4, "duration_s": 45.8, "plan_objective": 0.45,
        "est_objective": 0.44, "true_objective": 0.43, "upper_bound": math.inf,
        "plan_path_m": 687.25, "flown_path_m": 685.5, "budget_used_m": 685.5, "scheduled": 3,
        "delivered": 2, "battery_remaining": 0.949,
        "plan_altitude_m": 60.0, "plan_duration_s": 45.0, "plan_energy_j": 9e3,
        "energy_j": 9.1e3, "time_used_s": 45.8, "energy_used_j": 9.1e3,
        "accuracy": {"digits": 0.5, 'a "b", c': 1 / 3}, "cov": {"digits": 1.0, 'a "b", c': 0.1},
    }  # fmt: skip
    return dataclasses.replace(UNKNOWN_ROUND, **{**values, **changes})


def uplink(round_number: int = 0, **changes: Any) -> UplinkRecord:
    record = UplinkRecord(
        round_number, 3, "digits", 1, 25.9, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 0.1, 0.2,
        0.3, 0.25, delivered=True,
    )  # fmt: skip
    return dataclasses.replace(record, **changes)


def write(path: Path, *records: RoundRecord) -> Path:
    with Table(path, RoundRecord, communities=["digits", 'a "b", c']) as table:
        for record in records:
            table.extend([record])
    return path


@settings(max_examples=60, deadline=None)
@given(
    floats=st.lists(FLOATS, min_size=3, max_size=3),
    count=st.integers(0, 10**12),
    flag=st.booleans(),
)
def test_every_float_comes_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, floats: list[float], count: int, flag: bool
) -> None:
    folder = tmp_path_factory.mktemp("t")
    a, b, c = floats
    record = round_record(count, duration_s=a, accuracy={"digits": b, 'a "b", c': c})
    assert read_table(write(folder / "r.csv", record), RoundRecord) == (record,)
    sent = uplink(count, plan_x_m=a, true_per=b, delivered=flag)
    with Table(folder / "u.csv", UplinkRecord) as table:
        table.extend([sent])
    assert read_table(folder / "u.csv", UplinkRecord) == (sent,)


def test_nan_means_no_value(tmp_path: Path) -> None:
    path = write(tmp_path / "r.csv", round_record(upper_bound=math.nan))
    assert ",nan," in path.read_text()
    assert math.isnan(read_table(path, RoundRecord)[0].upper_bound)


def test_columns_are_the_records_fields_with_communities_spread(tmp_path: Path) -> None:
    header = write(tmp_path / "r.csv").read_text()
    assert header == (
        "round,start_t_s,duration_s,plan_objective,est_objective,true_objective,upper_bound,"
        "plan_path_m,flown_path_m,budget_used_m,scheduled,delivered,battery_remaining,"
        'accuracy_digits,"accuracy_a ""b"", c",cov_digits,"cov_a ""b"", c",'
        "plan_altitude_m,plan_duration_s,plan_energy_j,energy_j,time_used_s,energy_used_j\n"
    )


def test_a_row_is_in_the_file_as_soon_as_it_is_appended(tmp_path: Path) -> None:
    table = Table(tmp_path / "r.csv", RoundRecord, communities=["digits", 'a "b", c'])
    for number in range(3):
        table.extend([round_record(number)])
        assert len(read_table(tmp_path / "r.csv", RoundRecord)) == number + 1
    table.close()
    table.close()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda _: "", "the file is empty"),
        (lambda t: t[:-1], "line 3: the last row is cut short"),
        (lambda t: t.replace("45.8", "fast"), r"line 2: duration_s = 'fast': must be a number"),
        (lambda t: t.replace("\n1,", "\n1.5,"), "line 3: round = '1.5': must be a whole number"),
        (lambda t: t.replace(",0.949", ""), "line 2: 22 values for 23 columns"),
        (lambda t: t.replace(",duration_s", ",length_s"), "missing duration_s; unknown length_s"),
        (lambda t: t.replace("scheduled,delivered", "delivered,scheduled"), "their order"),
    ],
)
def test_damage_is_refused_with_file_and_line(tmp_path: Path, damage, message: str) -> None:
    path = write(tmp_path / "r.csv", round_record(0), round_record(1))
    path.write_text(damage(path.read_text()))
    with pytest.raises(InputError, match=message) as caught:
        read_table(path, RoundRecord)
    assert str(path) in str(caught.value)


def test_files_that_are_no_text_or_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_table(tmp_path / "u.csv", UplinkRecord)
    (tmp_path / "u.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        read_table(tmp_path / "u.csv", UplinkRecord)
    with pytest.raises(InputError, match="cannot write"):
        Table(tmp_path / "no" / "u.csv", UplinkRecord)


def test_a_boolean_must_be_one(tmp_path: Path) -> None:
    path = tmp_path / "u.csv"
    with Table(path, UplinkRecord) as table:
        table.extend([uplink()])
    path.write_text(path.read_text().replace("true\n", "yes\n"))
    with pytest.raises(InputError, match="delivered = 'yes': must be true or false"):
        read_table(path, UplinkRecord)


def test_a_table_of_before_lacks_what_may_be_missing(tmp_path: Path) -> None:
    path = write(tmp_path / "r.csv", round_record(0))
    head, row, _ = path.read_text().split("\n")
    for cut in range(1, 7):  # plan_altitude_m and all after it came later, one by one
        path.write_text(
            "\n".join((*(",".join(line.split(",")[:-cut]) for line in (head, row)), ""))
        )
        (found,) = read_table(path, RoundRecord)
        last = head.split(",")[-cut:]
        assert all(math.isnan(getattr(found, name)) for name in last)
        assert found.battery_remaining == round_record(0).battery_remaining


def test_uplinks_say_by_whom_where_there_are_several(tmp_path: Path) -> None:
    for sent in (uplink(3), uplink(3, aircraft="north")):
        several = bool(sent.aircraft)
        with Table(tmp_path / "u.csv", UplinkRecord, several=several) as table:
            table.extend([sent])
        assert (",aircraft\n" in (tmp_path / "u.csv").read_text()) == several
        assert read_table(tmp_path / "u.csv", UplinkRecord) == (sent,)
        assert ("aircraft" in flat(sent)) == several
