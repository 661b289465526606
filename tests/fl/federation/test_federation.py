"""Rounds of a federation against the specification, retold with loops and plain torch modules."""

import io
import itertools
import math
import os
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from reference_net import PlainNet, right_per_class, train_plainly

from fl.config import CommunityConfig, LearningConfig
from fl.data.dataset import SourceFile, Split
from fl.errors import CheckpointError, DivergedError
from fl.federation import rounds as fed
from fl.federation.algorithms import CustomAlgorithm
from fl.federation.community import Federation, build_federation
from fl.federation.state import FederationState, from_bytes, to_bytes
from fl.federation.updates import begin_training
from fl.training.local import LocalResult, LocalTask
from fl.training.networks import ConvNet
from flightdyn.random import RandomStreams
from native.errors import InputError, SettingError, UsersCodeError

DIGITS = CommunityConfig(name="digits", task="digits", devices=4, labels_per_device=3)
SHAPES = CommunityConfig(name="shapes", task="colour-shapes", devices=3, partition="iid")
FAST = LearningConfig(batch_size=64, learning_rate=0.03, cov_period_rounds=3)


def build(
    learning: LearningConfig = FAST, *communities: CommunityConfig, seed: int = 1
) -> Federation:
    streams = RandomStreams(seed)
    return build_federation(
        communities or (DIGITS,), learning, data_dir=None, stream=streams.generator
    )


def flags(count: int, *true: int) -> np.ndarray:
    out = np.zeros(count, dtype=bool)
    out[list(true)] = True
    return out


def play(
    federation: Federation, state: FederationState, *delivered: int
) -> tuple[FederationState, fed.RoundLearning]:
    got = flags(federation.p.size, *delivered)
    return fed.play_round(federation, state, fed.Participation(got, got))


def right(federation: Federation, part: Split, model: np.ndarray) -> np.ndarray:
    """How many images of each class the digits' model gets right, by torch."""
    community = federation.communities[0]
    assert isinstance(community.network, ConvNet)
    images = part.images * community.scaling.scale + community.scaling.shift
    net = PlainNet(community.network).load(model)
    return right_per_class(net, images.astype(np.float32), part.labels, 10)


def test_setup_numbers_devices_through_and_shares_sum_to_one() -> None:
    federation = build(FAST, DIGITS, SHAPES)
    assert federation.names == ("digits", "shapes")
    assert federation.community_of.tolist() == [0, 0, 0, 0, 1, 1, 1]
    assert federation.members(1) == slice(4, 7)
    samples = [share.size for c in federation.communities for share in c.shares]
    expected = [n / sum(samples[:4]) for n in samples[:4]]
    expected += [n / sum(samples[4:]) for n in samples[4:]]
    np.testing.assert_allclose(federation.p, expected, rtol=1e-15)


@pytest.mark.slow
def test_a_round_is_the_weighted_mean_of_what_plain_torch_trains() -> None:
    federation = build()
    start = fed.init(federation)
    after, learnt = play(federation, start, 0, 2)
    community = federation.communities[0]
    net, split = community.network, community.dataset.train
    assert isinstance(net, ConvNet)
    images = (split.images * community.scaling.scale + community.scaling.shift).astype(np.float32)
    total, weight = np.zeros(start.communities[0].model.size), 0.0
    for device in (0, 2):
        stream = RandomStreams(1).generator(f"fl/digits/device{device}/round1")
        order = stream.permutation(community.shares[device])
        batches = [order[i : i + 64] for i in range(0, len(order), 64)]
        plain = PlainNet(net).load(start.communities[0].model)
        loss = train_plainly(
            plain, images, split.labels, batches, learning_rate=0.03, momentum=0.9, mu=0.1
        )
        assert learnt.device_loss[device] == pytest.approx(loss, rel=1e-4)
        p = len(community.shares[device]) / sum(len(s) for s in community.shares)
        total += p * plain.flat()
        weight += p
    np.testing.assert_allclose(after.communities[0].model, total / weight, rtol=1e-3, atol=1e-5)
    assert np.isnan(learnt.device_loss[[1, 3]]).all()
    assert after.missed.tolist() == [False, True, False, True]


