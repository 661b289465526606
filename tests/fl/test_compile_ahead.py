"""Kernels are compiled before their first call, in processes of their own, once."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numba import njit

from fl import convnet
from fl.datasets import Split
from fl.kernels import ahead
from fl.kernels.ahead import CompilerNeededError, compile_ahead, without_compiler
from fl.models import make_network
from fl.training import LocalSettings, LocalTask, scaling_of

KERNELS = """
import os, sys
from fl.kernels.compiled import cached
@cached
def double(x):
    return 2 * x
def rehearse():
    if os.environ.get("BREAK") and sys.argv[0].endswith("ahead.py"):
        sys.exit("out of memory")
    double(1)
"""

PROGRAM = """
import logging
from fl.kernels import ahead
logging.basicConfig(format="%(message)s")
ahead.compile_ahead(["some_kernels"], lambda: print("compiling"))
import some_kernels
print(some_kernels.double(21), dict(some_kernels.double.stats.cache_hits) != {})
"""


@pytest.fixture
def run(tmp_path):
    (tmp_path / "some_kernels.py").write_text(KERNELS)

    def start(**more):
        environment = os.environ | {
            "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
            "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path]),
        }
        return subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=environment | more, capture_output=True, text=True, check=True,
        )  # fmt: skip

    return start


def test_the_first_process_has_them_compiled_and_says_so_and_no_other_does(run):
    assert run().stdout == "compiling\n42 True\n"
    assert run().stdout == "42 True\n"


def test_what_a_process_fails_to_compile_is_compiled_at_its_first_call(run):
    ended = run(BREAK="1")
    assert ended.stdout == "compiling\n42 False\n"
    assert ended.stderr == (
        "some_kernels: its kernels are compiled at their first call: out of memory\n"
    )


@pytest.fixture
def missing(monkeypatch):
    """A module whose kernels are never on disk, and the processes that are started for it."""
    started = []

    class Child(subprocess.Popen):
        def __init__(self, _, **options):
            super().__init__([sys.executable, "-c", "import time; time.sleep(60)"], **options)
            started.append(self)

    monkeypatch.setattr(ahead, "_on_disk", lambda _: False)
    monkeypatch.setattr(ahead.subprocess, "Popen", Child)
    return started


def test_an_interruption_ends_the_processes(missing, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess.Popen, "communicate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        compile_ahead(["a", "b"], lambda: None)
    assert [child.poll() for child in missing] == [-9, -9]


def test_nothing_is_started_where_nothing_can_be_kept(missing, monkeypatch):
    monkeypatch.setattr(ahead, "UNCACHED", ["a"])
    compile_ahead(["a"], lambda: pytest.fail("nothing is compiled ahead"))
    assert not missing


@pytest.mark.parametrize("correction", [False, True])
def test_a_rehearsal_leaves_nothing_to_compile_for_images_of_bytes(correction):
    convnet.rehearse()
    net = make_network("lenet", image_shape=(28, 28, 3), classes=4)
    rng = np.random.default_rng(1)
    split = Split(rng.integers(0, 256, (20, 28, 28, 3)).astype(np.uint8), rng.integers(0, 4, 20))
    model = net.initial(rng)
    task = LocalTask(np.arange(20), rng, np.zeros_like(model) if correction else None)
    settings, scaling = LocalSettings(0.1, 0.9, 0.1, 8, 1), scaling_of(split)
    with without_compiler():
        net.train(split, model, [task], scaling=scaling, settings=settings)
        net.correct_per_class(split, model, scaling=scaling)


def test_without_a_compiler_a_new_kernel_is_refused_and_then_compiled():
    @njit
    def fresh(x):
        return x + 1

    with pytest.raises(CompilerNeededError), without_compiler():
        fresh(1)
    assert fresh(1) == 2
