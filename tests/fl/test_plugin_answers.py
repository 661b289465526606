"""What plug-ins answer, and what they are given: bounds, shapes, words of errors, copies."""

import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import fl.plugins
from fl.arrays import frozen
from fl.plugin_code import check_found, is_import_path, is_plugin
from fl.plugins import PlugIn, failures_as, needs_torch, problem_of, read_only
from native.errors import AerofedError, InputError, UsersCodeError


class Own(PlugIn):
    setting: ClassVar[str] = "communities.own"
    members: ClassVar[tuple[str, ...]] = ("first", "second")


OWN = Own("mine:make", SimpleNamespace(two=lambda *given: given, three=3))


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        sys.modules.pop(name)


def refused(call: Any, *given: Any, **more: Any) -> str:
    """What the error says behind the name of setting and plug-in."""
    with pytest.raises(UsersCodeError) as caught:
        call(*given, **more)
    head, _, words = str(caught.value).partition(": ")
    assert head == "communities.own = 'mine:make'"
    return words


def test_the_key_of_a_community_s_plug_in() -> None:
    assert OWN.key == "communities.own"
    assert [Own("m:f", None, whose).key for whose in (0, 2)] == [
        "communities.0.own",
        "communities.2.own",
    ]
    assert Own("m:f", 1, 1) == Own("m:f", 1, 2) != Own("m:g", 1, 1)
    assert repr(Own("m:f", 1, 1)) == "Own(name='m:f')"


@pytest.mark.parametrize(
    ("found", "more", "words"),
    [
        ([0.0, 1.0], {"low": 0.0, "high": 1.0}, None),
        ([0.0, -1e300], {}, None),
        ([0.5, 1.0], {"shape": (2,)}, None),
        (7, {"shape": ()}, None),
        (-0.001, {"low": 0.0}, "x is -0.001: must be finite and 0 or more"),
        ([[0.5, 1.001]], {"low": 0.0, "high": 1.0}, "x holds 1.001 at [0, 1]: must be from 0 to 1"),
        ([5.0, 6.0, 7.0], {"high": 5.5}, "x holds 6.0 at [1]: must be from -inf to 5.5"),
        ([1.0, np.inf], {}, "x holds inf at [1]: must be finite"),
        ([1.0, -np.inf], {}, "x holds -inf at [1]: must be finite"),
        (np.nan, {"low": 0.0}, "x is nan: must be finite and 0 or more"),
        ([1.0, 2.0], {"shape": (1, 2)}, "x is of shape (2,), not (1, 2)"),
        ([1.0], {"shape": ()}, "x is of shape (1,), not ()"),
        ([1j], {}, "x is complex: must be real numbers"),
        ("many", {}, "x: ValueError: could not convert string to float"),
    ],
)
def test_numbers_of_a_plug_in(found: Any, more: dict[str, Any], words: str | None) -> None:
    if words is None:
        made = OWN.array(found, "x", **more)
        assert made.tolist() == found
        assert made.dtype == np.float64
        assert not made.flags.writeable
    else:
        assert refused(OWN.array, found, "x", **more).startswith(words)


def test_numbers_of_a_plug_in_are_a_copy_of_its_own_kind() -> None:
    theirs = np.array([1.0, 2.0])
    made = OWN.array(theirs, "x", dtype=np.int64)
    theirs[0] = 9.0
    assert made.tolist() == [1, 2]
    assert made.dtype == np.int64


def test_kinds_members_and_what_is_asked() -> None:
    assert OWN.of_kind(3, int, "x") == 3
    assert refused(OWN.of_kind, 3.0, int, "x") == "x gives a float, not a int"
    theirs = np.zeros(2)
    (given,) = OWN.ask("two", theirs)
    assert not given.flags.writeable
    assert theirs.flags.writeable
    assert OWN.value("three") == 3
    assert refused(OWN.ask, "four", of=" of round 2").startswith("four() of round 2: ")
    assert refused(OWN.value, "four").startswith("four: ")


MINE = """from other import broken
from types import SimpleNamespace
three = 3
def make(*given): return SimpleNamespace(first=1, second=given)
def half(): return SimpleNamespace(second=1)
def fails(): raise KeyError("why")
def asks(): return broken()
"""


def test_what_is_found_and_what_is_made() -> None:
    Path("mine.py").write_text(MINE)
    Path("other.py").write_text("def broken():\n    return 1 / 0\n")
    assert Own.found("mine:make", 4).community == 4
    assert Own.found("mine:make").inner().first == 1
    made = Own.made("mine:make", [np.zeros(1)])
    assert (made.name, made.inner.first) == ("mine:make", 1)
    assert not made.inner.second[0][0].flags.writeable
    for name, words in {
        "mine:three": "is an int, not callable",
        "mine:half": "gives a SimpleNamespace without first; needed: first, second",
        "mine:fails": f"calling it fails: KeyError: 'why' ({Path('mine.py').resolve()}, line 6)",
        # Its own line, not the one of the module that it calls.
        "mine:asks": "calling it fails: ZeroDivisionError: division by zero"
        f" ({Path('mine.py').resolve()}, line 7)",
        "mine:mak": "cannot be imported: AttributeError: module 'mine' has no attribute 'mak'"
        "; did you mean make?",
    }.items():
        with pytest.raises(UsersCodeError) as caught:
            Own.made(name)
        assert str(caught.value) == f"communities.own = {name!r}: {words}"