def test_devices_whose_update_is_lost_change_nothing() -> None:
    """Trained or not, alone or beside others: the model of those that arrive is the same."""
    federation = build()
    state = fed.init(federation)
    everyone, some = flags(4, 0, 1, 2, 3), flags(4, 1, 3)
    lost, _ = fed.play_round(federation, state, fed.Participation(everyone, some))
    alone, _ = fed.play_round(federation, state, fed.Participation(some, some))
    np.testing.assert_array_equal(lost.communities[0].model, alone.communities[0].model)
    # Each on its own, then averaged: what arrives does not depend on who else trained.
    single = [play(federation, state, k)[0].communities[0].model for k in (1, 3)]
    p = federation.p[[1, 3]] / federation.p[[1, 3]].sum()
    joined = p[0] * single[0].astype(float) + p[1] * single[1].astype(float)
    np.testing.assert_allclose(alone.communities[0].model, joined, rtol=1e-6, atol=1e-7)


def test_a_community_without_arrivals_keeps_its_model_and_is_still_measured() -> None:
    federation = build(FAST, DIGITS, SHAPES)
    state, before = play(federation, fed.init(federation), 0, 5)
    after, learnt = play(federation, state, 4, 6)
    np.testing.assert_array_equal(after.communities[0].model, state.communities[0].model)
    assert (after.communities[1].model != state.communities[1].model).any()
    assert learnt.accuracy["digits"] == before.accuracy["digits"]


def retold_cov(
    federation: Federation, eps_of_models: list[np.ndarray], arrivals: list[set[int]]
) -> list[float]:
    """psi per community after the last round, from the paper's sentences, rounds from 1."""
    period = federation.learning.cov_period_rounds
    received: dict[int, float] = {}
    psi = [1.0] * len(federation.communities)
    for m, arrived in enumerate(arrivals, start=1):
        for k in arrived:
            # What came down in round j, m - l <= j <= m - 1, is the model after round j - 1.
            models = [j - 1 for j in range(max(1, m - period), m)] or [0]
            received[k] = sum(float(eps_of_models[j][k]) for j in models) / len(models)
        if m % period == 0:
            for c in range(len(psi)):
                devices = [k for k, of in enumerate(federation.community_of) if of == c]
                heard = [k for k in devices if k in received]
                whole = sum(float(federation.p[k]) for k in heard)
                mean = sum(float(federation.p[k]) / whole * received[k] for k in heard)
                psi[c] = (
                    math.sqrt(sum((received[k] - mean) ** 2 for k in heard)) / mean
                    if mean else 1.0
                )  # fmt: skip
    return psi


def test_cov_and_importance_over_rounds_are_as_specified() -> None:
    federation = build(FAST, DIGITS, SHAPES)
    state = fed.init(federation)
    assert state.cov.tolist() == [1.0, 1.0]
    for fairness in (True, False):
        first = fed.importance(federation, state, fairness=fairness)
        np.testing.assert_allclose(first, 1.5 * federation.p)
        np.testing.assert_array_equal(fed.first_importance(federation), first)
    eps, rounds = [state.eps_history[0]], []
    for arrived in ({0, 1, 4}, {2}, {0, 5}, {1, 4, 5, 6}, set(), {3, 0, 4}, {1}):
        state, learnt = play(federation, state, *arrived)
        rounds.append(arrived)
        psi = retold_cov(federation, eps, rounds)
        np.testing.assert_allclose(list(learnt.cov.values()), psi, rtol=1e-12)
        eps.append(learnt.device_accuracy)
        for k, c in enumerate(federation.community_of):
            boost = 1.0 if k in arrived else 1.5
            assert fed.importance(federation, state, fairness=True)[k] == pytest.approx(
                federation.p[k] * max(psi[c], 0.1) * boost
            )
            assert fed.importance(federation, state, fairness=False)[k] == pytest.approx(
                federation.p[k] * boost
            )
    assert len(set(state.cov.tolist())) == 2
    assert 1.0 not in state.cov


