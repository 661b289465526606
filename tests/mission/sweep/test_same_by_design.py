"""Sweeps too short to compare what they name say so."""

import pytest

from mission.config.models import RunConfig
from mission.sweep.sweep import same_by_design


def config(strategy: str, rounds: int, period: int) -> RunConfig:
    return RunConfig.model_validate(
        {
            "mission": {"strategy": strategy, "rounds": rounds},
            "learning": {"cov_period_rounds": period},
            "communities": [{"name": "a", "task": "digits", "devices": 2}],
        }
    )


@pytest.mark.parametrize(
    ("strategies", "rounds", "said"),
    [
        (("cov", "no_cov"), 2, True),
        (("cov", "no_cov"), 4, True),
        (("cov", "no_cov"), 5, False),
        (("cov", "rectangular"), 2, False),
    ],
)
def test_cov_before_its_first_update_compares_nothing(
    strategies: tuple[str, ...], rounds: int, said: bool
) -> None:
    why = same_by_design([config(strategy, rounds, 4) for strategy in strategies])
    assert why == said * (
        "cov and no_cov are the same here: the CoV is first updated after round 4 "
        f"(learning.cov_period_rounds), and the runs end after round {rounds}; ask for more "
        "--rounds"
    )
