"""Devices that take time: what each is at work on, and updates that arrive rounds later."""

import numpy as np
import pytest
from test_federation import DIGITS, FAST, build, flags

from fl.config import CommunityConfig, LearningConfig
from fl.federation import rounds as fed
from fl.federation.community import Federation
from fl.federation.device_work import DeviceWork, compute_times
from fl.federation.state import FederationState, from_bytes, to_bytes
from fl.plugin_code import register

S = 1_000_000_000
SAMPLES = np.array([10, 20, 30, 40])


def times(seed: int = 1, epochs: int = 1, **keys: object) -> np.ndarray:
    config = CommunityConfig.model_validate({**DIGITS.model_dump(exclude_none=True), **keys})
    return compute_times(config, SAMPLES, epochs=epochs, rng=np.random.default_rng(seed))


def test_compute_times_are_given_drawn_or_follow_the_data() -> None:
    assert times().tolist() == [0.0] * 4
    assert times(compute_s=20).tolist() == [20.0] * 4
    assert times(compute_times_s=[1, 2, 3, 4]).tolist() == [1.0, 2.0, 3.0, 4.0]
    assert times(compute_s_per_sample=0.5, epochs=3).tolist() == [15.0, 30.0, 45.0, 60.0]
    assert times(compute_s=2, compute_s_per_sample=0.5).tolist() == [7.0, 12.0, 17.0, 22.0]
    drawn = times(compute_s=[5, 60])
    assert (drawn >= 5.0).all()
    assert (drawn <= 60.0).all()
    assert len(set(drawn.tolist())) == 4
    # What each sample takes comes on top of what is drawn, and of what is given.
    both = times(compute_s=[5, 60], compute_s_per_sample=0.5, epochs=2)
    assert both == pytest.approx(drawn + SAMPLES)
    given = times(compute_times_s=[1, 2, 3, 4], compute_s_per_sample=0.5)
    assert given.tolist() == [6.0, 12.0, 18.0, 24.0]
    assert times(compute_s=[5, 60]).tolist() == drawn.tolist()
    assert times(seed=2, compute_s=[5, 60]).tolist() != drawn.tolist()


def test_whoever_misses_a_round_begins_anew_with_the_next() -> None:
    work = DeviceWork.before(np.array([5.0, 50.0]), goes_on=False).round_begins(1, 10 * S)
    assert work.ready_ns.tolist() == [15 * S, 60 * S]
    work = work.round_ends(late=np.array([False, True]), sent=np.array([True, False]))
    assert not work.kept(40 * S).any()
    work = work.round_begins(2, 40 * S)
    assert (work.begun.tolist(), work.ready_ns.tolist()) == ([2, 2], [45 * S, 90 * S])


def test_work_goes_on_while_it_lasts_and_until_it_was_sent_where_it_was_asked_for() -> None:
    # 0: done at once. 1: asked too early, ready within the round. 2: never asked, ready in the
    # second round. 3: asked too early, ready in the third.
    work = DeviceWork.before(np.array([1.0, 30.0, 60.0, 90.0]), goes_on=True)
    nobody = flags(4)
    work = work.round_begins(1, 0).round_ends(late=flags(4, 1, 3), sent=flags(4, 0))
    assert work.kept(40 * S).tolist() == [False, True, True, True]
    work = work.round_begins(2, 40 * S)
    assert work.begun.tolist() == [2, 1, 1, 1]
    assert work.ready_ns.tolist() == [41 * S, 30 * S, 60 * S, 90 * S]
    work = work.round_ends(late=nobody, sent=nobody).round_begins(3, 80 * S)
    assert work.begun.tolist() == [3, 1, 3, 1]  # 1 and 3 still owe theirs
    work = work.round_ends(late=nobody, sent=flags(4, 1, 3)).round_begins(4, 120 * S)
    assert work.begun.tolist() == [4, 4, 3, 4]
    assert work.ready_ns.tolist() == [121 * S, 150 * S, 140 * S, 210 * S]


