"""What C declares is what Python has: by the compiler's word, and wherever the fields lie."""

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from toolchains import EXERCISE, exercised

from flightdyn.config import LimitsConfig
from flightdyn.native.library import steering
from flightdyn.native.ticks import FLIGHT
from native import building, headers
from native.errors import InputError

COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
STRUCTURE = re.compile(r"typedef struct \{(.*?)^\} (\w+);", re.DOTALL | re.MULTILINE)
# What is read as a row of numbers, in Python too; is C's alone; or has to end with its last field.
ORDERED = {
    *("Point", "Channel", "Field", "Sample", "Increment", "Piece", "State", "ImuBias", "Earth"),
    *("Part", "Strapdown"),
}


def declared(library: building.Library) -> dict[str, Any]:
    return headers.declared(library.folder / library.border)


def asserted(library: building.Library, folder: Path) -> subprocess.CompletedProcess[str]:
    """What the compiler says to sizes, places of fields and constants as Python has them, where the
    sources are those of `folder`."""
    border = folder / library.folder.relative_to(building.ROOT) / library.border
    said = [f'#include "{border}"', "#include <stddef.h>"]

    def say(what: str, value: int, name: str) -> None:
        said.append(f'_Static_assert({what} == {value}, "{name}");')

    for name, value in declared(library).items():
        if isinstance(value, int):
            say(name, value, name)
        for field, _ in getattr(value, "_fields_", ()):
            at, title = getattr(value, field), f"{name}.{field}"
            say(f"offsetof({name}, {field})", at.offset, title)
            if at.size:
                say(f"sizeof ((({name} *)0)->{field})", at.size, title)
    include = folder / building.INCLUDE.relative_to(building.ROOT)
    return subprocess.run(
        [*next(building.compilers()), "-std=gnu11", "-fsyntax-only", f"-I{include}", "-xc", "-"],
        input="\n".join(said) + "\n", capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("library", building.LIBRARIES, ids=lambda library: library.name)
def test_the_compiler_lays_structures_out_as_python_does(library):
    ended = asserted(library, building.ROOT)
    assert ended.returncode == 0, ended.stderr


def copied(folder: Path, change: Callable[[re.Match[str]], str]) -> None:
    """The packages without what was built, every structure of their headers changed."""
    for package in ("fl", "flightdyn", "mission", "native", "sitl"):
        left = shutil.ignore_patterns("*.so", "__pycache__")
        shutil.copytree(building.ROOT / package, folder / package, ignore=left)
    for header in folder.rglob("*.h"):
        header.write_text(STRUCTURE.sub(change, COMMENT.sub("", header.read_text())))


def turned(structure: re.Match[str]) -> str:
    """The fields of a structure that Python has from the last to the first."""
    if structure[2] in ORDERED or not any(
        structure[2] in declared(it) for it in building.LIBRARIES
    ):
        return structure[0]
    members = []
    for member in filter(None, map(str.strip, structure[1].split(";"))):
        kind, _, names = member.partition(" ") if "(" not in member else (member, "", "")
        if kind == "const":
            kind, names = "const " + names.split(" ", 1)[0], names.split(" ", 1)[1]
        members.append(f"{kind} {', '.join(reversed(names.split(', ')))}".strip() + ";\n")
    return f"typedef struct {{\n{''.join(reversed(members))}}} {structure[2]};"


def test_the_compiler_sees_what_python_has_not_followed(tmp_path):
    """As if Python had a copy of its own: red at the first of two fields that change places."""

    def swapped(structure: re.Match[str]) -> str:
        return structure[0].replace("climb_mps, descent_mps", "descent_mps, climb_mps")

    copied(tmp_path, swapped)
    ended = asserted(building.library("flight"), tmp_path)
    assert ended.returncode != 0
    assert set(re.findall(r'assertion failed: "(.*?)"', ended.stderr)) == {
        "Steering.climb_mps", "Steering.descent_mps"
    }  # fmt: skip


@pytest.mark.slow
def test_python_follows_wherever_the_fields_lie(tmp_path):
    """Every structure of every library is turned round, compiled, and gives the same bytes."""
    copied(tmp_path, turned)
    # Of the levels, which are compiled from the same, the plainest is there and handed out alone.
    handed_out = tmp_path / "native" / "include" / "levels.h"
    handed_out.write_text(
        re.sub(r"(, )&name##_avx\w+", r"\1&name##_baseline", handed_out.read_text())
    )
    exercise = shutil.copy(EXERCISE, tmp_path)
    said = (
        "from native import building; building.levels = lambda: {'baseline': ('-O0',)}; "
        "from flightdyn.native.ticks import FLIGHT; import runpy; "
        "print(*(name for name, _ in FLIGHT.Steering._fields_), flush=True); "
        f"runpy.run_path({str(exercise)!r})"
    )
    helpers = [folder for folder in sys.path if "tests" in Path(folder).parts]
    ended = subprocess.run(
        [sys.executable, "-c", said],
        env={**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), *helpers))},
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    names, digest = ended.stdout.splitlines()
    assert names == (
        "corner_cut descent_mps climb_mps speed_mps"
        " smoothing_s vertical_acceleration_mps2 acceleration_mps2"
    )
    assert digest == exercised().stdout


