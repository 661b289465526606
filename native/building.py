"""Compilation of C into shared libraries: compilers and flags. Standard library only.

The build of a wheel or an editable installation calls this (`hatch_build.py`), and
`native.loading` where a working tree's sources have changed since. The C interface needs no header
of Python, so that one library serves every Python. Where there is no compiler, `ziglang` from the
package index is one: plain C takes it seconds (its C++ library would take minutes, at first use).
"""

import hashlib
import importlib.util
import os
import platform
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from native.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
INCLUDE = Path(__file__).resolve().parent / "include"
MACOS = os.environ.get("MACOSX_DEPLOYMENT_TARGET", "12.0")  # the oldest that a library runs on
ZIG = "ziglang==0.17.*"  # what to ask the package index for where there is no compiler

# Rounding must be the source's: no sum is reordered, no product fused with a sum unless it says so.
# With -O3 GCC takes two fifths longer to compile, and what it makes is no faster.
_FLAGS = (
    *("-std=gnu11", "-O2", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off"),
    *("-fno-math-errno", "-fno-trapping-math", "-g0", "-Wall", "-Wextra", "-Wno-psabi"),
)
# With -fipa-ra GCC 12 forgets vzeroupper where a function that used wide registers calls another of
# the same file. Whatever runs next without AVX, such as JSBSim, then takes four times as long on
# Intel's processors, where SSE instructions wait for the upper halves. Clang vectorises by itself.
_OF_GCC = ("-fno-ipa-ra", "-ftree-vectorize", "-fvect-cost-model=dynamic")
# Kinds of processor, the plainest first; a library holds its inner loops once for each.
_AVX2 = ("-mavx2", "-mfma")
_AVX512 = ("-mavx512f", "-mavx512dq", "-mavx512bw", "-mavx512vl", "-mprefer-vector-width=512")
_X86_LEVELS = {"baseline": (), "avx2": _AVX2, "avx512": (*_AVX2, *_AVX512)}


@dataclass(frozen=True)
class Library:
    """A shared library and its C sources."""

    name: str
    folder: Path
    levelled: str | None  # the source that is compiled for every level, if there is one
    border: str  # the source that is called, hands out the levels, and declares what Python uses

    @property
    def path(self) -> Path:
        """Path of the library, with the digest of the present sources; it may not be built yet."""
        return self.folder / f"lib{self.name}-{self._digest}.so"

    @property
    def built(self) -> list[Path]:
        """Files of all builds of the library, of whatever sources."""
        return sorted(self.folder.glob(f"lib{self.name}-*.so"))

    @cached_property
    def _digest(self) -> str:
        digest = hashlib.sha256()
        for source in (*_sources(INCLUDE), *_sources(self.folder), Path(__file__)):
            digest.update(source.read_bytes())
        return digest.hexdigest()[:12]


LIBRARIES = (
    Library("learning", ROOT / "fl" / "native", "training.c", "learning.c"),
    Library("planner", ROOT / "mission" / "planner" / "native", "planning.c", "planner.c"),
    Library("airspace", ROOT / "mission" / "base" / "native", None, "airspace.c"),
    Library("bridge", ROOT / "sitl" / "firmware" / "native", None, "bridge.c"),
    Library("flight", ROOT / "flightdyn" / "native", "core.c", "flight.c"),
)


def library(name: str) -> Library:
    """The library of that name."""
    return next(library for library in LIBRARIES if library.name == name)


def _sources(folder: Path) -> list[Path]:
    return sorted((*folder.glob("*.c"), *folder.glob("*.h")))


def levels() -> dict[str, tuple[str, ...]]:
    """Return the processor levels by name, the plainest first, with the compiler flags of each."""
    return _X86_LEVELS if platform.machine() in ("x86_64", "AMD64") else {"baseline": ()}


def env_cc() -> str:
    """The compiler that the environment names in CC; empty where it names none."""
    return os.environ.get("CC", "").strip()


def compilers() -> Iterator[tuple[str, ...]]:
    """The compilers that work here: what `CC` names, else the system's and the package index's."""
    zig = (sys.executable, "-m", "ziglang", "cc")
    for command in [shlex.split(env_cc())] if env_cc() else [["cc"], ["gcc"], ["clang"], zig]:
        if tuple(command) == zig and importlib.util.find_spec("ziglang") is None:
            continue
        if _works(command):
            yield tuple(command)


def _works(command: Sequence[str]) -> bool:
    """Whether it makes shared libraries, which takes the C library's headers too."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "probe.c")
        source.write_text("#include <stdlib.h>\nvoid *probe(void) { return malloc(1); }\n")
        try:
            _run([*command, "-shared", "-fPIC", str(source), "-o", str(Path(folder, "probe.so"))])
        except InputError:
            return False
        return True


def build(library: Library, *, compiler: Sequence[str] | None = None) -> Path:
    """Build a library from its sources, and remove builds of older sources.

    Raises:
        InputError: there is no compiler, or it fails.
    """
    compiler = compiler or next(compilers(), None)
    if compiler is None and env_cc():
        raise InputError(f"CC={env_cc()}: does not compile a C program into a shared library")
    if compiler is None:
        raise InputError(
            f"no C compiler for {library.folder}: install one (cc, gcc or clang), name one in CC, "
            f"or `pip install '{ZIG}'`"
        )
    target = library.path
    compile_to(target, library, compiler)
    for old in library.built:
        if old != target:
            old.unlink(missing_ok=True)
    return target


def build_missing() -> None:
    """Build the libraries that are not there for the present sources, the large ones beside the
    small.

    Raises:
        InputError: there is no compiler, or it fails.
    """
    with ThreadPoolExecutor() as pool:
        list(pool.map(build, (library for library in LIBRARIES if not library.path.exists())))


def compile_to(
    target: Path, library: Library, compiler: Sequence[str], *, flags: Sequence[str] = ()
) -> None:
    """Compile a library to `target`, which appears whole or not at all.

    Raises:
        InputError: the compiler fails, or the folder cannot be written.
    """
    known = _OF_GCC if _knows(compiler, _OF_GCC) else ()
    common = [*compiler, *_FLAGS, *known, f"-I{INCLUDE}", *_machine(compiler), *flags]
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".build-") as folder:
            jobs: list[list[str]] = []
            if library.levelled is not None:
                source = str(library.folder / library.levelled)
                for level, more in levels().items():
                    made = str(Path(folder, f"{level}.o"))
                    jobs.append([*common, *more, f"-DLEVEL={level}", "-c", source, "-o", made])
            with ThreadPoolExecutor() as pool:
                list(pool.map(_run, jobs))
            objects = [job[-1] for job in jobs]
            whole = Path(folder, target.name)
            border = str(library.folder / library.border)
            _run([*common, "-shared", border, *objects, "-o", str(whole)])
            whole.replace(target)
    except OSError as error:
        raise InputError(f"{target.parent}: cannot build a library here: {error}") from error


def _machine(compiler: Sequence[str]) -> list[str]:
    """Return flags for the target processor and system; Zig would take this very processor's."""
    if "ziglang" in compiler:
        return ["-mcpu=baseline", "-fno-sanitize=undefined"]
    return [f"-mmacosx-version-min={MACOS}"] if sys.platform == "darwin" else []


def _knows(compiler: Sequence[str], flags: Sequence[str]) -> bool:
    command = [*compiler, "-Werror", *flags, "-fsyntax-only", "-x", "c", os.devnull]
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False  # there is none; compiling says so


def _run(command: Sequence[str]) -> None:
    try:
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise InputError(f"{command[0]}: {error.strerror}") from error
    if ended.returncode:
        raise InputError(f"{shlex.join(command)} failed:\n{ended.stderr}{ended.stdout}")
