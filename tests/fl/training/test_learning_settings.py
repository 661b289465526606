"""Settings of radio, communities and learning: what they make, what they refuse."""

import math

import pytest
from pydantic import ValidationError

from fl.config import ChannelConfig, CommunityConfig, ConvNetConfig, LearningConfig
from fl.radio.channel import CHANNEL_PRESETS, average_per
from fl.training.networks import make_network


def test_defaults_are_the_papers() -> None:
    learning = LearningConfig()
    assert (learning.mu, learning.learning_rate, learning.momentum) == (0.1, 0.01, 0.9)
    assert (learning.batch_size, learning.local_epochs) == (16, 1)
    assert (learning.cov_period_rounds, learning.importance_boost) == (4, 1.5)
    assert ChannelConfig().channel() == CHANNEL_PRESETS["suburban"]


def test_overrides_change_the_preset_and_nothing_else() -> None:
    changes = {"preset": "urban", "sigma_los": 0.4, "extra_gain_db": 3.0}
    channel = ChannelConfig.model_validate(changes).channel(altitude_m=80.0)
    urban = CHANNEL_PRESETS["urban"]
    assert channel.sigma_los == 0.4
    assert channel.altitude_m == 80.0
    assert channel.tx_power_db == urban.tx_power_db + 3.0
    assert channel.a1_per_rad == urban.a1_per_rad


def test_a_share_of_a_test_part_that_is_not_held_out_is_refused() -> None:
    with pytest.raises(ValidationError, match="test_share belongs to report_on = 'test'"):
        LearningConfig(report_on="validation", test_share=0.3)
    # As a run writes it down, with every default.
    assert LearningConfig(report_on="validation", test_share=0.5).report_on == "validation"


def test_extra_gain_moves_between_the_named_link_budgets() -> None:
    stronger = ChannelConfig(preset="suburban+10dB", extra_gain_db=10.0).channel()
    expected = average_per(CHANNEL_PRESETS["suburban+20dB"], [100.0, 200.0, 300.0])
    assert average_per(stronger, [100.0, 200.0, 300.0]) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"preset": "moon"}, "no such channel; there are suburban, "),
        ({"preset": "Urban"}, r"high-rise; did you mean urban\?"),
        ({"sigma_los": 0.0}, "greater than 0"),
        ({"noise_db": math.nan}, "finite number"),
        ({"tx_power_dbm": 3.0}, "Extra inputs are not permitted"),
    ],
)
def test_channel_settings_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ChannelConfig.model_validate(settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"name": "a b"}, "name"),
        ({"task": "imagenet"}, "digits"),
        ({"devices": 0}, "devices"),
        ({"task": "npz"}, "task = 'npz' needs data_file"),
        ({"data_file": "x.npz"}, "data_file is for task = 'npz' only; task = 'mnist' has files"),
        ({"dirichlet_alpha": 0.0}, "dirichlet_alpha"),
        ({"convnet": {}}, "the table convnet is for network = 'convnet' only"),
        ({"network": "convnet", "convnet": {"kernel": 4}}, "convnet.kernel"),
        ({"network": "convnet", "convnet": {"channels": [8, 0]}}, "convnet.channels.1"),
        ({"network": "convnet", "convnet": {"channels": [8] * 9}}, "convnet.channels"),
    ],
)
def test_community_settings_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        CommunityConfig.model_validate({"name": "a", "task": "mnist"} | settings)


def test_a_convnet_without_a_table_has_the_defaults() -> None:
    config = CommunityConfig.model_validate({"name": "a", "task": "mnist", "network": "convnet"})
    plain, spelt_out = (
        make_network(config.network, convnet=sizes, image_shape=(12, 12, 1), classes=10)
        for sizes in (config.convnet, ConvNetConfig())
    )
    assert plain.shapes == spelt_out.shapes


def test_npz_task_names_its_file() -> None:
    config = CommunityConfig.model_validate({"name": "a", "task": "npz", "data_file": "x.npz"})
    assert config.data_file == "x.npz"


@pytest.mark.parametrize(
    "settings",
    [{"algorithm": "sgd"}, {"momentum": 1.0}, {"importance_boost": 1.0}, {"learning_rate": -1.0}],
)
def test_learning_settings_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match=next(iter(settings))):
        LearningConfig.model_validate(settings)
