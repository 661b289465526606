"""Colours of packet error rates and communities, by hand."""

import pytest

from mission.base.palette import community_colour, per_colour


@pytest.mark.parametrize(
    ("per", "rgb"),
    [
        (0.0, (0x0B, 0x7A, 0x75)),
        (0.25, (126.5, 157.5, 97.5)),  # half way to yellow
        (0.5, (0xF2, 0xC1, 0x4E)),
        (0.75, (221.0, 123.5, 53.5)),
        (1.0, (0xC8, 0x36, 0x1D)),
        (-0.1, (0x0B, 0x7A, 0x75)),
        (1.1, (0xC8, 0x36, 0x1D)),
    ],
)
def test_rates_run_from_teal_over_yellow_to_vermilion(
    per: float, rgb: tuple[float, float, float]
) -> None:
    assert [255.0 * part for part in per_colour(per)] == pytest.approx(rgb)


def test_the_eighth_community_has_the_first_ones_colour() -> None:
    hues = [community_colour(k) for k in range(8)]
    assert hues[:3] == ["#0072B2", "#E69F00", "#009E73"]
    assert len(set(hues)) == 7
    assert hues[7] == hues[0]
