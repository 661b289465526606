"""What comes out has the same bytes on every kind of processor and from every compiler."""

import ctypes
import subprocess

import numpy as np
import pytest
from toolchains import compile_all, compilers, exercised, others

from flightdyn.native.library import Innovations
from mission.cli import call
from native import building, loading
from native.errors import InputError

POSSIBLE = list(building.levels())[: loading.load(building.LIBRARIES[0]).best_level() + 1]


@pytest.fixture(scope="module")
def expected():
    ended = exercised()
    assert ended.returncode == 0, ended.stderr
    assert len(ended.stdout) == 64
    return ended.stdout


@pytest.mark.slow
@pytest.mark.parametrize("level", POSSIBLE)
def test_every_level_gives_the_same_bytes(expected, level):
    ended = exercised(AEROFED_LEVEL=level)
    assert ended.stdout == expected, ended.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", others())
def test_every_compiler_gives_the_same_bytes(expected, name, tmp_path):
    compile_all(tmp_path, compilers()[name])
    ended = exercised(tmp_path)
    assert ended.stdout == expected, ended.stderr


def test_a_level_that_is_not_there_is_refused_in_one_line(monkeypatch):
    monkeypatch.setenv(loading.LEVEL, "avx1024")
    with pytest.raises(InputError, match="AEROFED_LEVEL=avx1024: this processor has ba"):
        loading.level(loading.load(building.LIBRARIES[0]))


def test_the_command_line_says_so_without_a_traceback(monkeypatch, capsys):
    def refuse(*_, **__):
        raise InputError("no library")

    monkeypatch.setattr("mission.commands.plan.load", refuse)
    assert call(["plan"]) == 2
    assert capsys.readouterr().err == "aerofed: no library\n"


# Which registers are not in their first state: 2, 5, 6 and 7 are upper halves, masks and more.
UPPERS = """
#include <immintrin.h>
__attribute__((target("xsave"))) long long in_use(void) { return _xgetbv(1); }
__attribute__((target("avx2"))) long long in_use_after_avx(void)
{
    __asm__ volatile("vpcmpeqd %%ymm0, %%ymm0, %%ymm0" ::: "xmm0");
    const long long found = _xgetbv(1);
    _mm256_zeroupper();
    return found;
}
"""


@pytest.mark.skipif("avx2" not in POSSIBLE, reason="this processor has no upper halves")
def test_upper_halves_of_registers_are_left_clear(tmp_path):
    compiler = next(iter(compilers().values()), None)
    if compiler is None:
        pytest.skip("there is no compiler")
    (tmp_path / "uppers.c").write_text(UPPERS)
    library = tmp_path / "uppers.so"
    command = [*compiler, "-mxsave", "-shared", "-fPIC", "-o", library, tmp_path / "uppers.c"]
    subprocess.run(command, check=True)
    uppers = ctypes.CDLL(str(library))
    if not uppers.in_use_after_avx() & 4:
        pytest.skip("this processor does not tell")
    innovations = Innovations(np.ones((8, 22)), np.eye(8))
    innovations.measure(np.eye(22))
    assert not uppers.in_use() & 4


FUSED = """
#include "lanes.h"
void fused_all(long count, const float *a, const float *b, const float *c, float *out)
{
    for (long i = 0; i < count; i += LENGTH)
        store(out + i, multiply_add(load(a + i), load(b + i), load(c + i)));
}
"""


@pytest.mark.slow
def test_products_are_fused_alike_whatever_the_numbers(tmp_path):
    (tmp_path / "fused.c").write_text(FUSED)
    rng = np.random.default_rng(5)
    bits = rng.integers(0, 2**32, (3, 160_000), dtype=np.uint32)
    # Exponents near each other too, where sums cancel and round.
    bits[:, ::2] = (bits[:, ::2] & 0x807FFFFF) | 0x3F800000
    bits[2, ::4] ^= 0x80000000
    # Sums that lie next to half a unit of the result, where rounding twice goes wrong.
    bits[2, 1::2] = (bits[2, 1::2] & 0x807FFFFF) | (rng.integers(90, 160, 80_000) << 23).astype(
        "u4"
    )
    a, b, c = bits.view(np.float32)
    results = []
    for level in POSSIBLE:
        target = tmp_path / f"{level}.so"
        subprocess.run(
            [*next(building.compilers()), "-std=gnu11", "-O2", "-shared", "-fPIC", "-Wno-psabi",
             "-ffp-contract=off", f"-I{building.LIBRARIES[0].folder}", *building.levels()[level],
             str(tmp_path / "fused.c"), "-o", str(target)],
            check=True,
        )  # fmt: skip
        out = np.zeros_like(a)
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (a, b, c, out)]
        ctypes.CDLL(str(target)).fused_all(ctypes.c_long(len(a)), *pointers)
        results.append(out)
    for other in results[1:]:
        numbers = ~(np.isnan(results[0]) & np.isnan(other))
        np.testing.assert_array_equal(
            results[0][numbers].view(np.uint32), other[numbers].view(np.uint32)
        )
    with np.errstate(all="ignore"):
        exact = a.astype(np.longdouble) * b + c  # 64 bits: rounds twice now and then
        close = np.isclose(results[0], exact.astype(np.float32), rtol=2e-7, atol=1e-44)
    assert (close | ~np.isfinite(results[0])).all()
