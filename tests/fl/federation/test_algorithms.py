"""Server rules against steps computed by hand, and SCAFFOLD's own invariants."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fl.config import LearningConfig
from fl.federation.algorithms import (
    CustomStaleAlgorithm,
    FedAdam,
    FedAvg,
    FedAvgM,
    Scaffold,
    Update,
    make_algorithm,
)
from native.errors import UsersCodeError

MODEL = np.array([1.0, -2.0], dtype=np.float32)
UPDATES = (
    Update(device=0, p=0.1, model=np.array([2.0, -2.0], np.float32), steps=4, start=MODEL),
    Update(device=2, p=0.3, model=np.array([1.0, 2.0], np.float32), steps=2, start=MODEL),
)
STEP = np.array([0.25, 3.0])  # (.1 (1, 0) + .3 (0, 4)) / .4


def test_average_is_weighted_over_the_arrivals_alone() -> None:
    model, state = FedAvg(momentum=0.9).apply({}, MODEL, UPDATES)
    np.testing.assert_allclose(model, MODEL + STEP, rtol=1e-6)
    assert state == {}


def test_fedavgm_by_hand() -> None:
    algorithm = FedAvgM(momentum=0.9, server_learning_rate=0.5, server_momentum=0.8)
    first, state = algorithm.apply(algorithm.init(MODEL, 3), MODEL, UPDATES)
    np.testing.assert_allclose(first, MODEL + 0.5 * STEP, rtol=1e-6)
    still = (
        Update(device=1, p=0.2, model=first, steps=1, start=first),
    )  # its step is zero: momentum only
    second, _ = algorithm.apply(state, first, still)
    np.testing.assert_allclose(second, first + 0.5 * 0.8 * STEP, rtol=1e-6)


def test_fedadam_by_hand() -> None:
    algorithm = FedAdam(momentum=0.9, server_learning_rate=0.1, beta1=0.9, beta2=0.99, tau=0.01)
    first, state = algorithm.apply(algorithm.init(MODEL, 3), MODEL, UPDATES)
    m, v = 0.1 * STEP, 0.99 * 0.01**2 + 0.01 * STEP**2
    np.testing.assert_allclose(first, MODEL + 0.1 * m / (np.sqrt(v) + 0.01), rtol=1e-6)
    again = tuple(Update(u.device, u.p, first + (u.model - MODEL), u.steps, first) for u in UPDATES)
    second, _ = algorithm.apply(state, first, again)
    m, v = 0.9 * m + 0.1 * STEP, 0.99 * v + 0.01 * STEP**2
    np.testing.assert_allclose(second, first + 0.1 * m / (np.sqrt(v) + 0.01), rtol=1e-5)


def test_scaffold_by_hand() -> None:
    algorithm = Scaffold(learning_rate=0.5, server_learning_rate=1.0)
    state = algorithm.init(MODEL, 3)
    assert algorithm.correction(state, 1) == pytest.approx(0.0)
    model, state = algorithm.apply(state, MODEL, UPDATES)
    np.testing.assert_allclose(model, MODEL + STEP, rtol=1e-6)
    # c_k = (theta - theta_k) / (steps eta): (-1, 0) / 2 and (0, -4) / 1
    controls = [[-0.5, 0.0], [0.0, 0.0], [0.0, -4.0]]
    np.testing.assert_allclose(state["device_controls"], controls, rtol=1e-6)
    control = np.array([0.1 * -0.5, 0.3 * -4.0])
    np.testing.assert_allclose(state["control"], control, rtol=1e-6)
    correction = algorithm.correction(state, 2)
    assert correction is not None
    np.testing.assert_allclose(correction, control - np.array([0.0, -4.0]), rtol=1e-6)


def test_scaffold_goes_on_from_what_it_has_learnt_of_the_devices() -> None:
    """c_k' = c_k - c + (theta - theta_k) / (steps eta); of a stale update the mean gradient, which
    is what its steps were less the correction that it added to them."""
    algorithm = Scaffold(learning_rate=0.5, server_learning_rate=1.0)
    model, state = algorithm.apply(algorithm.init(MODEL, 3), MODEL, UPDATES)
    moved = model + np.array([1.0, 0.0], np.float32)
    added = np.array([0.25, 0.5], np.float32)
    # It went by (1, 0) in one step of 0.5, from c = (-0.05, -1.2) and c_2 = (0, -4).
    for staleness, correction, own in (
        (0, None, [-1.95, -2.8]), (0, added, [-1.95, -2.8]), (1, added, [-2.25, -0.5]),
        (1, None, [-1.95, -2.8]),
    ):  # fmt: skip
        sent = Update(2, 0.3, moved, 1, model, staleness=staleness, correction=correction)
        after, found = algorithm.apply(state, model, [sent])
        np.testing.assert_allclose(after, moved, rtol=1e-6)
        np.testing.assert_allclose(
            found["device_controls"], np.array([[-0.5, 0.0], [0.0, 0.0], own]), rtol=1e-5
        )
        control = np.array([-0.05, -1.2]) + 0.3 * (np.array(own) - [0.0, -4.0])
        np.testing.assert_allclose(found["control"], control, rtol=1e-5)


def test_scaffold_control_stays_the_weighted_mean_of_the_devices() -> None:
    algorithm = Scaffold(learning_rate=0.1, server_learning_rate=0.7)
    rng = np.random.Generator(np.random.PCG64(3))
    p = np.array([0.2, 0.5, 0.3])
    model = rng.standard_normal(20).astype(np.float32)
    state = algorithm.init(model, 3)
    for arrived in ((0, 1), (2,), (0, 1, 2), (1,)):
        updates = [
            Update(
                k, float(p[k]), model + 0.1 * rng.standard_normal(20).astype(np.float32), 5, model
            )
            for k in arrived
        ]
        model, state = algorithm.apply(state, model, updates)
        np.testing.assert_allclose(
            state["control"], p @ state["device_controls"].astype(float), atol=1e-5
        )


def test_states_of_a_round_are_not_changed_by_the_next() -> None:
    for name in ("fedavgm", "fedadam", "scaffold"):
        algorithm = make_algorithm(LearningConfig.model_validate({"algorithm": name}))
        state = algorithm.init(MODEL, 3)
        kept = {key: value.copy() for key, value in state.items()}
        algorithm.apply(state, MODEL, UPDATES)
        for key, value in state.items():
            np.testing.assert_array_equal(value, kept[key])


def test_settings_choose_the_algorithm() -> None:
    prox = make_algorithm(LearningConfig(mu=0.3, momentum=0.5))
    assert (prox.mu, prox.momentum) == (0.3, 0.5)
    for name in ("fedavg", "fedavgm", "fedadam", "scaffold"):
        settings = LearningConfig.model_validate({"algorithm": name, "mu": 0.3})
        assert make_algorithm(settings).mu == 0.0
    scaffold = make_algorithm(LearningConfig(algorithm="scaffold"))
    assert scaffold.momentum == 0.0


@pytest.mark.parametrize(
    ("what", "value", "why"),
    [
        ("mu", 100.0, None), ("mu", 0.0, None), ("mu", -0.1, "mu is -0.1: must be from 0 to 100"),
        ("mu", 100.1, "mu is 100.1: must be"), ("momentum", 0.999, None), ("momentum", 0.0, None),
        ("momentum", 1.0, "momentum is 1.0: must be below 1"),
        ("momentum", -0.1, "momentum is -0.1: must be from 0 to 1"),
        ("init", {"a": [1, 2]}, None), ("init", [1], r"init\(\) gives a list as its state"),
        ("init", {"a": np.nan}, r"'a' in the state of init\(\) is nan: must be finite"),
        ("correction", None, None), ("correction", [0.5, 1.0], None),
        ("correction", [np.inf, 0.0], "what correction.. of device 1 gives holds inf at .0.: must"),
        ("apply", (MODEL + 1, {}), None), ("apply", [MODEL, {}], r"apply\(\) gives a list, not a "),
        ("apply", (MODEL, {}, 1), r"apply\(\) gives 3 things, not the two of model and state"),
        ("apply", (MODEL,), "gives 1 things"), ("apply", (MODEL[:1], {}), "the model that apply"),
        ("apply", (MODEL, 5), r"apply\(\) gives an int as its state"),
        ("start", MODEL + 2, None), ("start", MODEL[:1], r"start\(\) of device 1 gives is of sh"),
    ],
)  # fmt: skip
def test_answers_of_an_algorithm_of_ones_own_are_checked(what: str, value: Any, why: Any) -> None:
    own = SimpleNamespace(
        **{name: lambda *_: value for name in ("init", "correction", "apply", "start")},
        mu=value, momentum=value,
    )  # fmt: skip
    plugin = CustomStaleAlgorithm("own:algorithm", own)
    asked = {
        "mu": lambda: plugin.mu, "momentum": lambda: plugin.momentum,
        "init": lambda: plugin.init(MODEL, 3), "correction": lambda: plugin.correction({}, 1),
        "apply": lambda: plugin.apply({}, MODEL, UPDATES),
        "start": lambda: plugin.start({}, MODEL, 1),
    }[what]  # fmt: skip
    if why is not None:
        with pytest.raises(
            UsersCodeError, match=rf"learning\.algorithm = 'own:algorithm': .*{why}"
        ):
            asked()
        return
    found: Any = asked()
    if what == "apply":
        np.testing.assert_array_equal(found[0], value[0])
    elif what == "init":
        assert {key: of.tolist() for key, of in found.items()} == value
    elif value is None:
        assert found is None
    else:
        np.testing.assert_array_equal(found, value)
