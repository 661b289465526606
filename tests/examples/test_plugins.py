"""The example of every plug-in point, flown; and what they compute, against what they cite."""

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cutting import check_resumed
from one_aircraft import round_problem
from scipy.special import ndtr

import aerofed
from examples import (
    fedbuff,
    fednova,
    late_updates,
    mean_gain,
    measured_radio,
    per_metre,
    quantity_skew,
    rician,
    tabular,
    weights,
    writers,
)
from fl.config import LearningConfig
from fl.federation.algorithms import FedAvg, Update
from fl.plugin_code import GROUP

EXAMPLES = Path(__file__).parents[2] / "examples"
# Nothing is flown: it takes a second or two. What is gated and learnt is the same.
SMALL = {
    "mission.flight": "none",
    "mission.steps": 4,
    "mission.rounds": 3,
    "mission.path_budget_m": 400.0,
    "planner.gap": 0.1,
    "communities.0.devices": 4,
    "communities.1.devices": 3,
    "communities.0.subset": 0.2,
    "communities.1.subset": 0.2,
    "learning.local_epochs": 1,
}
WALL = {"polygon_m": [[20.0, 200.0], [780.0, 200.0], [780.0, 230.0]], "height_m": 45.0}
WALLED = {"area.buildings": [WALL], "radio.truth": "buildings"}
TABLES = ("rounds.csv", "aircraft.csv", "uplinks.csv", "learning.csv")


def fly(out: Path, more: Mapping[str, Any]) -> aerofed.Run:
    return aerofed.run("quickstart", {**SMALL, **more}, out=out)


def flown_as(out: Path, **more: Any) -> aerofed.Run:
    return fly(out, {key.replace("__", "."): value for key, value in more.items()})


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> aerofed.Run:
    """A run without any plug-in."""
    return fly(tmp_path_factory.mktemp("plain") / "run", {})


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_an_example_is_short(path: Path) -> None:
    assert len(path.read_text().splitlines()) < 60


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    [
        {"learning.algorithm": "examples.fednova:make"},
        {"learning.algorithm": "examples.fedbuff:make"},
        {"radio.truth": "examples.rician:make"},
        {"radio.belief": "examples.mean_gain:make", **WALLED},
        {"communities.0.network": "examples.batch_norm:Net"},
        {"communities.0.network": "examples.batch_norm:Net", "communities.0.buffers": "local"},
        {"communities.0.network": "examples.batch_norm:Net", "learning.algorithm": "scaffold"},
        {"communities.0.task": "examples.writers:load", "communities.0.partition": "owners"},
        {
            "communities.0.task": "examples.tabular:load",
            "communities.0.network": "convnet",
            "communities.0.convnet": {"channels": [], "hidden": [16]},
        },
        {"communities.0.partition": "examples.quantity_skew:split"},
        {"callbacks": ["examples.tensorboard_rounds:make"]},
        {"mission.strategy": "examples.staleness:make"},
        {"mission.strategy": "examples.same_plans:make"},
        {"mission.strategy": "examples.weights:weak_task"},
        {
            "learning.algorithm": "examples.late_updates:make",
            "learning.late": "stale",
            "communities.0.compute_s": [1.0, 25.0],
        },
    ],
    ids=lambda more: next(iter(more.values()))[0:30],
)
# A library that TensorBoard brings.
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_an_example_flies(more: dict[str, Any], plain: aerofed.Run, tmp_path: Path) -> None:
    run = fly(tmp_path / "own", more)
    assert run.status == "finished"
    assert run.uplinks["delivered"].sum() > 0
    told = "callbacks" in more
    assert run.rounds.equals(plain.rounds) == told  # a callback alters nothing
    if told:
        for name in TABLES:
            assert (run.path / name).read_bytes() == (plain.path / name).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["staleness", "same_plans"])