def test_a_scheduled_device_whose_update_is_lost_counts_as_missed() -> None:
    federation = build()
    who = fed.Participation(flags(4, 0, 1), flags(4, 1))
    state, _ = fed.play_round(federation, fed.init(federation), who)
    assert state.missed.tolist() == [True, False, True, True]
    assert np.isnan(state.eps_received).tolist() == [True, False, True, True]


def test_device_accuracy_is_measured_in_the_proportions_of_the_devices_data() -> None:
    federation = build()
    state, learnt = play(federation, fed.init(federation), 0, 1, 2, 3)
    community = federation.communities[0]
    of_class = right(federation, community.validation, state.communities[0].model)
    assert state.communities[0].correct.tolist() == of_class.tolist()
    of_class = of_class / np.bincount(community.validation.labels)
    for device, share in enumerate(community.shares):
        own = community.dataset.train.labels[share]
        assert learnt.device_accuracy[device] == pytest.approx(np.mean(of_class[own]))
    assert len(set(learnt.device_accuracy.tolist())) > 1


def test_accuracy_is_reported_on_images_that_importance_never_sees() -> None:
    federation = build()
    state, learnt = play(federation, fed.init(federation), 0, 1, 2, 3)
    community = federation.communities[0]
    every = community.dataset.validation
    parts = [community.validation, community.reporting]
    assert sum(len(part.labels) for part in parts) == len(every.labels)
    images = {image.tobytes() for image in parts[0].images}
    assert not images & {image.tobytes() for image in parts[1].images}
    for label in range(10):
        of_each = [int((part.labels == label).sum()) for part in parts]
        assert abs(of_each[0] - of_each[1]) <= 1
    found = right(federation, parts[1], state.communities[0].model).sum()
    assert learnt.accuracy["digits"] == found / len(parts[1].labels)


def test_accuracy_may_be_reported_on_all_images_that_drive_importance() -> None:
    federation = build(FAST.model_copy(update={"report_on": "validation"}))
    state, learnt = play(federation, fed.init(federation), 0, 1, 2, 3)
    every = federation.communities[0].dataset.validation
    assert federation.communities[0].validation is every
    found = right(federation, every, state.communities[0].model).sum()
    assert learnt.accuracy["digits"] == found / len(every.labels)


def test_a_test_part_that_leaves_nothing_to_validate_is_refused(tmp_path: Path) -> None:
    images = np.random.default_rng(0).integers(0, 256, (24, 4, 4)).astype(np.uint8)
    labels = np.arange(24) % 2
    np.savez(
        tmp_path / "few.npz",
        x_train=images[:22], y_train=labels[:22], x_test=images[22:], y_test=labels[22:],
    )  # fmt: skip
    few = CommunityConfig(
        name="few", task="npz", data_file="few.npz", devices=2, labels_per_device=1
    )
    streams = RandomStreams(1)
    with pytest.raises(SettingError, match=r"learning\.report_on = 'test': must be 'validation'"):
        build_federation([few], FAST, data_dir=tmp_path, stream=streams.generator)
    alone = FAST.model_copy(update={"report_on": "validation"})
    build_federation([few], alone, data_dir=tmp_path, stream=streams.generator)


def test_a_network_that_does_not_fit_names_its_community(tmp_path: Path) -> None:
    images = np.zeros((24, 3, 8), np.uint8)
    np.savez(tmp_path / "few.npz", images=images, labels=np.arange(24) % 2)
    small = CommunityConfig(
        name="small", task="npz", data_file="few.npz", devices=2, labels_per_device=1
    )
    with pytest.raises(SettingError, match=r"^communities.0.network = 'lenet': .*too small"):
        build_federation([small], FAST, data_dir=tmp_path, stream=RandomStreams(1).generator)


