"""Code of one's own is loaded as it stands in its files, and its digest tells it from other."""

import functools
import hashlib
import importlib
import json
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fl import plugin_code
from fl.arrays import frozen
from fl.plugin_code import bring, checked_name, digest_of, label_of, load, passed, register
from fl.plugins import read_only


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A folder of one's own modules, in which the session works."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        sys.modules.pop(name)


def write(**texts: str) -> None:
    for name, text in texts.items():
        path = Path(f"{name}.py")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)


def made(name: str) -> Any:
    make: Any = load(name)
    return make()


def test_an_edit_of_the_same_second_and_size_counts() -> None:
    for number in (1, 2, 3):
        write(edited_a=f"def make(): return {number}")
        assert made("edited_a:make") == number


def test_what_the_session_has_imported_itself_is_loaded_as_it_is_now() -> None:
    write(edited_b="def make(): return 1")
    sys.path.append(str(Path.cwd()))
    assert importlib.import_module("edited_b").make() == 1
    write(edited_b="def make(): return 2")
    assert made("edited_b:make") == 2


def test_a_function_that_is_wrapped_here_is_not_taken_for_the_one_of_its_module() -> None:
    write(
        edited_w="import functools\n"
        "def one(): return 1\n"
        "@functools.wraps(one)\n"
        "def make(): return one()\n"
        "make.__name__ = make.__qualname__ = 'make'\n"
    )
    inner: Any = load("edited_w:make")

    @functools.wraps(inner)
    def traced() -> int:
        return 2

    assert register(inner) == "edited_w:make"
    assert load(str(register(traced))) is traced


@pytest.mark.parametrize(
    "how",
    [
        "from edited_helper import value",
        "import edited_helper; value = edited_helper.value",
        "def value():\n    from edited_helper import value\n    return value()",
        "from edited_between import value",
    ],
)
def test_what_it_imports_from_beside_it_is_its_code(how: str) -> None:
    write(
        edited_c=f"{how}\ndef make(): return value()",
        edited_between="from edited_helper import value",
        edited_helper="def value(): return 1",
        edited_other="",
    )
    first = digest_of("edited_c:make")
    assert made("edited_c:make") == 1
    write(edited_other="# nobody imports it")
    assert digest_of("edited_c:make") == first
    write(edited_helper="def value(): return 2")
    assert digest_of("edited_c:make") != first
    assert made("edited_c:make") == 2
    write(edited_helper="def value(): return 1")
    assert digest_of("edited_c:make") == first


@pytest.mark.parametrize(
    "how", ["from .helper import value", "from . import helper", "import edited_p.helper"]
)
def test_of_a_package_it_is_what_it_imports_and_the_package_itself(how: str) -> None:
    inside = {"edited_p/__init__": "", "edited_p/mine": how, "edited_p/helper": "value = 1"}
    write(**inside, **{"edited_p/other": ""})
    digests = {digest_of("edited_p.mine:value")}
    for name, text in inside.items():
        write(**{name: f"{text}\nvalue = 3"})
        digests.add(digest_of("edited_p.mine:value"))
    assert len(digests) == 4
    write(**{"edited_p/other": "value = 3"})
    assert digest_of("edited_p.mine:value") in digests


def test_two_modules_share_what_both_import_before_and_after_an_edit() -> None:
    for number in (1, 2):
        write(
            edited_d="import edited_shared\ndef make(): return edited_shared.state",
            edited_e="import edited_shared\ndef make(): return edited_shared.state",
            edited_shared=f"state = [{number}]",
        )
        assert made("edited_d:make") == [number]
        assert made("edited_d:make") is made("edited_e:make")


def test_a_label_is_no_part_of_what_a_plug_in_is() -> None:
    label = "mine=json:dumps"
    assert (load(label), digest_of(label)) == (json.dumps, digest_of("json:dumps"))
    assert checked_name(label, ()) == label
    assert [label_of(name) for name in (label, "json:dumps", "cov")] == [
        "mine",
        "json:dumps",
        "cov",
    ]
    with pytest.raises(ValueError, match="import path"):
        checked_name("a/b=json:dumps", ())


