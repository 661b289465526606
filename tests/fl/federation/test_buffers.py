"""Modules with buffers: averaged over the arrivals, or kept by each device."""

import numpy as np
import pytest
import torch
from reference_net import right_per_class
from torch import nn

from fl.config import CommunityConfig, LearningConfig
from fl.federation import rounds as fed
from fl.federation.community import Federation, build_federation
from fl.federation.state import FederationState, from_bytes, to_bytes
from fl.plugin_code import register
from fl.training.networks import CustomNetwork
from fl.training.torch_module import ModuleNetwork
from flightdyn.random import RandomStreams
from native.errors import UsersCodeError

COMMUNITY = {
    "name": "digits", "task": "digits", "devices": 3, "labels_per_device": 5,
    "network": "test_buffers:Net",
}  # fmt: skip


class Net(nn.Module):
    """Its batch normalisation counts the batches, too, in a whole number."""

    def __init__(self) -> None:
        super().__init__()
        self.norm, self.dense = nn.BatchNorm1d(64, momentum=None), nn.Linear(64, 10)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.dense(self.norm(x.flatten(1)))


def build(algorithm: str = "fedadam", **more: str) -> Federation:
    community = CommunityConfig.model_validate({**COMMUNITY, **more})
    learning = LearningConfig(batch_size=64, learning_rate=0.05, algorithm=algorithm)
    return build_federation([community], learning, data_dir=None, stream=RandomStreams(1).generator)


def play(
    federation: Federation, state: FederationState, *heard: int
) -> tuple[FederationState, fed.RoundLearning]:
    got = np.isin(np.arange(3), heard)
    return fed.play_round(federation, state, fed.Participation(got, got))


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    monkeypatch.syspath_prepend(request.path.parent)


def test_buffers_go_out_and_come_back() -> None:
    net = Net()
    network = ModuleNetwork(CustomNetwork("Net", lambda: net), image_shape=(8, 8, 1), classes=10)
    assert network.buffers == 64 + 64 + 1
    statistics = np.repeat([0.5, 2.0, 7.4], (64, 64, 1))
    model = np.concatenate([np.ones(778), statistics]).astype(np.float32)
    assert network._take(model).tolist() == model[:778].tolist()
    assert net.norm.num_batches_tracked == 7
    assert net.norm.running_mean is not None
    assert net.norm.running_mean.tolist() == [0.5] * 64


def test_averaged_buffers_are_the_weighted_mean_of_what_arrived() -> None:
    federation = build()
    start = fed.init(federation)
    community = federation.communities[0]
    assert start.communities[0].buffers.shape == (0, 129)
    after, _ = play(federation, start, 0, 2)
    # Statistics that are counted up (momentum None) are means over the device's own samples.
    images = community.dataset.train.images.reshape(-1, 64).astype(np.float64)
    seen = images * community.scaling.scale + community.scaling.shift
    p = community.p[[0, 2]] / community.p[[0, 2]].sum()
    expected = np.zeros(64)
    for weight, device in zip(p, (0, 2), strict=True):
        order = RandomStreams(1).generator(f"fl/digits/device{device}/round1")
        samples = order.permutation(community.shares[device])
        batches = [samples[i : i + 64] for i in range(0, len(samples), 64)]
        expected += weight * np.mean([seen[batch].mean(axis=0) for batch in batches], axis=0)
    assert after.communities[0].model[-129:-65] == pytest.approx(expected, abs=1e-5)
    assert (
        after.communities[0].algorithm["first_moment"].size == after.communities[0].model.size - 129
    )


def test_local_buffers_stay_with_their_device_which_is_measured_with_them() -> None:
    federation = build(buffers="local")
    start = fed.init(federation)
    after, learnt = play(federation, start, 0, 2)
    kept = after.communities[0].buffers
    assert kept.shape == (3, 129)
    assert (kept[1] == start.communities[0].buffers[1]).all()  # not heard
    assert not np.allclose(kept[0], kept[2])
    community = federation.communities[0]
    # The model's parameters with each device's own statistics, by torch.
    parameters, part = torch.tensor(after.communities[0].model[:-129]), community.reporting
    images = (part.images * community.scaling.scale + community.scaling.shift).astype(np.float32)
    right = []
    for own in torch.tensor(kept):
        net = Net()
        nn.utils.vector_to_parameters(parameters, net.parameters())
        net.norm.running_mean, net.norm.running_var = own[:64], own[64:128]
        right.append(right_per_class(net, images, part.labels, 10).sum())
    every = len(part.labels)
    assert learnt.accuracy["digits"] == pytest.approx(community.p @ np.array(right) / every)
    assert len({*learnt.device_accuracy.tolist()}) == 3
    # The UAV's model carries the average of those that it heard.
    p = community.p[[0, 2]] / community.p[[0, 2]].sum()
    assert after.communities[0].model[-129:] == pytest.approx(p @ kept[[0, 2]], rel=1e-4)
    again, _ = play(federation, after, 0, 1)
    assert (again.communities[0].buffers[2] == kept[2]).all()
    # It went on from its own: batches counted twice, those of the others not at all.
    assert again.communities[0].buffers[0][-1] == 2 * kept[0][-1]


@pytest.mark.parametrize("more", [{}, {"buffers": "local"}])
def test_a_correction_is_of_the_parameters_alone(more: dict[str, str]) -> None:
    federation = build("scaffold", **more)
    state, _ = play(federation, fed.init(federation), 0, 2)
    state, _ = play(federation, state, 0, 1)
    assert state.communities[0].algorithm["device_controls"].shape == (3, 778)
    assert state.communities[0].algorithm["device_controls"].any(axis=1).all()

    class Wrong:
        """Corrects as many as the model has numbers, buffers among them."""

        mu, momentum = 0.0, 0.9

        def init(self, model, devices):  # noqa: ARG002
            return {}

        def correction(self, state, device):  # noqa: ARG002
            return np.zeros(778 + 129, dtype=np.float32)

        def apply(self, state, model, updates):  # noqa: ARG002
            return model, state

    federation = build(str(register(lambda _: Wrong())), **more)
    with pytest.raises(UsersCodeError, match=r"device 0 is of shape \(907,\), not \(778,\)"):
        play(federation, fed.init(federation), 0)


@pytest.mark.parametrize("more", [{}, {"buffers": "local"}])
def test_a_checkpoint_holds_them(more: dict[str, str]) -> None:
    federation = build(**more)
    state, _ = play(federation, fed.init(federation), 1)
    back = from_bytes(federation, to_bytes(federation, state))
    assert back.communities[0].buffers.tolist() == state.communities[0].buffers.tolist()
    one, _ = play(federation, state, 0, 1)
    two, _ = play(federation, back, 0, 1)
    assert one.communities[0].model.tobytes() == two.communities[0].model.tobytes()
    assert to_bytes(federation, one) == to_bytes(federation, two)
