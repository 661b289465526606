"""A run whose radio is decided by buildings, in its tables, its log and its pictures."""

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cutting import check_resumed
from described import described, tables
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.special import ndtri
from small_runs import digests

import aerofed
from fl.radio.learned import PILOT_GAIN_DB, Heard, Learned, Listener
from fl.radio.place import PlacedRadio
from mission.base.errors import InputError
from mission.base.palette import per_colour
from mission.figures.maps import overview
from mission.figures.radio import beliefs
from mission.scenario.scenario import build_scenario

# Between the devices stands a wall of houses; the fourth is a tower, which is flown around.
WALLS = [
    {"polygon_m": [[x, 180.0], [x + 60.0, 180.0], [x + 60.0, 200.0], [x, 200.0]], "height_m": h}
    for x, h in ((20.0, 30.0), (100.0, 40.0), (180.0, 45.0), (300.0, 90.0))
]
COURT = {
    "polygon_m": [[20, 300], [90, 300], [90, 370], [20, 370]],
    "holes_m": [[[40, 320], [70, 320], [70, 350], [40, 350]]],
    "height_m": 20,
}
SETTINGS = {
    "area.size_m": [400, 400],
    "area.home_m": [200, 60],
    "area.buildings": [*WALLS, COURT],
    "radio.truth": "buildings",
    "mission.flight": "none",
    "mission.rounds": 2,
    "mission.steps": 4,
    "mission.path_budget_m": 500,
    "planner.gap": 0.1,
    "communities.0.subset": 0.2,
    "communities.1.subset": 0.2,
    "learning.local_epochs": 1,
}
CLOSE = {**SETTINGS, "planner.gap": 0.01}  # plans that leave next to nothing to chance


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> aerofed.Run:
    return aerofed.run("quickstart", SETTINGS, out=tmp_path_factory.mktemp("city") / "run")


def test_what_is_true_is_not_what_was_planned(run: aerofed.Run) -> None:
    told = run.uplinks
    assert (told.plan_per - told.est_per).abs().max() < 0.02  # both are believed
    assert (told.true_per - told.plan_per).abs().max() > 0.2


@pytest.mark.parametrize("belief", ["buildings", "truth"])
def test_what_is_planned_with_is_what_is_believed(
    run: aerofed.Run, tmp_path: Path, belief: str
) -> None:
    other = aerofed.run("quickstart", {**SETTINGS, "radio.belief": belief}, out=tmp_path / "run")
    told, before = other.uplinks, run.uplinks
    assert (told.plan_per - told.est_per).abs().max() < 0.05  # near walls it is steep
    wrong, wrong_before = ((u.plan_per - u.true_per).abs().mean() for u in (told, before))
    assert wrong < 0.5 * wrong_before
    if belief == "truth":  # what is left is the grid's, and the corners'
        assert wrong < 0.02


def test_an_aircraft_that_listens_is_sent_better_from_round_to_round(tmp_path: Path) -> None:
    heard = {}
    for belief in ("channel", "learned"):
        more = {**CLOSE, "radio.belief": belief, "mission.rounds": 6, "seed": 4}
        told = aerofed.run("quickstart", more, out=tmp_path / belief).uplinks
        heard[belief] = 1.0 - told.true_per[told["round"] > 3].mean()
    assert heard["channel"] < 0.95
    assert heard["learned"] > 0.99


@pytest.mark.parametrize(
    ("belief", "more"),
    [
        ("learned", {"radio.pilots": "scheduled", "mission.devices_per_step": 1}),
        ("examples.mean_gain:make", {"mission.replan": "stop"}),
    ],
)
def test_what_was_learned_is_learned_again_on_resuming(
    tmp_path: Path, belief: str, more: dict[str, object]
) -> None:
    check_resumed({**SETTINGS, "radio.belief": belief, **more}, tmp_path, after=1)


@pytest.mark.parametrize("replan", ["round", "stop"])
@pytest.mark.parametrize("pilots", [None, "scheduled"])
def test_pilots_are_those_of_all_or_of_the_scheduled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pilots: str | None, replan: str
) -> None:
    heard: list[set[int]] = []
    hear = Listener.hear

    def listened(self: Listener, before: Heard, *args: Any) -> Heard:
        after = hear(self, before, *args)
        heard.append({*after.device[len(before.device) :].tolist()})
        return after

    monkeypatch.setattr(Listener, "hear", listened)
    more = {**SETTINGS, "radio.belief": "learned", "mission.steps": 2, "mission.replan": replan}
    more |= {"mission.devices_per_step": 2} | ({} if pilots is None else {"radio.pilots": pilots})
    told = aerofed.run("quickstart", more, out=tmp_path / "run").uplinks
    assert len(heard) >= 2
    if pilots != "scheduled":
        assert heard == [{*range(12)}] * len(heard)
    else:
        assert max(map(len, heard)) <= 4
        assert set.union(*heard) >= {*told.device}
        if replan == "round":
            assert heard == [{*told.device[told["round"] == number]} for number in (1, 2)]


