"""Parameters: the table, the protocol over the wire, and the files."""

import struct
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, of, the

from native.errors import InputError
from sitl.autopilot.codec.orders import Outbox, Peer
from sitl.autopilot.parameters import (
    TABLE,
    Parameters,
    load_parameters,
    save_parameters,
)
from sitl.autopilot.protocol.parameter_server import ParameterServer
from sitl.config import VehicleConfig

REAL, INT = mav.MAV_PARAM_TYPE_REAL32, mav.MAV_PARAM_TYPE_INT32


def bytewise(value: int) -> float:
    """An integer as PX4 sends it: its bytes in a float."""
    return float(struct.unpack("<f", struct.pack("<i", value))[0])


def set_parameter(desk: Desk, name: str, value: float, kind: int) -> list[Any]:
    return desk.send(mav.MAVLink_param_set_message(1, 1, name.encode(), value, kind))


def test_the_table_can_be_sent_and_its_defaults_are_allowed() -> None:
    parameters = Parameters()
    for spec in TABLE:
        assert len(spec.name) <= 16
        assert parameters.set(spec.name, spec.default), spec.name
        assert spec.text
    assert [spec.name for spec in TABLE] == sorted({spec.name for spec in TABLE})


def test_listing_comes_in_bursts_and_whole() -> None:
    desk = Desk()
    heard = desk.send(mav.MAVLink_param_request_list_message(1, 1))
    assert 0 < len(of(heard, "PARAM_VALUE")) < len(TABLE)
    heard += desk.pass_wall_time(0.5, step=0.01)
    values = of(heard, "PARAM_VALUE")
    assert [value.param_index for value in values] == list(range(len(TABLE)))
    assert {value.param_count for value in values} == {len(TABLE)}
    assert [value.param_id for value in values] == [spec.name for spec in TABLE]


def test_reading_by_name_and_index() -> None:
    desk = Desk()
    by_name = the(
        desk.send(mav.MAVLink_param_request_read_message(1, 1, b"RTL_RETURN_ALT", -1)),
        "PARAM_VALUE",
    )
    assert (by_name.param_value, by_name.param_type) == (30.0, REAL)
    by_index = the(
        desk.send(mav.MAVLink_param_request_read_message(1, 1, b"", by_name.param_index)),
        "PARAM_VALUE",
    )
    assert by_index.param_id == "RTL_RETURN_ALT"
    integer = the(
        desk.send(mav.MAVLink_param_request_read_message(1, 1, b"GF_ACTION", -1)), "PARAM_VALUE"
    )
    assert integer.param_type == INT
    assert struct.pack("<f", integer.param_value) == struct.pack("<i", 2)
    for name, index in ((b"NO_SUCH", -1), (b"", len(TABLE)), (b"", -2)):
        heard = desk.send(mav.MAVLink_param_request_read_message(1, 1, name, index))
        assert the(heard, "PARAM_ERROR").error == mav.MAV_PARAM_ERROR_DOES_NOT_EXIST


def test_writing_is_answered_with_the_value_that_stands() -> None:
    desk = Desk()
    parameters = desk.vehicle.autopilot.parameters
    heard = set_parameter(desk, "MPC_LAND_SPEED", 0.9, REAL)
    assert the(heard, "PARAM_VALUE").param_value == pytest.approx(0.9)
    assert parameters["MPC_LAND_SPEED"] == 0.9  # not 0.899999976
    index = the(heard, "PARAM_VALUE").param_index
    assert TABLE[index].name == "MPC_LAND_SPEED"
    heard = set_parameter(desk, "GF_ACTION", bytewise(3), INT)
    assert parameters["GF_ACTION"] == 3.0

    heard = set_parameter(desk, "MPC_LAND_SPEED", 50.0, REAL)
    assert the(heard, "PARAM_ERROR").error == mav.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
    assert the(heard, "PARAM_VALUE").param_value == pytest.approx(0.9)
    for name, value, kind in (
        ("MPC_LAND_SPEED", float("nan"), REAL),
        ("MPC_LAND_SPEED", bytewise(1), INT),
        ("GF_ACTION", 3.0, REAL),
        ("GF_ACTION", bytewise(17), INT),
    ):
        heard = set_parameter(desk, name, value, kind)
        assert len(of(heard, "PARAM_ERROR")) == 1, name
    heard = set_parameter(desk, "NO_SUCH", 1.0, REAL)
    assert the(heard, "PARAM_ERROR").error == mav.MAV_PARAM_ERROR_DOES_NOT_EXIST
    assert not of(heard, "PARAM_VALUE")
    assert (parameters["MPC_LAND_SPEED"], parameters["GF_ACTION"]) == (0.9, 3.0)