def test_code_of_a_library_is_that_of_its_package() -> None:
    assert digest_of("json:loads") == digest_of("json:dumps") != digest_of("ast:parse")
    assert digest_of("math:sqrt") == digest_of("math:cos")
    write(math="")  # is not what Python imports by that name
    for name, told in {
        "math:sqrt": f"math {sys.version}",
        "numpy.linalg:norm": f"numpy numpy {np.__version__}",
        "edited_nowhere:make": f"edited_nowhere {sys.version}",
    }.items():
        assert digest_of(name) == hashlib.sha256(told.encode()).hexdigest()


def test_modules_that_import_each_other_and_one_that_is_named_as_ours() -> None:
    write(edited_f="import edited_g, native", edited_g="import edited_f", native="one = 1")
    first = digest_of("edited_f:make")
    write(native="one = 2")
    assert digest_of("edited_f:make") == first
    write(edited_g="import edited_f, json")
    assert digest_of("edited_f:make") != first


def test_a_module_that_has_just_been_written_is_found() -> None:
    """Python lists a folder anew where its time has changed."""
    write(edited_h="def make(): return 1")
    then = Path().stat()
    assert made("edited_h:make") == 1
    write(edited_i="def make(): return 2")
    os.utime(".", ns=(then.st_atime_ns, then.st_mtime_ns))
    assert made("edited_i:make") == 2


def test_an_object_that_is_passed_has_a_name_and_a_digest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugin_code, "_passed", {})

    def giving(what: Any) -> Any:
        return lambda: what

    names = [register(giving(what)) for what in (1, 1, 2, threading.Lock())]
    one, same, two, bare = map(str, names)
    assert one == same != two
    digest = digest_of(f"label={one}")
    assert digest is not None
    assert one == f"python:lambda_{digest[:8]}"
    assert len(digest) == 64
    assert (bare, digest_of(bare)) == ("python:lambda_2", None)  # the third that is passed
    assert register(5) == 5
    given = passed([f"label={two}", "json:dumps", "python:gone_1"])
    assert given.keys() == {two}
    plugin_code._passed.clear()
    assert digest_of(two) is None
    with pytest.raises(ImportError, match="pass it again"):
        load(two)
    bring(given)
    assert made(f"other={two}") == 2


def test_which_functions_are_named_by_where_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    write(edited_j="def make(): return 1", edited_k="def make(): return 1")
    before = load("edited_j:make")
    write(edited_j="def make(): return 2")
    load("edited_j:make")
    assert register(before) == "edited_j:make"  # imported anew for who asks by name
    sys.path.append(str(Path.cwd()))
    ours = importlib.import_module("edited_k")
    first = ours.make
    assert register(first) == "edited_k:make"
    importlib.reload(ours)
    assert str(register(first)).startswith("python:make_")  # only a session did that

    def mine() -> int:
        return 1

    mine.__module__, mine.__qualname__ = "__main__", "mine"
    monkeypatch.setattr(sys.modules["__main__"], "mine", mine, raising=False)
    assert str(register(mine)).startswith("python:mine_")  # of no file that another process has


def test_a_session_that_moves_on_has_the_code_of_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(edited_c="def make(): return 'here'")
    first = digest_of("edited_c:make")
    assert made("edited_c:make") == "here"
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    write(edited_c="def make(): return 'there'")
    assert made("edited_c:make") == "there"
    assert digest_of("edited_c:make") != first
    monkeypatch.chdir(tmp_path)
    assert made("edited_c:make") == "here"
    assert digest_of("edited_c:make") == first


def test_who_writes_whatever_the_flags_say_writes_to_a_copy() -> None:
    """torch.from_numpy() does, and so does who sets the flag of a view."""
    ours = np.zeros(5)
    theirs = read_only((ours, frozen(ours.view())))
    for given in theirs:
        assert not given.flags.writeable
        given.setflags(write=True)
        given += 1.0
    assert not ours.any()
