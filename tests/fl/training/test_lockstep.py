"""Devices that train together become what they do alone: in lockstep, whoever is beside them."""

import gc
import logging
import weakref
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from devices import DEVICES
from own_modules import Dense, Drops, Grouped, HostsTable, Looks, Mixes, Noisy
from torch import nn

from fl.arrays import Vector
from fl.config import CommunityConfig, LearningConfig
from fl.data.dataset import Split
from fl.federation import rounds as fed
from fl.training.convnet import ConvNet
from fl.training.local import LocalResult, LocalSettings, LocalTask, LocalWork, Network, scaling_of
from fl.training.models import make_network
from fl.training.modules.builtin import BuiltInNetwork, PlainNet
from fl.training.modules.lockstep import Step
from fl.training.modules.network import ModuleNetwork
from flightdyn.random import RandomStreams

SHAPE = (16, 16, 3)
SETTINGS = LocalSettings(learning_rate=0.01, momentum=0.9, mu=0.1, batch_size=16, epochs=2)
ONE_EPOCH = replace(SETTINGS, epochs=1)
# float32 sums in another order, over tens of steps
TOLERANCE: dict[str, Any] = {"rtol": 1e-4, "atol": 1e-6}
# Whole batches, one not whole, less than one; a device that trains long after the others.
SHARES = (np.arange(0, 64), np.arange(64, 97), np.arange(97, 102), np.arange(102, 300))


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def convnet() -> ConvNet:
    net = make_network("lenet", image_shape=SHAPE, classes=10)
    assert isinstance(net, ConvNet)
    return net


def module_network(
    factory: type[nn.Module], *, device: str = "cpu", devices: int = 4, lockstep: bool
) -> ModuleNetwork:
    return ModuleNetwork(
        factory, name=factory.__name__, image_shape=SHAPE, classes=10,
        device=device, devices=devices, lockstep=lockstep,
    )  # fmt: skip


def built_in(*, device: str = "cpu", devices: int = 4, lockstep: bool) -> ModuleNetwork:
    return BuiltInNetwork(
        convnet(), name="lenet", device=device, devices=devices, lockstep=lockstep
    )


@pytest.fixture(scope="module")
def split() -> Split:
    return Split(
        rng(2).integers(0, 256, (300, *SHAPE)).astype(np.uint8), rng(1).integers(0, 10, 300)
    )


def train(
    network: Network,
    split: Split,
    devices: Sequence[int],
    *,
    settings: LocalSettings = SETTINGS,
    corrections: dict[int, Vector] | None = None,
) -> list[LocalResult]:
    tasks = [LocalTask(SHARES[k], rng(50 + k), (corrections or {}).get(k)) for k in devices]
    model = network.initial(rng(3))
    return network.train(LocalWork(split, model, tasks, scaling_of(split), settings))


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("slots", [1, 3, 4, 7])
@pytest.mark.parametrize("factory", [None, Grouped])
def test_in_lockstep_devices_become_what_they_do_alone(
    split: Split, factory: type[nn.Module] | None, slots: int, device: str
) -> None:
    def network(lockstep: bool) -> ModuleNetwork:
        if factory is None:
            return built_in(device=device, devices=slots, lockstep=lockstep)
        return module_network(factory, device=device, devices=slots, lockstep=lockstep)

    alone, together = network(lockstep=False), network(lockstep=True)
    assert (alone.lockstep, together.lockstep) == (False, True)
    # One device with a control variate, the others without.
    corrections = {1: 0.01 * rng(4).standard_normal(alone.initial(rng(3)).size).astype(np.float32)}
    pairs = zip(
        train(alone, split, range(4), corrections=corrections),
        train(together, split, range(4), corrections=corrections),
        strict=True,
    )
    for (one, other), steps in zip(pairs, (8, 6, 2, 26), strict=True):
        assert one.steps == other.steps == steps
        assert other.loss == pytest.approx(one.loss, rel=1e-5)
        assert np.abs(one.model - alone.initial(rng(3))).max() > 1e-3
        np.testing.assert_allclose(other.model, one.model, **TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
def test_who_trains_beside_a_device_does_not_matter(split: Split, device: str) -> None:
    network = built_in(device=device, lockstep=True)
    everybody = train(network, split, range(4), settings=ONE_EPOCH)
    for some in ([0], [3], [2, 1], [3, 0, 2]):
        for k, result in zip(some, train(network, split, some, settings=ONE_EPOCH), strict=True):
            if device == "cpu":
                assert (result.loss, result.steps) == (everybody[k].loss, everybody[k].steps)
                np.testing.assert_array_equal(result.model, everybody[k].model)
            else:
                np.testing.assert_allclose(result.model, everybody[k].model, **TOLERANCE)


@pytest.mark.slow
def test_a_device_that_diverges_takes_no_other_with_it(split: Split) -> None:
    network = built_in(lockstep=True)
    infinite = np.full_like(network.initial(rng(3)), np.inf)
    well = train(network, split, range(4))
    ill = train(network, split, range(4), corrections={2: infinite})
    assert not np.isfinite(ill[2].model).any()
    for k in (0, 1, 3):
        assert ill[k].loss == well[k].loss
        np.testing.assert_array_equal(ill[k].model, well[k].model)


@pytest.mark.slow
def test_other_settings_images_and_batches_find_no_stale_step(split: Split) -> None:
    used = built_in(lockstep=True)
    other = Split(255 - split.images, split.labels.copy())
    for change in ({}, {"momentum": 0.5}, {"batch_size": 8}):
        # The first has less than a batch, and the step no more room.
        for images, devices in ((split, [2]), (split, [0]), (other, [0]), (split, [0])):
            settings = replace(ONE_EPOCH, **change)
            results = train(used, images, devices, settings=settings)
            fresh = train(built_in(lockstep=True), images, devices, settings=settings)
            for one, two in zip(results, fresh, strict=True):
                np.testing.assert_array_equal(one.model, two.model)


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
def test_the_built_in_networks_start_and_train_alike_in_torch(split: Split, device: str) -> None:
    native, torchs = convnet(), built_in(device=device, lockstep=True)
    assert torchs.shapes == native.shapes
    np.testing.assert_array_equal(torchs.initial(rng(3)), native.initial(rng(3)))
    pairs = zip(train(native, split, range(4)), train(torchs, split, range(4)), strict=True)
    for one, other in pairs:
        assert other.loss == pytest.approx(one.loss, rel=1e-5)
        np.testing.assert_allclose(other.model, one.model, rtol=1e-3, atol=1e-5)
    counts = [
        n.correct_per_class(split, one.model, scaling=scaling_of(split)) for n in (native, torchs)
    ]
    np.testing.assert_array_equal(counts[0], counts[1])


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    ("factory", "reason"),
    [
        (Drops, "random"),
        (Noisy, "random"),
        (Looks, "item()"),
        (Mixes, "samples that fill up a batch"),
    ],
)
def test_a_module_that_cannot_trains_one_by_one_and_it_is_said_once(
    split: Split,
    caplog: pytest.LogCaptureFixture,
    factory: type[nn.Module],
    reason: str,
    device: str,
) -> None:
    with caplog.at_level(logging.WARNING):
        network = module_network(factory, device=device, lockstep=True)
        results = train(network, split, [0, 1])
    (record,) = caplog.records
    assert f"network {factory.__name__}: devices train one by one: " in record.getMessage()
    assert reason in record.getMessage()
    alone = train(module_network(factory, device=device, lockstep=False), split, [0, 1])
    for one, other in zip(results, alone, strict=True):
        np.testing.assert_array_equal(one.model, other.model)