def test_an_array_in_another_order_than_in_c_is_refused():
    assert headers.columns(FLIGHT.Piece, "t0 p v a area") == 13
    with pytest.raises(InputError, match=r"^Piece is t0 p v a area in C, t0 v p a area in P"):
        headers.columns(FLIGHT.Piece, "t0 v p a area")


def test_values_have_names_and_only_those_of_c():
    made = steering(LimitsConfig(climb_mps=3.0, descent_mps=2.0))
    assert (made.climb_mps, made.descent_mps) == (3.0, 2.0)
    with pytest.raises(TypeError, match="positional"):
        FLIGHT.Gauge(print, 0.0, 1.0)
    with pytest.raises(AttributeError, match="no attribute 'climb'"):
        FLIGHT.Steering(climb=1.0)
    with pytest.raises(AttributeError, match="no attribute 'climb'"):
        made.climb = 1.0


@pytest.mark.parametrize(
    "member", ["int64_t a : 3", "double a[2][3]", "double **a", "#if 1\n double a"]
)
def test_c_of_another_form_is_not_guessed(tmp_path, member):
    (tmp_path / "odd.h").write_text(f"typedef struct {{\n    {member};\n}} Odd;\n")
    with pytest.raises(InputError, match="C that is not read: "):
        headers.declared(tmp_path / "odd.h")


def test_kinds_of_declarations(tmp_path):
    (tmp_path / "inner.h").write_text("enum { FIRST = 0x10, SECOND, BOTH = 2 * FIRST + 1 };\n")
    (tmp_path / "all.h").write_text(
        '#include "inner.h"\n'
        "typedef struct { /* { } ; */\n"
        "    const double *a, *b; int64_t c, d[BOTH]; double (*rows)[SECOND]; uint8_t last[];\n"
        "    void *(*call)(void *, double x, const double (*rows)[3]);\n"
        "} Kinds;\n"
        "EXPORTED int64_t shown(const Kinds *kinds, int64_t n, double p[3], float x)\n{\n}\n"
        "static int hidden(int n)\n{\n}\n"
    )
    found = SimpleNamespace(**headers.declared(tmp_path / "all.h"))
    assert (found.FIRST, found.SECOND, found.BOTH) == (16, 17, 33)
    names = [name for name, _ in found.Kinds._fields_]
    assert names == ["a", "b", "c", "d", "rows", "last", "call"]
    sizes = [getattr(found.Kinds, name).size for name in names]
    assert sizes == [8, 8, 8, 8 * 33, 8, 0, 8]
    pointer, whole = ctypes.c_void_p, ctypes.c_int64
    assert found.shown == [whole, pointer, whole, pointer, ctypes.c_float]
    assert found.Kinds.functions == {"call": [pointer, pointer, ctypes.c_double, pointer]}
    assert not hasattr(found, "hidden")