@pytest.mark.slow
def test_intervals_of_what_is_learned_cover_what_is_true() -> None:
    """Nine in ten of 90 % intervals, over the district of `city`, along flights of 1.8 km."""
    shares, line = [], np.linspace(0.0, 1.0, 31)[:, None]
    for seed in (1, 2, 3, 4):
        config = aerofed.config("city", {"seed": seed, "radio.belief": "learned"})
        scenario, rng = build_scenario(config, data_dir=None), np.random.default_rng(seed)
        truth, listener, count = scenario.radio, scenario.listener, len(scenario.devices_m)
        assert isinstance(truth, PlacedRadio)
        assert listener is not None
        assert isinstance(listener.belief, Learned)
        corners = rng.uniform(0.0, 800.0, (5, 2))
        at_m = np.concatenate([a + line * (b - a) for a, b in pairwise(corners)])
        asked = rng.uniform(0.0, 800.0, (300, 2))
        at_m, asked = (np.column_stack((m, np.full(len(m), 60.0))) for m in (at_m, asked))
        heard = listener.hear(Heard(), at_m, at_m, np.ones(count, dtype=bool), rng)
        mean_db, deviation_db = listener.belief.snr_db(heard, asked)
        device = np.repeat(np.arange(count), len(asked))
        snr_db = truth.snr_db(device, np.tile(asked, (count, 1))).reshape(count, -1)
        over = snr_db > config.radio.snr_threshold_db - PILOT_GAIN_DB
        off = np.abs(snr_db - mean_db) / deviation_db
        shares.append((off[over] < ndtri(0.95)).mean())
    assert 0.85 < np.mean(shares) < 0.95