def test_on_the_processor_devices_train_one_by_one() -> None:
    network = ModuleNetwork(Dense, name="Dense", image_shape=SHAPE, classes=10, devices=4)
    assert not network.lockstep


def test_a_step_looks_at_no_value_and_needs_nothing_of_the_host(split: Split) -> None:
    """What a CUDA graph asks of it; torch's "meta" device has shapes only, and refuses both."""

    def step(module: nn.Module) -> None:
        meta = torch.device("meta")
        Step(module.to(meta), split, scaling_of(split), SETTINGS, (4, 16), meta)._eagerly()

    step(PlainNet(convnet()))
    step(Grouped())
    with pytest.raises(RuntimeError, match="not on the expected device meta"):
        step(HostsTable())


def test_a_step_that_nobody_needs_gives_its_memory_back_at_once(split: Split) -> None:
    step = Step(Dense(), split, scaling_of(split), SETTINGS, (1, 4), torch.device("cpu"))
    model = np.zeros(7690, np.float32)
    step.train(model, [LocalTask(np.arange(4), rng(1))], [np.arange(4).reshape(1, 4)])
    gone = weakref.ref(step)
    gc.disable()
    try:
        del step
        assert gone() is None
    finally:
        gc.enable()


@pytest.mark.parametrize("algorithm", ["fedprox", "scaffold"])
def test_rounds_in_lockstep_are_those_of_the_native_network(
    monkeypatch: pytest.MonkeyPatch, algorithm: str
) -> None:
    community = CommunityConfig(name="digits", task="digits", devices=4, labels_per_device=3)
    learning = LearningConfig.model_validate({"algorithm": algorithm, "batch_size": 64})

    def build() -> fed.Federation:
        stream = RandomStreams(1).generator
        return fed.build([community], learning, data_dir=None, stream=stream)

    def play(federation: fed.Federation, *rounds: Sequence[int]) -> fed.FederationState:
        state = fed.init(federation)
        for arrived in rounds:
            delivered = np.isin(np.arange(4), arrived)
            who = fed.Participation(np.ones(4, bool), delivered)
            state, _ = fed.play_round(federation, state, who, workers=2)
        return state

    def in_torch(name: str, *, device: str, **sizes: Any) -> Network:
        net = make_network(name, **sizes)
        assert isinstance(net, ConvNet)
        return BuiltInNetwork(net, name=name, device=device, devices=4, lockstep=True)

    rounds: tuple[list[int], ...] = ([0, 2], [], [1, 2, 3])
    native = play(build(), *rounds)
    monkeypatch.setattr("fl.federation.community.make_network", in_torch)
    torchs = build()
    together = play(torchs, *rounds)
    np.testing.assert_allclose(together.models[0], native.models[0], rtol=1e-3, atol=1e-5)
    np.testing.assert_array_equal(together.missed, native.missed)
    np.testing.assert_array_equal(together.models[0], play(torchs, *rounds).models[0])


@pytest.mark.real
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("name", ["lenet", "mcmahan"])
def test_on_a_gpu_the_built_in_networks_train_in_lockstep(split: Split, name: str) -> None:
    def network(device: str) -> Network:
        return make_network(name, image_shape=SHAPE, classes=10, device=device, devices=4)

    native, gpu = network("cpu"), network("cuda")
    assert isinstance(gpu, ModuleNetwork)
    assert gpu.lockstep
    first, again = train(gpu, split, range(4)), train(gpu, split, range(4))
    for one, other, third in zip(train(native, split, range(4)), first, again, strict=True):
        np.testing.assert_allclose(other.model, one.model, rtol=2e-3, atol=2e-4)
        np.testing.assert_array_equal(other.model, third.model)
