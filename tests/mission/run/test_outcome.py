"""How a flight ended, whatever comes after it."""

from pathlib import Path

import pytest

from mission.base.errors import AerofedError, FlightError, InputError
from mission.run.outcome import Ending


def test_what_goes_wrong_first_counts() -> None:
    ending = Ending()
    with ending.flight():
        raise FlightError("lost")
    with ending.aftermath():
        raise InputError("no log to draw")
    assert ending.summary == {"status": "failed", "error": "lost"}
    with pytest.raises(AerofedError, match=r"^lost; what was flown is in out$") as caught:
        ending.raise_error(Path("out"))
    assert caught.value.exit_code == FlightError.exit_code


@pytest.mark.parametrize(
    ("end", "status"), [(None, "finished"), (KeyboardInterrupt, "interrupted")]
)
def test_a_figure_that_fails_is_a_failure(end: type[BaseException] | None, status: str) -> None:
    ending = Ending()
    with ending.flight():
        if end is not None:
            raise end
    assert ending.summary == {"status": status}
    ending.raise_error(Path("out"))
    with ending.aftermath():
        raise InputError("no room")
    assert ending.summary == {"status": "failed", "error": "no room"}


def test_a_bug_is_raised_and_a_failure() -> None:
    ending = Ending()
    with pytest.raises(ZeroDivisionError), ending.flight():
        raise ZeroDivisionError
    assert ending.summary == {"status": "failed"}