def play(
    federation: Federation,
    state: FederationState,
    *,
    delivered: tuple[int, ...] = (),
    begun: dict[int, int] | None = None,
    kept: tuple[int, ...] = (),
) -> tuple[FederationState, fed.RoundLearning]:
    count, got = federation.p.size, flags(federation.p.size, *delivered)
    since = np.full(count, state.rounds + 1)
    for device, number in (begun or {}).items():
        since[device] = number
    who = fed.Participation(got, got, since, flags(count, *kept))
    return fed.play_round(federation, state, who)


@pytest.mark.parametrize("algorithm", ["fedprox", "scaffold"])
def test_a_stale_update_is_the_one_that_was_made_then(algorithm: str) -> None:
    learning = FAST.model_copy(update={"algorithm": algorithm})
    federation = build(learning)
    first = fed.init(federation)
    at_once, told = play(federation, first, delivered=(2,))
    state, _ = play(federation, first, delivered=(0, 1), kept=(2,))
    without, _ = play(federation, first, delivered=(0, 1))
    assert state.communities[0].model.tobytes() == without.communities[0].model.tobytes()
    state, _ = play(federation, state, delivered=(0,), begun={2: 1}, kept=(2,))
    state = from_bytes(federation, to_bytes(federation, state))
    made = state.communities[0].pending[2]
    assert (made.begun, list(state.communities[0].pending)) == (1, [2])
    assert made.start.tobytes() == first.communities[0].model.tobytes()
    after, late = play(federation, state, delivered=(2,), begun={2: 1})
    assert late.device_loss[2] == told.device_loss[2]
    assert after.communities[0].pending == {}
    if algorithm == "scaffold":  # its control variate is the mean of the gradients that it saw
        then, now = at_once.communities[0].algorithm, after.communities[0].algorithm
        assert np.abs(now["control"] - then["control"]).max() > 1e-3
        assert then["device_controls"][2].any()
        np.testing.assert_allclose(
            now["device_controls"][2], then["device_controls"][2], rtol=0.0, atol=1e-6
        )
    if algorithm == "fedprox":  # the mean of one arrival is that model itself
        np.testing.assert_allclose(
            after.communities[0].model, at_once.communities[0].model, atol=1e-6
        )


class Spy:
    """Keeps what arrives."""

    mu, momentum = 0.0, 0.9

    def __init__(self) -> None:
        self.seen: list[tuple[int, int, bytes]] = []
        self.writeable = False  # anything that it was handed

    def init(self, model, devices):  # noqa: ARG002
        return {"own": np.zeros_like(model)}

    def correction(self, state, device):  # noqa: ARG002
        return state["own"]

    def apply(self, state, model, updates):
        self.seen += [(u.device, u.staleness, u.start.tobytes()) for u in updates]
        handed = [model, *(array for u in updates for array in (u.model, u.start, u.correction))]
        self.writeable |= any(array.flags.writeable for array in handed)
        return 0.5 * model, state


def test_an_algorithm_is_told_how_old_an_update_is_and_what_it_began_with() -> None:
    spy = Spy()
    federation = build(LearningConfig(algorithm=str(register(lambda _: spy)), batch_size=64))
    models = [fed.init(federation)]
    for more in (
        {"delivered": (0,), "kept": (3,)},
        {"delivered": (0,), "begun": {3: 1}, "kept": (3,)},
        {"delivered": (0, 3), "begun": {3: 1}},
    ):
        models.append(play(federation, models[-1], **more)[0])
    starts = [state.communities[0].model.tobytes() for state in models]
    assert spy.seen == [(0, 0, starts[0]), (0, 0, starts[1]), (0, 0, starts[2]), (3, 2, starts[0])]
    assert not spy.writeable


def test_keeping_what_arrives_is_a_bug() -> None:
    federation = build()
    with pytest.raises(ValueError, match="does not keep"):
        play(federation, fed.init(federation), delivered=(1,), kept=(1,))