def test_who_missed_a_round_is_the_papers_text_or_its_equation() -> None:
    scheduled, delivered = flags(4, 0, 1), flags(4, 1)
    for missed, expected in (
        ("lost-too", [True, False, True, True]),
        ("unscheduled", [False, False, True, True]),
    ):
        federation = build(FAST.model_copy(update={"missed": missed}))
        who = fed.Participation(scheduled, delivered)
        state, _ = fed.play_round(federation, fed.init(federation), who)
        assert state.missed.tolist() == expected


def test_fedprox_without_its_term_is_fedavg() -> None:
    prox = build(FAST.model_copy(update={"mu": 0.0}))
    average = build(FAST.model_copy(update={"algorithm": "fedavg"}))
    one, other = fed.init(prox), fed.init(average)
    for _ in range(2):
        one, _ = play(prox, one, 0, 1, 3)
        other, _ = play(average, other, 0, 1, 3)
    np.testing.assert_array_equal(one.communities[0].model, other.communities[0].model)
    with_term = build()
    moved, _ = play(with_term, fed.init(with_term), 0, 1, 3)
    assert (
        moved.communities[0].model != play(prox, fed.init(prox), 0, 1, 3)[0].communities[0].model
    ).any()


@pytest.mark.parametrize("algorithm", ["fedprox", "fedavg", "fedavgm", "fedadam", "scaffold"])
def test_every_algorithm_learns_the_digits(algorithm: str) -> None:
    learning = LearningConfig.model_validate(
        {"algorithm": algorithm, "learning_rate": 0.05, "local_epochs": 2}
    )
    federation = build(learning, DIGITS.model_copy(update={"partition": "iid"}))
    state = fed.init(federation)
    for _ in range(6):
        state, learnt = play(federation, state, 0, 1, 2, 3)
    assert learnt.accuracy["digits"] > 0.6


def test_runs_repeat_to_the_bit_and_communities_do_not_disturb_each_other() -> None:
    def run(*communities: CommunityConfig, seed: int = 1) -> FederationState:
        federation = build(FAST, *communities, seed=seed)
        state = fed.init(federation)
        for _ in range(2):
            state, _ = play(federation, state, 0, 3)
        return state

    first, again = run(DIGITS, SHAPES), run(DIGITS, SHAPES)
    for one, other in zip(first.communities, again.communities, strict=True):
        np.testing.assert_array_equal(one.model, other.model)
    np.testing.assert_array_equal(first.communities[0].model, run(DIGITS).communities[0].model)
    assert (first.communities[0].model != run(DIGITS, seed=2).communities[0].model).any()


def test_any_number_of_workers_gives_the_same_bytes() -> None:
    federation = build(FAST, DIGITS, SHAPES)
    state = fed.init(federation)
    everyone = np.ones(7, dtype=bool)
    saved = {
        to_bytes(
            federation,
            fed.play_round(
                federation, state, fed.Participation(everyone, everyone), workers=workers
            )[0],
        )
        for workers in (1, 2, 5)
    }
    assert len(saved) == 1


def test_a_checkpoint_keeps_the_shape_of_a_number_that_an_algorithm_counts() -> None:
    federation = build(FAST, DIGITS)
    state = fed.init(federation)
    (one,) = state.communities
    counted = replace(state, communities=(replace(one, algorithm={"t": np.array(3.0)}),))
    back = from_bytes(federation, to_bytes(federation, counted)).communities[0].algorithm["t"]
    assert (back.shape, float(back)) == ((), 3.0)