def test_everything_at_once_resumes_to_the_same_bytes(tmp_path: Path, strategy: str) -> None:
    more = {
        "learning.algorithm": "examples.fedbuff:make",
        "radio.truth": "examples.rician:make",
        "communities.0.task": "examples.writers:load",
        "communities.0.partition": "owners",
        "communities.0.network": "examples.batch_norm:Net",
        "communities.0.buffers": "local",
        "communities.1.partition": "examples.quantity_skew:split",
        "mission.strategy": f"examples.{strategy}:make",
    }
    check_resumed({**SMALL, **more}, tmp_path)


def updates(*models: tuple[float, float], steps: tuple[int, ...], p: float = 0.2) -> list[Update]:
    return [
        Update(device, p, np.array(model, np.float32), count, np.zeros(2, np.float32))
        for device, (model, count) in enumerate(zip(models, steps, strict=True))
    ]


def test_fednova_counts_the_work_that_momentum_piles_up() -> None:
    algorithm = fednova.make(LearningConfig(momentum=0.9))
    for steps in (1, 2, 7):
        velocity = moved = 0.0
        for _ in range(steps):  # SGD on a gradient of 1 with a rate of 1
            velocity = 0.9 * velocity + 1.0
            moved += velocity
        assert algorithm.work(steps) == pytest.approx(moved)
    model = np.zeros(2, np.float32)
    same = updates((1.0, 0.0), (0.0, 2.0), steps=(5, 5))
    average, _ = FedAvg(momentum=0.9).apply({}, model, same)
    assert algorithm.apply({}, model, same)[0] == pytest.approx(average)
    # Twice the steps along one gradient are no louder than one: [1, 0] and [0, 1] weigh alike.
    plain = fednova.FedNova(momentum=0.0)
    after, _ = plain.apply({}, model, updates((2.0, 0.0), (0.0, 1.0), steps=(2, 1)))
    assert after == pytest.approx([0.75, 0.75])  # (1.5 mean steps) x mean direction of 1/2


def test_fedbuff_waits_and_weighs_by_staleness(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fedbuff, "BUFFER", 2)
    algorithm = fedbuff.make(LearningConfig())
    model = np.zeros(2, np.float32)
    state = algorithm.init(model, 3)
    one, state = algorithm.apply(state, model, updates((1.0, 0.0), steps=(1,)))
    assert one.tolist() == [0.0, 0.0]  # one of two
    two, state = algorithm.apply(state, one, updates((0.0, 1.0), steps=(1,)))
    assert two == pytest.approx([0.5, 0.5])
    assert algorithm.start(state, two, 0) == pytest.approx([0.5, 0.5])
    assert algorithm.start(state, two, 2).tolist() == [0.0, 0.0]  # never heard: what it began with
    stale = [Update(2, 0.2, np.array([2.0, 0.0], np.float32), 1, model)]  # 1 old
    three, state = algorithm.apply(state, two, [*stale, *updates((0.5, 0.5), steps=(1,))])
    assert three == pytest.approx([0.5 + 2.0 / np.sqrt(2.0) / 2.0, 0.5])


def test_weights_of_devices_and_of_communities() -> None:
    info = aerofed.RoundInfo(
        round=5,
        delta=np.ones(3),
        p=np.array([0.25, 0.75, 1.0]),
        cov=np.array([4.0, 4.0, 1.0]),
        community_of=np.array([0, 0, 1]),
        last_heard=np.array([4, 2, 0]),  # the last one never was
        accuracy=np.array([0.5, 0.9, np.nan]),
        ready_in_s=np.zeros(3),
        staleness=np.zeros(3, np.int64),
    )

    def weight(strategy: Any) -> list[float]:
        return list(strategy(SimpleNamespace(planner=None)).importance(info))

    assert weight(weights.age) == [0.25, 2.25, 5.0]
    assert weight(weights.age_cov) == [1.0, 9.0, 5.0]
    assert weight(weights.sqrt_cov) == [0.5, 2.25, 1.5]
    assert weight(weights.cov_squared) == [4.0, 18.0, 1.5]
    assert weight(weights.weak_device) == pytest.approx([0.125, 0.1125, 1.5])
    assert weight(weights.weak_task) == pytest.approx([0.05, 0.225, 1.5])  # mean 0.2, and 1
    assert weight(weights.worst_device) == pytest.approx([0.125, 0.5625, 1.5])  # 0.5, and 1


