"""Flight logs and parameters as files: the log protocol and MAVLink FTP, MAVSDK as a client."""

import asyncio
import os
import random
import struct
import zlib
from pathlib import Path
from typing import Any

import pytest
from mavsdk.asyncio.plugins.ftp import FtpAsync
from mavsdk.asyncio.plugins.log_files import LogFilesAsync, LogFilesError
from mavsdk.plugins.ftp import FtpResult
from mavsdk.plugins.log_files import LogFilesResult
from pymavlink.dialects.v20 import common as mav
from sitl_desk import Desk, of, the
from sitl_mavsdk import HOME, over_raw, until

from flightdyn.random import RandomStreams
from sitl.config import VehicleConfig
from sitl.logfolder import LogFolder
from sitl.vehicle import Vehicle

SIZES = (0, 89, 90, 91, 90 * 60, 40_000)

ACK, NAK = mav.MAV_FTP_OPCODE_ACK, mav.MAV_FTP_OPCODE_NAK
LIST, OPEN = mav.MAV_FTP_OPCODE_LISTDIRECTORY, mav.MAV_FTP_OPCODE_OPENFILERO
READ, BURST = mav.MAV_FTP_OPCODE_READFILE, mav.MAV_FTP_OPCODE_BURSTREADFILE
NOT_FOUND, NO_SESSION = mav.MAV_FTP_ERR_FILENOTFOUND, mav.MAV_FTP_ERR_INVALIDSESSION
END = mav.MAV_FTP_ERR_EOF


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Logs of awkward sizes, an older one last by name, and one that is being written."""
    for number, size in enumerate(SIZES):
        path = tmp_path / f"flight-{number:04d}.mcap"
        path.write_bytes(random.Random(number).randbytes(size))
        os.utime(path, (1_700_000_000 + number, 1_700_000_000 + number))
    (tmp_path / "flight-9999.mcap").write_bytes(b"not yet")
    (tmp_path / "notes.txt").write_text("none of the vehicle's")
    return tmp_path


def disk(folder: Path) -> LogFolder:
    return LogFolder(folder, being_written=lambda: folder / "flight-9999.mcap")


def bytes_of(folder: Path, number: int) -> bytes:
    return (folder / f"flight-{number:04d}.mcap").read_bytes()


class Files(Desk):
    """A desk that asks for files."""

    def __init__(self, folder: Path | None) -> None:
        super().__init__(logs=None if folder is None else disk(folder))
        self.number = 0

    def entries(self, first: int = 0, last: int = 0xFFFF) -> list[Any]:
        return of(self.send(mav.MAVLink_log_request_list_message(1, 1, first, last)), "LOG_ENTRY")

    def download(self, log: int, offset: int = 0, count: int = 2**32 - 1) -> bytes:
        heard = self.send(mav.MAVLink_log_request_data_message(1, 1, log, offset, count))
        waited = 0
        while not (parts := of(heard, "LOG_DATA")) or (
            parts[-1].count == 90 and sum(part.count for part in parts) < count
        ):
            heard += self.pass_wall_time(0.01, step=0.01)
            waited += 1
            assert waited < 100, "its end is not told"
        assert [part.ofs for part in parts] == [offset + 90 * i for i in range(len(parts))]
        return b"".join(bytes(part.data[: part.count]) for part in parts)

    def ftp(
        self,
        op: int,
        data: bytes = b"",
        *,
        session: int = 0,
        offset: int = 0,
        size: int | None = None,
    ) -> tuple[int, int, bytes]:
        """Opcode, session and data of the answer."""
        self.number += 1
        length = len(data) if size is None else size
        head = struct.pack("<HBBBBBxI", self.number, session, op, length, 0, 0, offset)
        payload = (head + data).ljust(251, b"\0")
        heard = self.send(mav.MAVLink_file_transfer_protocol_message(0, 1, 1, list(payload)))
        answer = bytes(the(heard, "FILE_TRANSFER_PROTOCOL").payload)
        number, session, code, size, asked, _, _ = struct.unpack_from("<HBBBBBxI", answer)
        assert (number, asked) == (self.number + 1, op)
        return code, session, answer[12 : 12 + size]

    def refused(self, op: int, data: bytes = b"", **more: int) -> int:
        code, _, answer = self.ftp(op, data, **more)
        assert code == NAK
        return answer[0]


def test_logs_are_listed_with_size_and_time(folder: Path) -> None:
    entries = Files(folder).entries()
    assert [(e.id, e.num_logs, e.last_log_num, e.size) for e in entries] == [
        (i, len(SIZES), len(SIZES) - 1, size) for i, size in enumerate(SIZES)
    ]
    assert entries[2].time_utc == 1_700_000_002
    assert [e.id for e in Files(folder).entries(2, 3)] == [2, 3]


def test_an_empty_list_is_an_answer() -> None:
    (entry,) = Files(None).entries()
    assert (entry.id, entry.num_logs, entry.last_log_num, entry.size) == (0, 0, 0, 0)
    assert Files(None).download(0) == b""


@pytest.mark.parametrize("log", range(len(SIZES)))
def test_a_log_arrives_whole_and_in_parts(folder: Path, log: int) -> None:
    desk, whole = Files(folder), bytes_of(folder, log)
    assert desk.download(log) == whole
    assert desk.download(log, 90, 180) == whole[90:270]
    assert desk.download(log, len(whole) + 7, 90) == b""
    assert not of(desk.pass_wall_time(1.0), "LOG_DATA")


def test_a_download_is_ended_or_replaced_by_another(folder: Path) -> None:
    desk = Files(folder)
    desk.send(mav.MAVLink_log_request_data_message(1, 1, 5, 0, 40_000))
    desk.send(mav.MAVLink_log_request_end_message(1, 1))
    assert not of(desk.pass_wall_time(1.0), "LOG_DATA")
    desk.send(mav.MAVLink_log_request_data_message(1, 1, 5, 0, 40_000))
    assert desk.download(1) == bytes_of(folder, 1)
    assert not of(desk.pass_wall_time(1.0), "LOG_DATA")
    assert desk.download(77) == b""  # there is none


def test_logs_are_erased_but_not_in_flight(folder: Path) -> None:
    desk = Files(folder)
    desk.take_off()
    desk.send(mav.MAVLink_log_erase_message(1, 1))
    assert "Logs are not erased while armed" in desk.texts()
    assert len(desk.entries()) == len(SIZES)
    desk = Files(folder)
    desk.send(mav.MAVLink_log_erase_message(1, 1))
    assert desk.entries()[0].num_logs == 0
    assert sorted(path.name for path in folder.iterdir()) == ["flight-9999.mcap", "notes.txt"]


@pytest.mark.parametrize("path", ["/log", "/log/", "/fs/microsd/log"])
def test_ftp_lists_the_logs(folder: Path, path: str) -> None:
    desk, seen = Files(folder), b""
    code, _, data = desk.ftp(LIST, path.encode())
    while code == ACK:
        assert len(data) <= 239
        seen += data
        code, _, data = desk.ftp(LIST, path.encode(), offset=seen.count(b"\0"))
    assert (code, data) == (NAK, bytes((END,)))
    names = [f"Fflight-{i:04d}.mcap\t{size}" for i, size in enumerate(SIZES)]
    assert seen.decode().split("\0")[:-1] == names


def test_ftp_reads_a_log_and_its_checksum(folder: Path) -> None:
    desk, whole, path = Files(folder), bytes_of(folder, 5), b"/log/flight-0005.mcap"
    code, session, size = desk.ftp(OPEN, path)
    assert (code, size) == (ACK, struct.pack("<I", len(whole)))
    assert desk.ftp(READ, session=session, offset=239, size=100)[2] == whole[239:339]
    assert desk.ftp(READ, session=session, offset=39_990, size=239)[2] == whole[39_990:]
    assert desk.refused(READ, session=session, offset=40_000, size=9) == END
    assert desk.ftp(mav.MAV_FTP_OPCODE_TERMINATESESSION, session=session)[0] == ACK
    assert desk.refused(READ, session=session, size=9) == NO_SESSION
    checksum = zlib.crc32(whole, 0xFFFFFFFF) ^ 0xFFFFFFFF
    assert desk.ftp(mav.MAV_FTP_OPCODE_CALCFILECRC, path)[2] == struct.pack("<I", checksum)


@pytest.mark.parametrize(
    ("op", "data", "code"),
    [
        (LIST, b"/nowhere", NOT_FOUND),
        (OPEN, b"/log/none.mcap", NOT_FOUND),
        (OPEN, b"/log/../notes.txt", NOT_FOUND),
        (
            OPEN,
            b"/etc/extras/px4_io-v2_default.bin",
            NOT_FOUND,
        ),
        (mav.MAV_FTP_OPCODE_CALCFILECRC, b"/log/notes.txt", NOT_FOUND),
        (mav.MAV_FTP_OPCODE_CREATEFILE, b"/log/new", mav.MAV_FTP_ERR_FILEPROTECTED),
        (mav.MAV_FTP_OPCODE_REMOVEFILE, b"/log/flight-0001.mcap", mav.MAV_FTP_ERR_FILEPROTECTED),
        (mav.MAV_FTP_OPCODE_RENAME, b"/log/a\0/log/b", mav.MAV_FTP_ERR_FILEPROTECTED),
        (READ, b"", NO_SESSION),
        (BURST, b"", NO_SESSION),
        (77, b"", mav.MAV_FTP_ERR_UNKNOWNCOMMAND),
    ],
)
def test_what_is_not_there_or_not_allowed_is_ftps_own_error(
    folder: Path, op: int, data: bytes, code: int
) -> None:
    assert Files(folder).refused(op, data, session=3) is code


def test_ftp_bounds_what_it_is_told(folder: Path) -> None:
    desk = Files(folder)
    assert desk.refused(LIST, b"/log", size=255) == mav.MAV_FTP_ERR_INVALIDDATASIZE


def test_what_is_no_log_of_the_vehicle_is_neither_shown_nor_read_nor_removed(folder: Path) -> None:
    secret = folder / "secret.txt"
    secret.write_text("root:x:0:0")
    (folder / "flight-0007.mcap").symlink_to(secret)
    (folder / "flight-0008.mcap").mkdir()
    (folder / "holiday.mcap").write_text("of the user")
    os.mkfifo(folder / "flight-0009.mcap")
    desk = Files(folder)
    for name in ("flight-0007", "flight-0008", "flight-0009", "holiday"):
        assert desk.refused(OPEN, f"/log/{name}.mcap".encode()) == NOT_FOUND
    assert disk(folder).read("flight-0007.mcap", 0, 9) == b""
    assert disk(folder).read("flight-0009.mcap", 0, 9) == b""
    assert len(desk.entries()) == len(SIZES)
    desk.send(mav.MAVLink_log_erase_message(1, 1))
    left = {"flight-0007", "flight-0008", "flight-0009", "flight-9999", "holiday"}
    assert {path.stem for path in folder.glob("*.mcap")} == left
    assert secret.read_text() == "root:x:0:0"


def test_the_checksum_of_a_long_file_blocks_nobody(folder: Path) -> None:
    data = random.Random(7).randbytes(1 << 20) * 8
    (folder / "flight-0007.mcap").write_bytes(data)
    desk = Files(folder)
    request = struct.pack("<HBBBBBxI", 3, 0, mav.MAV_FTP_OPCODE_CALCFILECRC, 21, 0, 0, 0)
    payload = list((request + b"/log/flight-0007.mcap").ljust(251, b"\0"))
    asked = mav.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)
    assert of(desk.send(asked), "FILE_TRANSFER_PROTOCOL") == []
    assert of(desk.send(asked), "FILE_TRANSFER_PROTOCOL") == []  # once more, and not from anew
    answer = the(desk.pass_wall_time(0.1, step=0.01), "FILE_TRANSFER_PROTOCOL")
    expected = zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF
    assert bytes(answer.payload)[12:16] == struct.pack("<I", expected)


@pytest.mark.parametrize("op", [BURST, mav.MAV_FTP_OPCODE_RESETSESSION])
def test_a_checksum_that_another_request_ended_is_worked_out_when_asked_again(
    folder: Path, op: int
) -> None:
    desk, path = Files(folder), b"/log/flight-0005.mcap"
    (folder / "flight-0005.mcap").write_bytes(random.Random(7).randbytes(1 << 20) * 8)
    _, session, _ = desk.ftp(OPEN, path)
    head = struct.pack("<HBBBBBxI", 3, 0, mav.MAV_FTP_OPCODE_CALCFILECRC, len(path), 0, 0, 0)
    checksum = list((head + path).ljust(251, b"\0"))
    other = list(struct.pack("<HBBBBBxI", 7, session, op, 239, 0, 0, 0).ljust(251, b"\0"))
    message = mav.MAVLink_file_transfer_protocol_message
    assert of(desk.send(message(0, 1, 1, checksum)), "FILE_TRANSFER_PROTOCOL") == []
    desk.send(message(0, 1, 1, other))
    desk.send(message(0, 1, 1, checksum))
    heard = of(desk.pass_wall_time(0.1, step=0.01), "FILE_TRANSFER_PROTOCOL")
    asked = [bytes(answer.payload)[5] for answer in heard]
    assert asked == [mav.MAV_FTP_OPCODE_CALCFILECRC]


def test_a_session_that_nobody_closed_is_used_again(folder: Path) -> None:
    desk, log = Files(folder), b"/log/flight-0001.mcap"
    assert [desk.ftp(OPEN, log)[1] for _ in range(8)] == [*range(8)]
    assert desk.ftp(READ, session=0, size=9)[0] == ACK
    # The one that was used least recently; 0 was read from just now.
    assert desk.ftp(OPEN, b"@PARAM/param.pck")[:2] == (
        ACK,
        1,
    )
    assert desk.ftp(READ, session=1, size=2)[2] == b"\x1b\x67"
    assert desk.ftp(READ, session=0, size=9)[0] == ACK


def test_a_burst_does_not_go_on_with_another_file(folder: Path) -> None:
    desk, log = Files(folder), b"/log/flight-0005.mcap"
    _, session, _ = desk.ftp(OPEN, log)
    burst = struct.pack("<HBBBBBxI", 7, session, BURST, 239, 0, 0, 0).ljust(251, b"\0")
    message = mav.MAVLink_file_transfer_protocol_message(0, 1, 1, list(burst))
    assert len(of(desk.send(message), "FILE_TRANSFER_PROTOCOL")) == 30
    assert session in [desk.ftp(OPEN, log)[1] for _ in range(8)]
    assert of(desk.pass_wall_time(0.1, step=0.01), "FILE_TRANSFER_PROTOCOL") == []


@pytest.mark.parametrize(("offset", "size", "count"), [(0, 239, 23), (239, 100, 52), (5399, 9, 1)])
def test_a_burst_is_numbered_and_its_last_part_says_so(
    folder: Path, offset: int, size: int, count: int
) -> None:
    """Of 5400 bytes."""
    desk, whole = Files(folder), bytes_of(folder, 4)
    _, session, _ = desk.ftp(OPEN, b"/log/flight-0004.mcap")
    head = struct.pack("<HBBBBBxI", 65_530, session, BURST, size, 0, 0, offset)
    ask = mav.MAVLink_file_transfer_protocol_message(0, 1, 1, list(head.ljust(251, b"\0")))
    heard = of(desk.send(ask) + desk.pass_wall_time(0.1, step=0.005), "FILE_TRANSFER_PROTOCOL")
    parts = [bytes(message.payload) for message in heard]
    heads = [struct.unpack_from("<HBBBBBxI", part) for part in parts]
    lengths = [min(size, 5400 - offset - i * size) for i in range(count)]
    assert heads == [
        ((65_531 + i) % 65_536, session, ACK, length, BURST, i == count - 1, offset + i * size)
        for i, length in enumerate(lengths)
    ]
    got = b"".join(part[12 : 12 + length] for part, length in zip(parts, lengths, strict=True))
    assert got == whole[offset:]
    head = struct.pack("<HBBBBBxI", 9, session, BURST, size, 0, 0, 5400)
    ask = mav.MAVLink_file_transfer_protocol_message(0, 1, 1, list(head.ljust(251, b"\0")))
    answer = bytes(the(desk.send(ask), "FILE_TRANSFER_PROTOCOL").payload)
    assert (answer[3], answer[12]) == (NAK, END)


def test_thirty_parts_go_out_every_five_milliseconds(folder: Path) -> None:
    desk = Files(folder)
    _, session, _ = desk.ftp(OPEN, b"/log/flight-0005.mcap")
    head = struct.pack("<HBBBBBxI", 7, session, BURST, 239, 0, 0, 0).ljust(251, b"\0")
    ask = mav.MAVLink_file_transfer_protocol_message(0, 1, 1, list(head))
    counts = [len(of(desk.send(ask), "FILE_TRANSFER_PROTOCOL"))]
    for _ in range(14):
        heard = desk.pass_wall_time(0.00251, step=0.00251)
        counts.append(len(of(heard, "FILE_TRANSFER_PROTOCOL")))
    assert counts == [30, 0, 30, 0, 30, 0, 30, 0, 30, 0, 18, 0, 0, 0, 0]  # 168 of 239 bytes


def test_ftp_lists_the_folders(folder: Path) -> None:
    desk = Files(folder)
    size = struct.unpack("<I", desk.ftp(OPEN, b"@PARAM/param.pck")[2])[0]
    for path, names in {
        b"/": b"D@PARAM\0Dfs\0Dlog\0", b"": b"D@PARAM\0Dfs\0Dlog\0", b"/fs": b"Dmicrosd\0",
        b"/fs/microsd/": b"Dlog\0", b"@PARAM": b"Fparam.pck\t%d\0" % size,
        b"/@PARAM/": b"Fparam.pck\t%d\0" % size,
    }.items():  # fmt: skip
        assert desk.ftp(LIST, path)[2] == names
    assert desk.ftp(LIST, b"/", offset=2)[2] == b"Dlog\0"
    assert desk.refused(LIST, b"/", offset=3) == END


def test_a_request_whose_answer_was_lost_is_answered_again(folder: Path) -> None:
    desk = Files(folder)
    code, session, _ = desk.ftp(OPEN, b"/log/flight-0001.mcap")
    desk.number -= 1
    assert desk.ftp(OPEN, b"/log/flight-0001.mcap")[:2] == (code, session)


def test_parameters_come_as_one_pack() -> None:
    """Read as MAVProxy reads it."""
    desk = Files(None)
    _, session, size = desk.ftp(OPEN, b"@PARAM/param.pck?withdefaults=1")
    pack = b""
    while len(pack) < struct.unpack("<I", size)[0]:
        pack += desk.ftp(READ, session=session, offset=len(pack), size=239)[2]
    magic, count, total = struct.unpack_from("<HHH", pack)
    values, at, last = {}, 6, b""
    for _ in range(count):
        kind, lengths = pack[at], pack[at + 1]
        name = last[: lengths & 15] + pack[at + 2 : at + 2 + (lengths >> 4) + 1]
        at += 2 + (lengths >> 4) + 1
        (values[name.decode()],) = struct.unpack_from({3: "<i", 4: "<f"}[kind], pack, at)
        at, last = at + 4, name
    parameters = desk.vehicle.autopilot.parameters.as_dict()
    assert (magic, total, at) == (0x671B, len(parameters), len(pack))
    assert values == pytest.approx(parameters)


async def read_by_mavsdk(vehicle: Vehicle, folder: Path, into: Path) -> None:
    async with over_raw(vehicle) as system:
        logs = LogFilesAsync(system)
        entries = await logs.get_entries()
        assert [entry.size_bytes for entry in entries] == list(SIZES)
        async for result, _ in logs.download_log_file(entries[5], str(into / "log.mcap")):
            assert result in (LogFilesResult.NEXT, LogFilesResult.SUCCESS)
        assert (into / "log.mcap").read_bytes() == bytes_of(folder, 5)
        ftp = FtpAsync(system)
        for burst in (False, True):
            async for result, _ in ftp.download("/log/flight-0004.mcap", str(into), burst):
                assert result in (FtpResult.NEXT, FtpResult.SUCCESS)
            fetched = into / "flight-0004.mcap"
            assert fetched.read_bytes() == bytes_of(folder, 4)
            fetched.unlink()
        listed = await ftp.list_directory("/log")
        assert len(listed.entries) == len(SIZES)
        await logs.erase_all_log_files()
        await until(lambda: not disk(folder).logs())
        with pytest.raises(LogFilesError):
            await logs.get_entries()


def test_mavsdk_lists_downloads_and_erases(folder: Path, tmp_path_factory: Any) -> None:
    vehicle = Vehicle(VehicleConfig(), home=HOME, streams=RandomStreams(1), logs=disk(folder))
    assert len(disk(folder).logs()) == len(SIZES)
    asyncio.run(read_by_mavsdk(vehicle, folder, tmp_path_factory.mktemp("fetched")))
    assert not disk(folder).logs()