def test_a_place_of_an_error_in_code_of_others() -> None:
    """Of a function whose module is gone: the last line of what is not the one who asked."""
    code: dict[str, Any] = {"__name__": "theirs.deep"}
    text = "def outer(): return inner()\ndef inner():\n    raise ValueError('no')\n"
    exec(compile(text, "theirs.py", "exec"), code)
    words = refused(Own("mine:make", SimpleNamespace(go=code["outer"])).ask, "go")
    assert words == "go(): ValueError: no (theirs.py, line 3)"
    assert refused(OWN.ask, "four").count("(") == 1  # four(), and no place


def test_which_failures_are_told() -> None:
    def told(raised: BaseException, **but: Any) -> type[BaseException]:
        try:
            with failures_as(lambda error: ValueError(repr(error)), **but):
                raise raised
        except BaseException as error:
            return type(error)

    assert told(SystemExit(1)) is told(KeyError("a")) is ValueError
    assert told(KeyboardInterrupt()) is KeyboardInterrupt
    assert told(KeyboardInterrupt(), but=AerofedError) is KeyboardInterrupt
    assert told(InputError("a"), but=AerofedError) is InputError


def test_why_a_plug_in_is_not_found() -> None:
    Path("box").mkdir()
    Path("box/__init__.py").write_text("")
    Path("box/mine.py").write_text("raise SystemExit('never imported')")
    assert problem_of("box.mine:make") is None
    said = "cannot be imported: ModuleNotFoundError: No module named 'box.other'; looked for in"
    assert str(problem_of("box.other:make")).startswith(said)
    Path("box/__init__.py").write_text("raise SystemExit('stop')")
    sys.modules.pop("box")
    assert problem_of("box.mine:make") == "cannot be imported: SystemExit: stop"
    gone = "it was passed from Python, in a process that has ended; pass it again"
    with pytest.raises(ImportError, match=gone):
        check_found("python:mine_12345678")
    assert [is_plugin(name) for name in ("a.b:c", "A=a:b", "a", "a:b.c")] == [
        True, True, False, False,
    ]  # fmt: skip
    assert [is_import_path(name) for name in ("a:b", "A=a:b", "a:b\n", "1:b")] == [
        True, False, False, False,
    ]  # fmt: skip


def test_a_plug_in_that_needs_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("nets.py").write_text("import torch\ndef make(): return torch\n")
    monkeypatch.setitem(sys.modules, "torch", None)
    for found, words in (
        ("needs torch", "needs torch"),
        (None, "cannot be imported: ModuleNotFoundError: import of torch halted; None in sys."),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(fl.plugins, "needs_torch", lambda found=found: found)
            with pytest.raises(UsersCodeError) as caught:
                Own.found("nets:make")
        assert str(caught.value).startswith(f"communities.own = 'nets:make': {words}")
    with monkeypatch.context() as patch:
        patch.setattr(importlib.util, "find_spec", lambda _: None)
        assert str(needs_torch()).endswith("pip install 'aerofed[torch]'")
        patch.setattr(importlib.util, "find_spec", lambda name: name)
        assert needs_torch() is None


@dataclass(frozen=True)
class Told:
    array: Any
    number: int = 3


@dataclass
class Loose:
    array: Any


def test_what_is_given_is_read_only_and_copied_where_it_must_be() -> None:
    assert read_only(["a", (1, np.ones(1))])[1][1].flags.writeable is False
    assert isinstance(read_only((np.ones(1),)), tuple)
    assert isinstance(read_only([np.ones(1)]), list)
    given = read_only({"a": {"b": np.ones(2)}})
    assert not given["a"]["b"].flags.writeable
    told = Told(np.ones(2))
    vars(told)["seen"] = [np.zeros(1)]  # as a cached property keeps it
    other = read_only(told)
    assert other is not told
    assert (other.number, other.array.tolist(), len(other.seen)) == (3, [1.0, 1.0], 1)
    assert not other.array.flags.writeable
    assert not other.seen[0].flags.writeable
    assert told.array.flags.writeable
    for same in (Told(5), Loose(np.ones(1)), Own("m:f", np.ones(1)), "word", Told):
        assert read_only(same) is same


@pytest.mark.parametrize(("more", "copied"), [(0, True), (1, False)])
def test_16_mib_are_copied_and_more_is_looked_at(more: int, copied: bool) -> None:
    ours = frozen(np.zeros(2**24 + more, np.uint8))
    assert np.shares_memory(read_only(ours), ours) is not copied


def test_a_copy_has_the_order_of_what_it_is_of() -> None:
    assert read_only(np.zeros((2, 3), order="F")).flags.f_contiguous
