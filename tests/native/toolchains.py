"""The compilers of this machine, and the exercise of the libraries in a process of its own."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

from native import building, loading

EXERCISE = Path(__file__).with_name("exercise.py")


def compilers() -> dict[str, list[str]]:
    """Those that are installed: GCC, Clang, and the package index's."""
    found = {name: [name] for name in ("gcc", "clang") if shutil.which(name)}
    if importlib.util.find_spec("ziglang") is not None:
        found["zig"] = [sys.executable, "-m", "ziglang", "cc"]
    return found


def others() -> list[str]:
    """Those that our own libraries are not built with anyway."""
    ours = shutil.which(next(building.compilers(), ("",))[0])
    return [
        name
        for name, (command, *_) in compilers().items()
        if not ours or Path(shutil.which(command) or command).resolve() != Path(ours).resolve()
    ]


def compile_all(folder: Path, compiler: list[str], *flags: str, alias: str = "") -> None:
    """All libraries, into a folder, for `exercised`; `alias` is said to the linker of those that
    have levels, with the library's name for `@`."""
    for library in building.LIBRARIES:
        more = [alias.replace("@", library.name)] if alias and library.levelled else []
        building.compile_to(folder / library.path.name, library, compiler, flags=(*flags, *more))


def exercised(folder: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """The exercise, with the libraries of a folder or our own."""
    more = {} if folder is None else {loading.FOLDER: str(folder)}
    return subprocess.run(
        [sys.executable, str(EXERCISE)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **more, **environment},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