# What MAVLink's union of a parameter's value holds, by the type that the message names.
FORMS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}
FORMS_OF_EIGHT = {7: "<Q", 8: "<q", 10: "<d"}


def in_the_field(data: bytes) -> float:
    """The first four bytes of a union, as the field carries them."""
    return float(struct.unpack("<f", data[:4].ljust(4, b"\0"))[0])


@pytest.mark.parametrize("kind", FORMS)
def test_an_integer_of_any_type_that_fits_is_the_number_that_was_meant(kind: int) -> None:
    desk = Desk()
    parameters = desk.vehicle.autopilot.parameters
    for number in (4, 5, 0, 3, 1):
        value = in_the_field(struct.pack(FORMS[kind], number))
        heard = set_parameter(desk, "GF_ACTION", value, kind)
        assert parameters["GF_ACTION"] == number
        stands = the(heard, "PARAM_VALUE")
        assert stands.param_type == INT
        assert struct.pack("<f", stands.param_value) == struct.pack("<i", number)
        assert not of(heard, "PARAM_ERROR")


@given(
    kind=st.sampled_from([*range(13), 200]),
    data=st.one_of(
        st.binary(min_size=4, max_size=4),
        st.floats(-8, 8, width=32).map(lambda value: struct.pack("<f", value)),
        st.integers(-300, 300).map(lambda value: struct.pack("<i", value)),
        st.integers(-128, 127).map(lambda value: struct.pack("<bxxx", value)),
    ),
)
def test_a_parameter_is_the_number_that_was_meant_or_stays(kind: int, data: bytes) -> None:
    """Another encoding of a number, or bytes of no number at all, never become another one."""
    parameters = Parameters()
    outbox = Outbox()
    server = ParameterServer(outbox, parameters, None)
    handle = server.handlers[mav.MAVLink_param_set_message]
    value = in_the_field(data)
    handle(Peer(255, 190), mav.MAVLink_param_set_message(1, 1, b"GF_ACTION", value, kind), 0.0)
    meant = None
    if kind in FORMS:
        form = FORMS[kind]
        (number,) = struct.unpack_from(form, data)
        # A sender fills what is left of the union with zeros, or extends the sign.
        filled = {struct.pack(form, number).ljust(4, fill) for fill in (b"\0", b"\xff")}
        if number >= 0:
            filled = {struct.pack(form, number).ljust(4, b"\0")}
        if data in filled and 0 <= number <= 5:
            meant = float(number)
    assert parameters["GF_ACTION"] == (2.0 if meant is None else meant)
    assert len(of([body for _, body in outbox.take()], "PARAM_ERROR")) == (meant is None)


@pytest.mark.parametrize("kind", FORMS_OF_EIGHT)
def test_a_type_of_eight_bytes_has_no_room_and_is_refused(kind: int) -> None:
    desk = Desk()
    value = in_the_field(struct.pack(FORMS_OF_EIGHT[kind], 4))
    for name in ("GF_ACTION", "RTL_RETURN_ALT"):
        before = desk.vehicle.autopilot.parameters[name]
        heard = set_parameter(desk, name, value, kind)
        assert the(heard, "PARAM_ERROR").error == mav.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
        assert desk.vehicle.autopilot.parameters[name] == before


@pytest.mark.parametrize("kind", [*FORMS, *FORMS_OF_EIGHT])
def test_a_real_parameter_takes_no_integer(kind: int) -> None:
    desk = Desk()
    for value in (40.0, bytewise(40)):
        assert of(set_parameter(desk, "RTL_RETURN_ALT", value, kind), "PARAM_ERROR")
    assert desk.vehicle.autopilot.parameters["RTL_RETURN_ALT"] == 30.0


@pytest.mark.parametrize("value", ["2.6", "0.4", "-0.4", "5.4", "1e-45"])
def test_no_fraction_is_rounded_to_a_choice(tmp_path: Path, value: str) -> None:
    allowed = "must be a whole number from 0 to 5"
    with pytest.raises(InputError, match=f"GF_ACTION = .*: {allowed}"):
        Desk(VehicleConfig(parameters={"GF_ACTION": float(value)}))
    path = tmp_path / "vehicle.parm"
    path.write_text(f"GF_ACTION {value}\n")
    with pytest.raises(InputError, match=f"vehicle.parm: GF_ACTION = .*: {allowed}"):
        Desk(VehicleConfig(parameter_file=path))
    path.write_text("")
    desk = Desk(VehicleConfig(parameter_file=path))
    path.write_text(f"RTL_RETURN_ALT 50\nGF_ACTION {value}\n")
    assert desk.command(mav.MAV_CMD_PREFLIGHT_STORAGE, 0) == mav.MAV_RESULT_FAILED
    assert desk.vehicle.autopilot.parameters.as_dict() == Parameters().as_dict()


