"""`aerofed log ...` and `aerofed report`: what they say, write, refuse, and return."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pyarrow.parquet
import pymap3d
import pytest
from drawing import drawn
from limits import no_file_larger_than
from mcap.reader import make_reader
from mcap.writer import Writer
from small_runs import rows
from synthetic_flight import AREA, CONFIG, Fixed, fly

from mission.base.errors import DIFFERENT, InputError
from mission.cli import call
from mission.commands import log, report
from mission.log import DamagedLogError, ForeignLogError, LogError, contents, inspection
from mission.log.export import _harmless, _pieces, export_kml
from mission.log.reader import read_log
from mission.log.records import RoundRecord, UplinkRecord
from mission.log.tables import read_table


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Fixed:
    return fly(tmp_path_factory.mktemp("run"), rounds=2)


def test_the_page_s_example_reads_a_log(made: Fixed) -> None:
    page = (Path(__file__).parents[3] / "docs" / "reading-logs.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-c", example], cwd=made.log.parent, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    first = [float(part) for part in done.stdout.splitlines()[0].split()]
    truth = read_log(made.log).truth
    np.testing.assert_allclose(first[1:], truth.pos_m[0, :2], atol=1e-6)
    assert first[0] == pytest.approx(truth.t_ns[0] / 1e9)


def foreign(path: Path) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        channel = writer.register_channel("/x", "json", schema)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    return path


def test_info_counts_what_is_there(made: Fixed, capsys: pytest.CaptureFixture[str]) -> None:
    found = inspection.info(made.log)
    by_name = {topic.name: topic for topic in found.topics}
    assert by_name["/true/pose"].messages == len(made.samples)
    assert by_name["/true/pose"].rate_hz == pytest.approx(10.0)
    assert by_name["/plan"].messages == 2
    assert found.size_bytes == made.log.stat().st_size
    assert found.end_s == made.samples[-1].t_ns / 1e9
    assert log.info(made.log) == 0
    text = capsys.readouterr().out
    assert "foxglove.PoseInFrame" in text
    assert f"attachment config.toml: {len(CONFIG)} bytes" in text
    assert "attachment foxglove-layout.json" in text


def test_info_and_recover_print_megabytes_and_seconds(
    made: Fixed, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    topics = (
        inspection.TopicInfo("/a", "A", 1801, 10.0, 190.0),
        inspection.TopicInfo("/b", "B", 1, 20.0, 20.0),
        inspection.TopicInfo("/c", "C", 2, 20.0, 24.0),
    )
    values = {"origin": {"lat": "1", "lon": "2"}}
    known = inspection.LogInfo(made.log, 12_340_000, 10.0, 190.0, topics, values, {"x": 7})
    monkeypatch.setattr(inspection, "info", lambda _: known)
    assert log.info(made.log) == 0
    said = capsys.readouterr().out.splitlines()
    # 12.34 MB in 180 s, which are a twentieth of an hour.
    assert said[0] == (
        f"{made.log}: 12.34 MB, 1804 messages, 180.0 s of simulated time, 246.8 MB an hour"
    )
    table = [line.split() for line in said[1:] if line.strip() and "\u2500" not in line]
    assert table == [
        *(["topic", "schema", "messages", "Hz"], ["/a", "A", "1801", "10.00"]),
        *(["/b", "B", "1", "0.00"], ["/c", "C", "2", "0.25"]),
        *(["attachment", "x:", "7", "bytes"],),
        *(["metadata", "origin:", "lat", "=", "1,", "lon", "=", "2"],),
    ]  # fmt: skip
    assert log.info(made.log, as_json=True) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["messages"] == 1804
    assert [topic["rate_hz"] for topic in told["topics"]] == [10.0, 0.0, 0.25]
    assert told["attachments"] == {"x": 7}
    assert replace(known, end_s=10.0).megabytes_per_hour == 0.0
    losses = contents.Loss(5, 9, "torn"), contents.Loss(9, 9, "no end"), contents.Loss(8, 9, "odd")
    saved = contents.Recovery(Path("new"), 12, 3, 10**9, 3_250_000_000, losses)
    targets: list[Path] = []

    def recover(_: Path, target: Path) -> contents.Recovery:
        targets.append(target)
        return saved

    monkeypatch.setattr(contents, "recover", recover)
    assert log.recover(made.log) == 0
    assert capsys.readouterr().out.splitlines() == [
        "new: 12 messages, 3 attachments, 2.2 s of simulated time",
        "lost: bytes 5 to 9: torn",
        "lost: nothing: no end",
        "lost: bytes 8 to 9: odd",
    ]
    assert log.recover(made.log, Path("other.mcap")) == 0
    assert targets == [made.log.with_name("flight.recovered.mcap"), Path("other.mcap")]


def test_check_passes_a_sound_log_and_names_gaps(
    made: Fixed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert log.check(made.log) == 0
    data = bytearray(made.log.read_bytes())
    with made.log.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[len(summary.chunk_indexes) // 2]
    data[chunk.chunk_start_offset + chunk.chunk_length - 1] ^= 1
    broken, saved = tmp_path / "broken.mcap", tmp_path / "saved.mcap"
    broken.write_bytes(data)
    with pytest.raises(DamagedLogError, match="damaged at byte"):
        log.check(broken)
    capsys.readouterr()
    with pytest.raises(DamagedLogError):
        log.check(broken, as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert told["sound"] is False
    assert "damaged at byte" in told["findings"][0]
    assert log.recover(broken, saved) == 0
    assert log.check(saved) == DIFFERENT
    text = capsys.readouterr().out
    assert "lost: bytes" in text
    assert re.search(r"/true/\w+: [1-9]\d* messages are missing from its numbering", text)


def test_recover_names_its_file_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = fly(tmp_path, rounds=1).log
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert log.recover(path) == 0
    assert path.read_bytes() == whole[: len(whole) // 2]
    assert log.check(tmp_path / "flight.recovered.mcap") == 0
    assert "lost: bytes" in capsys.readouterr().out


def test_diff_says_where(made: Fixed, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert log.diff(made.log, made.log) == 0
    other = fly(tmp_path, rounds=2, seed=2)
    assert log.diff(made.log, other.log) == DIFFERENT
    text = capsys.readouterr().out
    assert "the same" in text
    assert "metadata run: differs" in text
    assert "/true/pose: " in text
    assert "messages differ, at " in text


def test_csv_tables_are_the_runs_own(made: Fixed, tmp_path: Path) -> None:
    assert log.export(made.log, tmp_path / "csv", to="csv") == 0
    records: dict[str, type[RoundRecord | UplinkRecord]] = {
        "rounds": RoundRecord,
        "uplinks": UplinkRecord,
    }
    for name, record in records.items():
        exported = (tmp_path / "csv" / f"{name}.csv").read_bytes()
        assert exported == (made.log.parent / f"{name}.csv").read_bytes()
        assert read_table(tmp_path / "csv" / f"{name}.csv", record)
    track = rows(tmp_path / "csv" / "track.csv")
    assert len(track) == len(made.samples)
    data = read_log(made.log)
    for index in (0, 100, -1):
        assert float(track[index]["true_x_m"]) == data.truth.pos_m[index, 0]
        assert float(track[index]["est_alt_m"]) == data.belief.pos_m[index, 2]
        assert float(track[index]["t_s"]) == data.truth.t_ns[index] / 1e9
    plans = rows(tmp_path / "csv" / "plans.csv")
    assert len(plans) == sum(len(plan.waypoints_m) for plan in made.plans)


def test_without_pyarrow_parquet_is_one_line(
    made: Fixed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(
        InputError, match=r"Parquet needs pyarrow.*pip install 'aerofed\[parquet\]'"
    ):
        log.export(made.log, tmp_path / "p", to="parquet")
    assert not (tmp_path / "p").exists()


def test_parquet_holds_the_same_as_csv(made: Fixed, tmp_path: Path) -> None:
    assert log.export(made.log, tmp_path / "p", to="parquet") == 0
    assert log.export(made.log, tmp_path / "c", to="csv") == 0
    names = {path.stem for path in (tmp_path / "p").iterdir()}
    assert names == {path.stem for path in (tmp_path / "c").iterdir()}
    table = pyarrow.parquet.read_table(tmp_path / "p" / "track.parquet")
    written = rows(tmp_path / "c" / "track.csv")
    assert table.column_names == list(written[0])
    np.testing.assert_array_equal(
        table["true_y_m"].to_numpy(), [float(row["true_y_m"]) for row in written]
    )


def test_kml_puts_the_track_where_it_was(made: Fixed, tmp_path: Path) -> None:
    target = tmp_path / "a.kml"
    assert log.export(made.log, target, to="kml") == 0
    space = {"k": "http://www.opengis.net/kml/2.2"}
    root = ET.parse(target).getroot()
    marks = {
        mark.findtext("k:name", namespaces=space): mark
        for mark in root.iterfind(".//k:Folder[k:name='flown']/k:Placemark", space)
    }
    assert set(marks) == {"to round 1", "round 1", "round 2"}
    without = replace(read_log(made.log), rounds=())
    assert [name for name, _ in _pieces(without)] == ["flight"]
    text = marks["round 2"].findtext(".//k:coordinates", namespaces=space)
    assert text
    lon, lat, alt = map(float, text.split()[-1].split(","))
    home = AREA.home
    ned = made.samples[-1].truth.pos_ned_m
    expected = pymap3d.ned2geodetic(*ned, home.lat_deg, home.lon_deg, home.alt_msl_m)
    assert (lat, lon) == pytest.approx(expected[:2], abs=2e-8)
    assert alt == pytest.approx(expected[2], abs=2e-3)


def test_lines_of_kml_are_bright_on_pictures_of_the_ground(made: Fixed, tmp_path: Path) -> None:
    space = {"k": "http://www.opengis.net/kml/2.2"}
    root = ET.parse(export_kml(made.log, tmp_path / "a.kml")).getroot()
    colours = [node.text or "" for node in root.iterfind(".//k:LineStyle/k:color", space)]
    assert len(set(colours)) == 3
    for text in colours:
        alpha, *bgr = bytes.fromhex(text)  # aabbggrr
        assert alpha == 255
        assert np.dot(bgr, (0.0722, 0.7152, 0.2126)) > 140, "relative luminance, of 255"


def test_attachments_come_out_as_they_went_in(made: Fixed, tmp_path: Path) -> None:
    assert log.export(made.log, tmp_path / "a", to="attachments") == 0
    assert (tmp_path / "a" / "config.toml").read_bytes() == CONFIG
    assert (tmp_path / "a" / "foxglove-layout.json").stat().st_size > 1000


@pytest.mark.parametrize("to", ["csv", "parquet", "attachments"])
def test_an_export_fills_the_empty_folder_that_one_is_in(
    made: Fixed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, to: Any
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    rename = Path.replace

    def within(source: Path, target: Path) -> Path:
        assert source.is_relative_to(target.parent), "it may be a file system of its own"
        return rename(source, target)

    monkeypatch.setattr(Path, "replace", within)
    assert log.export(made.log, Path(), to=to) == 0
    assert list(Path().iterdir()), "the folder is another one now"
    assert [path.name for path in tmp_path.iterdir()] == ["here"]
    for used in (Path(), Path("/")):
        with pytest.raises(InputError, match="already used"):
            log.export(made.log, used, to=to)


@pytest.mark.parametrize("to", ["csv", "kml", "attachments"])
def test_export_never_overwrites(made: Fixed, tmp_path: Path, to: Any) -> None:
    target = tmp_path / "out"
    if to == "kml":
        target.write_text("mine")
    else:
        target.mkdir()
        (target / "mine").write_text("mine")
    with pytest.raises(InputError, match="already"):
        log.export(made.log, target, to=to)


def test_a_runs_folder_stands_for_its_log(
    made: Fixed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert log.info(made.log.parent) == log.check(made.log.parent) == 0
    assert f"{made.log}: sound" in capsys.readouterr().out
    for command in (log.info, log.check, log.recover):
        with pytest.raises(InputError, match=r"not a run folder: it has no flight\.mcap, nor an"):
            command(tmp_path)
    own = tmp_path / "vehicle-uav1" / "flight.mcap"
    own.parent.mkdir()
    own.write_bytes(made.log.read_bytes())
    for command in (log.info, log.check, log.recover):  # of a run of several
        with pytest.raises(InputError, match=re.escape(f"give one of its logs, as {own.parent}")):
            command(tmp_path)


@pytest.mark.parametrize("to", ["csv", "parquet", "kml", "attachments"])
def test_an_export_that_cannot_be_finished_leaves_nothing(
    made: Fixed, tmp_path: Path, to: Any
) -> None:
    with no_file_larger_than(2000), pytest.raises(InputError, match="out: cannot write"):
        log.export(made.log, tmp_path / "out", to=to)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_report_or_figure_that_cannot_be_finished_leaves_nothing(
    made: Fixed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with drawn(), no_file_larger_than(2000):
        assert call(["report", str(made.log), "--out", str(tmp_path / "r.html")]) == 2
        assert call(["compare", str(made.log), "--figure", str(tmp_path / "c.png")]) == 2
        assert call(["log", "recover", str(made.log), str(tmp_path / "r.mcap")]) == 2
    assert capsys.readouterr().err.count("cannot write") == 3
    assert list(tmp_path.iterdir()) == []


def test_files_of_others_are_refused_by_every_command(made: Fixed, tmp_path: Path) -> None:
    path = foreign(tmp_path / "x.mcap")
    for command in (log.info, log.check, lambda p: log.diff(p, made.log),
                    lambda p: log.export(p, tmp_path / "o", to="csv")):  # fmt: skip
        with pytest.raises(ForeignLogError, match=r"x\.mcap: an MCAP file, but not one of ours"):
            command(path)
    text = tmp_path / "t.mcap"
    text.write_text("hello")
    for command in (log.info, log.check, log.recover):
        with pytest.raises(LogError, match="not an MCAP file"):
            command(text)


def test_report_prints_where_it_is(made: Fixed, capsys: pytest.CaptureFixture[str]) -> None:
    assert report.report(made.log.parent) == 0
    assert capsys.readouterr().out.strip() == str(made.log.parent / "report.html")


def test_no_cell_is_computed_by_a_spreadsheet() -> None:
    """A status text comes from whoever speaks MAVLink; the table is opened by somebody else."""
    texts = ["=HYPERLINK(1)", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "plain", "a=b", ""]
    cells = list(_harmless(texts))
    assert cells == [f"'{t}" for t in texts[:6]] + texts[6:]
    assert list(_harmless([-1.5, -2, True])) == [-1.5, -2, True]
