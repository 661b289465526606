"""The one vocabulary of errors: what each kind keeps, whoever passes it on."""

import pickle
from pathlib import Path

import pytest

from fl.errors import DataLayoutError, DataMissingError, DivergedError, FetchError
from mission.base.errors import LimitsNotMetError
from native.errors import (
    AerofedError,
    FirmwareSilentError,
    FlightError,
    InputError,
    LinkLostError,
    SettingError,
)

EACH = [
    (SettingError("a.b", [1], "must be 2"), InputError, 2, "a.b = [1]: must be 2"),
    (DataMissingError("mnist", Path("d"), "x"), InputError, 2, "mnist: not found in d; looked for"),
    (DataLayoutError("a.npz", "no x"), InputError, 2, "a.npz: no x"),
    (DivergedError(2, "digits", 1, 3.0), AerofedError, 4, "learning diverged: round 2, community"),
    (FetchError("http://a", "no\nway"), LinkLostError, 5, "http://a: not fetched: no way"),
    (FirmwareSilentError("it died"), FlightError, 5, "it died"),
    (LimitsNotMetError("too far", ("verdict",)), AerofedError, 6, "too far"),
]


@pytest.mark.parametrize(("error", "kind", "code", "text"), EACH)
def test_an_error_is_itself_in_other_words_and_in_another_process(
    error: AerofedError, kind: type[AerofedError], code: int, text: str
) -> None:
    assert isinstance(error, kind)
    assert error.exit_code == code
    assert str(error).startswith(text)
    there = pickle.loads(pickle.dumps(error))
    longer = error.in_words(f"at noon: {error}")
    for other, words in ((there, str(error)), (longer, f"at noon: {error}")):
        assert type(other) is type(error)
        assert str(other) == words
        assert vars(other) == vars(error)