def test_training_that_began_before_who_arrives_was_known_gives_the_same_bytes() -> None:
    """What is done, at work, still waiting; asked for or not: all of it comes out the same."""
    federation = build(FAST, DIGITS, SHAPES)
    state = fed.init(federation)
    likely, some = flags(7, 0, 1, 2, 4, 5), flags(7, 0, 2, 3, 5)
    who = fed.Participation(np.ones(7, dtype=bool), some)
    expected = to_bytes(federation, fed.play_round(federation, state, who)[0])
    for done in range(6):
        with ThreadPoolExecutor(1) as pool:
            early = begin_training(pool, federation, state, likely)
            assert len(early) == 5
            list(itertools.islice(as_completed(early.values()), done))
            after, _ = fed.play_round(federation, state, who, workers=2, early=early)
            assert to_bytes(federation, after) == expected
    # What was done is taken over, not done again.
    another = {**early, (0, 2): early[0, 0]}
    after, _ = fed.play_round(federation, state, who, early=another)
    assert to_bytes(federation, after) != expected


def test_nobody_is_told_of_a_divergence_whose_update_is_lost() -> None:
    federation = build(FAST.model_copy(update={"learning_rate": 10.0, "local_epochs": 5}))
    state, nobody = fed.init(federation), fed.Participation(flags(4, 2), flags(4))
    with ThreadPoolExecutor(1) as pool:
        early = begin_training(pool, federation, state, flags(4, 2))
        assert isinstance(early[0, 2].exception(), DivergedError)
        fed.play_round(federation, state, nobody, early=early)
        with pytest.raises(DivergedError, match="device 2"):
            fed.play_round(federation, state, replace(nobody, delivered=flags(4, 2)), early=early)


def test_own_code_is_asked_only_for_what_is_wanted() -> None:
    federation = build()
    for changed in (
        replace(federation, trainer=Mock()),
        replace(federation, algorithm=CustomAlgorithm("mine", Mock())),
    ):
        pool = Mock()
        assert begin_training(pool, changed, fed.init(federation), flags(4, 2)) == {}
        pool.submit.assert_not_called()


@pytest.mark.parametrize(("loss", "value"), [(math.nan, 0.0), (0.5, math.inf)])
def test_a_trainer_of_your_own_diverges_by_its_loss_or_by_its_model(
    loss: float, value: float
) -> None:
    federation = build()

    def train(_device: object, task: LocalTask) -> LocalResult:
        return LocalResult(np.full_like(task.model, value), 1, loss)

    own = replace(federation, trainer=Mock(train=train))
    with pytest.raises(DivergedError, match="round 1, community digits, device 0"):
        play(own, fed.init(own), 0)


def test_divergence_names_round_community_and_device() -> None:
    federation = build(FAST.model_copy(update={"learning_rate": 10.0, "local_epochs": 5}))
    state = fed.init(federation)
    state, _ = play(federation, state)
    with pytest.raises(DivergedError, match="round 2, community digits, device 2") as caught:
        play(federation, state, 2)
    assert (caught.value.round, caught.value.community, caught.value.device) == (2, "digits", 2)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["fedprox", "fedadam", "scaffold"])
def test_a_resumed_federation_goes_on_to_the_bit(algorithm: str) -> None:
    learning = FAST.model_copy(update={"algorithm": algorithm})
    federation = build(learning, DIGITS, SHAPES)
    state = fed.init(federation)
    for arrived in ((0, 1, 4), (2, 5)):
        state, _ = play(federation, state, *arrived)
    saved = to_bytes(federation, state)
    assert saved == to_bytes(federation, state)
    fresh = build(learning, DIGITS, SHAPES)
    resumed = from_bytes(fresh, saved)
    for arrived in ((1, 4), (3, 5, 6)):
        state, _ = play(federation, state, *arrived)
        resumed, _ = play(fresh, resumed, *arrived)
    assert to_bytes(federation, state) == to_bytes(fresh, resumed)


