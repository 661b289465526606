"""More draws of what others of the same test show: for the nightly job, and for who asks."""

from collections.abc import Iterable
from typing import Any

import pytest


def again(draws: Iterable[Any]) -> list[Any]:
    """Values of a parameter, each marked."""
    return [pytest.param(draw, marks=pytest.mark.again) for draw in draws]
