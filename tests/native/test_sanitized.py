"""The libraries under address and undefined-behaviour sanitizers."""

import subprocess

import pytest
from toolchains import compile_all, compilers, exercised

from native import building, loading

pytestmark = pytest.mark.slow

FLAGS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-O0", "-g1")


@pytest.fixture(scope="module")
def runtime():
    """The sanitizer's library, which a process has to load before anything else."""
    if "gcc" not in compilers():
        pytest.skip("needs GCC with its sanitizers")
    found = subprocess.run(
        ["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True
    ).stdout.strip()
    if "/" not in found:
        pytest.skip("GCC without sanitizers")
    return found


def test_no_access_out_of_bounds_and_nothing_undefined(runtime, tmp_path, monkeypatch):
    levels = building.levels()
    taken = list(levels)[loading.load(building.LIBRARIES[0]).best_level()]
    # The others are not entered: all are said to be the one.
    others = ",".join(f"--defsym=@_{name}=@_{taken}" for name in levels if name != taken)
    monkeypatch.setattr(building, "levels", lambda: {taken: levels[taken]})
    compile_all(tmp_path, ["gcc"], *FLAGS, alias=f"-Wl,{others}" if others else "")
    ended = exercised(tmp_path, LD_PRELOAD=runtime, ASAN_OPTIONS="detect_leaks=0")
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert ended.stdout == exercised().stdout