def damaged(saved: bytes) -> list[bytes]:
    return [b"", saved[:50], saved[: len(saved) // 2], saved[:-1], b"{}\n", b"[1]\n" + saved]


class RunsCode:
    """Unpickled, it makes the folder `ran`."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, ("ran",)


def test_nothing_of_a_checkpoint_is_pickled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    federation = build(FAST, DIGITS)
    state = fed.init(federation)
    code = np.array([RunsCode()])
    (one,) = state.communities
    wrong = replace(state, communities=(replace(one, algorithm={"t": code}),))
    with pytest.raises(ValueError, match="allow_pickle=False"):
        to_bytes(federation, wrong)
    pickled = io.BytesIO()
    np.lib.format.write_array(pickled, code, allow_pickle=True)
    header = to_bytes(federation, state).partition(b"\n")[0]
    with pytest.raises(CheckpointError, match=r"damaged: .*allow_pickle=False"):
        from_bytes(federation, header + b"\n" + pickled.getvalue())
    assert not Path("ran").exists()


def test_foreign_or_damaged_checkpoints_are_refused() -> None:
    federation = build()
    saved = to_bytes(federation, fed.init(federation))
    own = federation.communities[0]
    pixels = (SourceFile("pixels", "another sum", official=False),)
    files = replace(own.dataset.provenance, files=pixels)
    altered = replace(own, dataset=replace(own.dataset, provenance=files))
    for other in (
        build(seed=2),
        build(FAST.model_copy(update={"algorithm": "fedadam"})),
        replace(federation, communities=(altered, *federation.communities[1:])),
    ):
        with pytest.raises(CheckpointError, match="written with other data"):
            from_bytes(other, saved)
    for bad in damaged(saved):
        with pytest.raises(CheckpointError):
            from_bytes(federation, bad)
    newer = saved.replace(b'"format": 3', b'"format": 9', 1)
    with pytest.raises(CheckpointError, match="format 9"):
        from_bytes(federation, newer)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"labels_per_device": 11}, r"communities.0.labels_per_device = 11: .* 10 classes"),
        ({"labels_per_device": 2, "coverage": True}, "communities.0.coverage"),
        ({"devices": 900, "partition": "dirichlet"}, "communities.0.dirichlet_alpha"),
        ({"network": "resnet"}, "communities.0.network = 'resnet': cannot be imported: Mod"),
        (
            {"task": "npz", "data_file": "x.npz"},
            r"npz: needs files: give their folder \(--data-dir",
        ),
        ({"task": "mnist"}, r"mnist: needs files: give their folder \(--data-dir"),
    ],
)
def test_settings_that_cannot_be_built_are_named(change: dict[str, object], message: str) -> None:
    with pytest.raises((InputError, UsersCodeError), match=message):
        build(FAST, DIGITS.model_copy(update=change))


def test_names_must_differ() -> None:
    with pytest.raises(InputError, match="'digits': is given twice"):
        build(FAST, DIGITS, replace_name(SHAPES, "digits"))


def replace_name(config: CommunityConfig, name: str) -> CommunityConfig:
    return config.model_copy(update={"name": name})


def test_delivering_without_being_scheduled_is_a_bug() -> None:
    federation = build()
    state = fed.init(federation)
    with pytest.raises(ValueError, match="cannot deliver"):
        fed.play_round(federation, state, fed.Participation(flags(4), flags(4, 1)))
    with pytest.raises(ValueError, match="must be of shape"):
        fed.play_round(federation, state, fed.Participation(flags(5), flags(5)))


def test_real_data_learns(shared_data: Path) -> None:
    """One round of everybody on the small MNIST beats guessing by far."""
    config = CommunityConfig(name="mnist", task="mnist", devices=4, partition="iid")
    federation = build_federation(
        [config], LearningConfig(), data_dir=shared_data / "small",
        stream=RandomStreams(1).generator,
    )  # fmt: skip
    state = fed.init(federation)
    for _ in range(2):
        state, learnt = play(federation, state, 0, 1, 2, 3)
    assert learnt.accuracy["mnist"] > 0.7