def test_a_weight_per_metre_is_half_a_leg_away() -> None:
    problem = round_problem(
        devices_m=np.array([[0.0, 0.0], [0.0, 400.0]]),
        importance=np.array([1.0, 1.5]),
        start_m=np.zeros(2),
        steps=2,
        per_step=1,
        path_budget_m=800.0,
        channel=aerofed.channel("suburban"),
    )
    asked: list[aerofed.RoundProblem] = []

    def plan(weighed: aerofed.RoundProblem) -> aerofed.RoundPlan:
        asked.append(weighed)
        return aerofed.finish(weighed, [[0.0, 0.0], [0.0, 400.0]])

    context: Any = SimpleNamespace(planner=SimpleNamespace(plan=plan))
    made = per_metre.per_metre(context).sortie(0, problem).plan
    assert list(asked[0].importance) == [1.0, 0.75]
    assert made.value == pytest.approx(aerofed.finish(problem, made.waypoints_m).value)


def test_late_updates_weigh_less_and_move_from_where_they_began() -> None:
    algorithm = late_updates.make(LearningConfig())
    model, old = np.array([1.0, 1.0], np.float32), np.array([0.0, 0.0], np.float32)
    new = [Update(k, 0.2, m, 1, model) for k, m in enumerate((2.0 * model, 3.0 * model))]
    after, _ = algorithm.apply({}, model, new)
    assert after == pytest.approx(FedAvg(momentum=0.9).apply({}, model, new)[0])
    late = Update(1, 0.6, np.array([4.0, 0.0], np.float32), 1, old, staleness=3)
    after, _ = algorithm.apply({}, model, [new[0], late])
    assert after == pytest.approx([1.0 + (0.2 + 0.6 * 4.0 / 2.0) / 0.8, 1.0 + 0.2 / 0.8])


def test_rician_against_drawn_channels() -> None:
    channel = aerofed.channel("suburban")
    ground = np.zeros((1, 2))
    radio = rician.make(channel, ground)
    distance, height = np.array([0.0, 600.0, 1500.0]), np.full(3, 60.0)
    flown = np.zeros(3, dtype=np.int64), np.column_stack((0 * distance, distance, height))
    rng = np.random.default_rng(1)
    gains = (
        np.abs(
            np.sqrt(radio.k / (radio.k + 1.0))
            + np.sqrt(0.5 / (radio.k + 1.0)) * (rng.standard_normal((2, 200_000)).T @ [1.0, 1.0j])
        )
        ** 2
    )
    slant = np.hypot(distance, height)
    mean = 10 ** ((channel.tx_power_db + channel.beta_los_db - channel.noise_db) / 10)
    snr = mean * slant**-channel.alpha_los
    drawn = [(gains * mean_snr < channel.snr_threshold).mean() for mean_snr in snr]
    assert radio.per(*flown) == pytest.approx(drawn, abs=4e-3)
    assert np.ptp(radio.per(*flown)) > 0.3
    rayleigh = rician.Rician(channel, ground, 0.0).per(*flown)
    assert rayleigh == pytest.approx(1.0 - np.exp(-channel.snr_threshold / snr))


def test_a_measured_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = ["distance_m,height_m,per", "0,60,0.1", "100,60,0.5", "0,30,0.2", "100,30,0.9"]
    (tmp_path / "measured_per.csv").write_text("\n".join(rows))
    radio = measured_radio.make(aerofed.channel(), np.array([[9.0, 1.0]]))
    east, height = np.array([0.0, 50.0, 50.0, 999.0]), np.array([60.0, 60.0, 45.0, 0.0])
    places = np.column_stack((9.0 + east, np.ones(4), height))
    given = radio.per(np.zeros(4, dtype=np.int64), places)
    assert given == pytest.approx([0.1, 0.3, 0.425, 0.9])
    run = flown_as(tmp_path / "out", radio__truth="examples.measured_radio:make")
    for item in run.uplinks.itertuples():
        assert 0.1 <= item.true_per <= 0.9
        assert item.plan_per != item.true_per