def test_uploads_have_the_air_that_tones_leave(tmp_path: Path) -> None:
    """Tones of twelve devices of 20 ms take 0.24 s of each second; of two, 0.04 s."""
    listens = {**SETTINGS, "radio.belief": "learned", "channel.upload_rate_bps": 1e6}
    listens |= {f"communities.{index}.upload_bits": 1_000_000 for index in (0, 1)}
    for pilots, pilot_s, upload_s in (
        (None, None, 1.0),
        (None, 0.02, 1.0 / 0.76),
        ("scheduled", 0.02, 1.0 / 0.96),
    ):
        more = {**listens, "radio.pilots": pilots, "radio.pilot_s": pilot_s}
        more |= {"mission.steps": 2, "mission.devices_per_step": 1, "mission.rounds": 1}
        run = aerofed.run("quickstart", more, out=tmp_path / f"{pilots}{pilot_s}")
        assert run.uplinks.upload_s.to_numpy() == pytest.approx(upload_s)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (
            {"channel.upload_rate_bps": 1e6, "radio.pilot_s": 0.1},
            "radio.pilot_s = 0.1: tones take 1.2 s of each second",
        ),
        (  # 0.6 s of each second are of tones: 4 Mbit in 3600 s need 1111.1 / 0.4 bits a second
            {
                "channel.upload_rate_bps": 2777.0,
                "radio.pilot_s": 0.05,
                "communities.0.upload_bits": 1000,
                "communities.1.upload_bits": 4_000_000,
            },
            "the largest update, 4000000 bits, takes 3601 s to send; 3600 s at most are allowed, "
            "so at least 2778 bits a second",
        ),
        ({}, "radio.pilot_s = 0.01: needs channel.upload_rate_bps, the rate of uploads"),
        ({"radio.belief": "truth"}, "radio.pilot_s is of a belief that listens"),
    ],
)
def test_tones_without_a_place_in_the_air_are_refused(
    tmp_path: Path, more: dict[str, object], why: str
) -> None:
    keys = {**SETTINGS, "radio.belief": "learned", "radio.pilot_s": 0.01, **more}
    with pytest.raises(InputError, match=re.escape(why)):
        aerofed.run("quickstart", keys, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_what_listens_begins_with_its_prior(tmp_path: Path) -> None:
    begun = {}
    for prior in (None, "buildings"):
        more = {**SETTINGS, "radio.belief": "learned", "radio.prior": prior, "mission.rounds": 1}
        begun[prior] = aerofed.run("quickstart", more, out=tmp_path / f"{prior}").uplinks
    walls = aerofed.run("quickstart", {**SETTINGS, "radio.belief": "buildings"}, out=tmp_path / "w")
    first = walls.uplinks[walls.uplinks["round"] == 1]
    assert begun["buildings"].device.tolist() == first.device.tolist()
    assert begun["buildings"].plan_per.to_numpy() == pytest.approx(first.plan_per.to_numpy())
    assert begun["buildings"].plan_per.tolist() != begun[None].plan_per.tolist()


def test_what_is_believed_stands_in_the_log_and_grows_in_a_picture(
    run: aerofed.Run, tmp_path: Path
) -> None:
    more = {**CLOSE, "radio.belief": "learned", "mission.rounds": 3, "seed": 3}
    data = aerofed.run("quickstart", more, out=tmp_path / "run")._loaded.data
    assert len(data.radio_believed) == 3
    places = {number: [u for u in data.uplinks if u.round == number] for number in (1, 2, 3)}
    for (t_ns, grid), (number, uplinks) in zip(data.radio_believed, places.items(), strict=True):
        assert t_ns <= data.rounds[number - 1].start_t_s * 1e9
        assert grid.success.shape == (len(data.devices.pos_m), 81, 81)  # a byte each
        at_m = np.array([(u.plan_x_m, u.plan_y_m) for u in uplinks])
        per = grid.per(np.array([u.device for u in uplinks]), at_m)
        assert per == pytest.approx([u.plan_per for u in uplinks], abs=0.6 / 255)
    assert data.radio_true is not None
    sent = [u for uplinks in places.values() for u in uplinks]
    at_m = np.array([(u.true_x_m, u.true_y_m) for u in sent])
    true_per = data.radio_true.per(np.array([u.device for u in sent]), at_m)
    assert np.abs(true_per - [u.true_per for u in sent]).mean() < 0.02
    panels = beliefs(data)
    assert [panel["title"]["text"].split(" ", 2)[2] for panel in panels] == [
        *(f"believed as round {number} began" for number in (1, 2, 3)),
        "true",
    ]
    device = int(panels[0]["title"]["text"].split()[1].rstrip(","))
    for panel, grid in zip(
        panels, (*(g for _, g in data.radio_believed), data.radio_true), strict=True
    ):
        (cells,) = tables(described(panel), "per")
        found = [row["per"] for row in cells]
        assert found == pytest.approx(1.0 - grid.success[device, ::2, ::2].ravel(), abs=0.006)
    average = run._loaded.data
    assert average.radio_true is None
    assert not beliefs(average)


def test_the_same_again_has_the_same_bytes(run: aerofed.Run, tmp_path: Path) -> None:
    again = aerofed.run("quickstart", SETTINGS, out=tmp_path / "again")
    assert digests(again.path) == digests(run.path)


def test_the_log_has_walls_and_roofs(run: aerofed.Run) -> None:
    with (run.path / "flight.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        (found,) = [m for *_, m in reader.iter_decoded_messages(["/scene/buildings"])]
    walls, roofs = (
        np.array([(p.x, p.y, p.z) for p in part.points]).reshape(-1, 3, 3)
        for part in found.entities[0].triangles
    )
    assert len(walls) == 2 * 4 * (len(WALLS) + 2)
    assert set(roofs[:, :, 2].flat) == {20.0, 30.0, 40.0, 45.0, 90.0}
    flat = roofs[:, :, :2]
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    sizes = abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2.0
    assert sizes.sum() == pytest.approx(4 * 60 * 20 + 70 * 70 - 30 * 30)


def test_a_link_has_the_colour_of_its_true_rate(run: aerofed.Run) -> None:
    data = run._loaded.data
    with (run.path / "flight.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        found = [m for *_, m in reader.iter_decoded_messages(["/scene/links"])]
    assert len(found) == len(data.uplinks) > 4
    for message, uplink in zip(found, data.uplinks, strict=True):
        (entity,) = message.entities
        assert entity.id == f"link {uplink.device}"
        (line,) = entity.lines
        colour = line.color.r, line.color.g, line.color.b
        assert colour == pytest.approx(per_colour(uplink.true_per), abs=1e-6)
        air, ground = line.points
        assert (air.x, air.y, air.z) == (uplink.true_x_m, uplink.true_y_m, uplink.true_alt_m)
        assert (ground.x, ground.y) == tuple(data.devices.pos_m[uplink.device].tolist())
    rates = [uplink.true_per for uplink in data.uplinks]
    assert min(rates) < 0.1 < 0.9 < max(rates)


def test_maps_show_them_the_darker_the_higher(run: aerofed.Run) -> None:
    drawn = described(overview(run._loaded.data, "run"))
    (houses,) = tables(drawn, "height", "part")[:1]
    heights = {row["part"]: row["height"] for row in houses}
    assert [*heights] == [0, 1, 2, 3, 4]
    assert heights[3] == 90.0 > heights[2] > heights[1] > heights[0] > heights[4]
    assert '"scale": {"domain": [0.0, 90.0], "range": [0.12, 0.62]}' in json.dumps(drawn)