def test_a_parameter_rules_the_next_order() -> None:
    desk = Desk()
    set_parameter(desk, "MIS_TAKEOFF_ALT", 42.0, REAL)
    desk.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    desk.command(mav.MAV_CMD_NAV_TAKEOFF)
    desk.fly()
    assert desk.mass.belief.alt_rel_m == pytest.approx(42.0)


@given(st.sampled_from(TABLE), st.floats(0, 1))
def test_files_keep_every_value(spec: Any, share: float) -> None:
    parameters = Parameters()
    value = spec.low + share * (spec.high - spec.low)
    parameters.set(spec.name, value)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "vehicle.parm"
        save_parameters(path, parameters.as_dict())
        back = Parameters()
        back.apply(load_parameters(path), "file")
        assert back.as_dict() == parameters.as_dict()
        assert [item.name for item in Path(folder).iterdir()] == ["vehicle.parm"]


def test_both_formats_of_ground_stations_are_read(tmp_path: Path) -> None:
    mavproxy = tmp_path / "a.parm"
    mavproxy.write_text("# comment\nRTL_RETURN_ALT   45.5\nGF_ACTION,3 # remark\n\n")
    assert load_parameters(mavproxy) == {"RTL_RETURN_ALT": 45.5, "GF_ACTION": 3.0}
    qgc = tmp_path / "b.params"
    qgc.write_text("# Onboard parameters\n1\t1\tRTL_RETURN_ALT\t45.5\t9\n1\t1\tGF_ACTION\t3\t6\n")
    assert load_parameters(qgc) == {"RTL_RETURN_ALT": 45.5, "GF_ACTION": 3.0}


@pytest.mark.parametrize("line", ["RTL_RETURN_ALT", "RTL_RETURN_ALT high", "1 1 GF_ACTION 3"])
def test_a_bad_line_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "bad.parm"
    path.write_text(f"GF_ACTION 1\n{line}\n")
    with pytest.raises(InputError, match=r"bad\.parm, line 2"):
        load_parameters(path)


def test_configuration_and_file_are_checked_when_the_vehicle_is_made(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"SPEED = 3: no such parameter \(known: BAT_"):
        Desk(VehicleConfig(parameters={"SPEED": 3.0}))
    with pytest.raises(InputError, match="GF_ACTION = 9: must be a whole number from 0"):
        Desk(VehicleConfig(parameters={"GF_ACTION": 9.0}))
    path = tmp_path / "start.parm"
    path.write_text("RTL_RETURN_ALT 45\nMPC_XY_CRUISE 12\n")
    desk = Desk(VehicleConfig(parameter_file=path, parameters={"MPC_XY_CRUISE": 7.0}))
    parameters = desk.vehicle.autopilot.parameters
    assert (parameters["RTL_RETURN_ALT"], parameters["MPC_XY_CRUISE"]) == (45.0, 7.0)
    path.write_text("RTL_RETURN_ALT 4500\n")
    with pytest.raises(InputError, match=r"start\.parm: RTL_RETURN_ALT = 4500"):
        Desk(VehicleConfig(parameter_file=path))


def test_a_ground_station_saves_loads_and_resets(tmp_path: Path) -> None:
    storage, accepted = mav.MAV_CMD_PREFLIGHT_STORAGE, mav.MAV_RESULT_ACCEPTED
    path = tmp_path / "kept.parm"
    desk = Desk(VehicleConfig(parameter_file=path))
    parameters = desk.vehicle.autopilot.parameters
    parameters.set("RTL_RETURN_ALT", 77.0)
    assert desk.command(storage, 1) == accepted
    assert desk.command(storage, 2) == accepted
    assert parameters["RTL_RETURN_ALT"] == 30.0
    assert desk.command(storage, 0) == accepted
    assert parameters["RTL_RETURN_ALT"] == 77.0
    path.write_text("nonsense\n")
    assert desk.command(storage, 0) == mav.MAV_RESULT_FAILED
    assert desk.command(storage, 7) == mav.MAV_RESULT_UNSUPPORTED
    assert Desk().command(storage, 1) == mav.MAV_RESULT_FAILED