@pytest.mark.slow
def test_owners_are_the_devices(tmp_path: Path) -> None:
    more = {"communities.0.task": "examples.writers:load", "communities.0.partition": "owners"}
    run = fly(tmp_path / "out", {**more, "communities.0.subset": 1.0})
    samples = [
        int(line.split(",")[4]) for line in (run.path / "devices.csv").read_text().splitlines()[1:5]
    ]
    owner = writers.load(None).owner
    assert owner is not None
    assert set(samples) <= set(np.bincount(owner).tolist())


def test_tabular_data_can_be_learnt(tmp_path: Path) -> None:
    samples = tabular.load(None)
    np.savez(
        tmp_path / "table.npz",
        features=np.concatenate([samples.x_train, samples.x_test]),
        labels=np.concatenate([samples.y_train, samples.y_test]),
    )
    network = {"network": "convnet", "convnet": {"channels": [], "hidden": [16]}}
    community = {"name": "table", "task": "npz", "data_file": "table.npz", **network}
    settings = {
        **SMALL, "mission.strategy": "ideal", "communities": [{**community, "partition": "iid"}],
        "learning.local_epochs": 10,
    }  # fmt: skip
    del settings["communities.0.devices"], settings["communities.1.devices"]
    run = aerofed.run("quickstart", settings, out=tmp_path / "out", data_dir=tmp_path)
    assert run.rounds["accuracy_table"].iloc[-1] > 0.8


def test_quantity_skew() -> None:
    labels = np.arange(1000) % 10
    task = aerofed.PartitionTask(labels, None, 4, 10, np.random.default_rng(1))
    sizes = [len(share) for share in quantity_skew.split(task)]
    assert sizes == [480, 240, 160, 120]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_tensorboard_reads_what_was_written(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    run = flown_as(tmp_path / "out", callbacks=["examples.tensorboard_rounds:make"])
    events = EventAccumulator(str(run.path / "tensorboard"))
    events.Reload()
    written = [(item.step, item.value) for item in events.Scalars("accuracy/digits")]
    assert [step for step, _ in written] == [1, 2, 3]
    assert [value for _, value in written] == pytest.approx(run.rounds["accuracy_digits"])


@pytest.mark.slow
def test_an_installed_package_offers_plugins_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "site" / "nova-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: nova\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\nnova = examples.fednova:make\n")
    monkeypatch.syspath_prepend(tmp_path / "site")
    by_name = flown_as(tmp_path / "name", learning__algorithm="nova")
    by_path = flown_as(tmp_path / "path", learning__algorithm="examples.fednova:make")
    for name in TABLES:
        assert (by_name.path / name).read_bytes() == (by_path.path / name).read_bytes()
    with pytest.raises(aerofed.InputError, match=r"'nova' or the import path.*mean nova\?"):
        aerofed.config("quickstart", {"learning.algorithm": "novas"})


def test_the_mean_gain_moves_a_device_by_what_was_heard_of_it() -> None:
    prior: Any = SimpleNamespace(per=lambda device, _: np.full(len(device), 0.5))  # so 10 dB
    terms = aerofed.LinkTerms(0.0, 1e6, 7.0, 10.0, 3.0)
    belief, place_m = mean_gain.make(prior, terms, np.zeros((3, 2))), np.zeros((4, 3))
    assert belief.success(aerofed.Heard(), place_m) == pytest.approx(np.full((3, 4), 0.5))
    device = np.repeat([0, 2], 5)
    heard = aerofed.Heard(device, np.zeros((10, 3)), np.where(device == 0, 30.0, 4.0))
    up, same, down = np.array(belief.success(heard, place_m))
    # The mean of five tones and as many of 0 dB, over a spread of 3 and 10 dB.
    assert up == pytest.approx(ndtr(10.0 / np.hypot(3.0, 10.0)))
    assert same == pytest.approx(0.5)
    assert down == pytest.approx(ndtr(-3.0 / np.hypot(3.0, 10.0)))
