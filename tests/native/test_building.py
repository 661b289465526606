"""Libraries are built where there is a compiler, anew where sources change, and asked for else."""

import importlib.util
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from native import building, loading
from native.errors import InputError


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A copy of the sources that compile soonest of those with levels, without a library."""
    levels = {name: (*more, "-O0") for name, more in building.levels().items()}  # sooner still
    monkeypatch.setattr(building, "levels", lambda: levels)
    original = building.library("flight")
    folder = tmp_path / "native"
    shutil.copytree(original.folder, folder, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    return replace(original, folder=folder)


@pytest.fixture
def no_compiler(monkeypatch, tmp_path):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)


@pytest.mark.slow
def test_a_change_of_any_source_is_built_and_the_old_library_goes(library):
    loading.load(library)
    first = library.built
    assert len(first) == 1
    loading.load(library)
    assert library.built == first
    with (library.folder / "strapdown.h").open("a") as file:
        file.write("/* changed */\n")
    changed = replace(library)
    loading.load(changed)
    assert changed.built != first
    assert len(changed.built) == 1


@pytest.mark.slow
def test_an_installed_library_needs_no_compiler(library, request):
    """A wheel has the sources of its libraries."""
    building.build(library)
    (built,) = library.built
    request.getfixturevalue("no_compiler")
    assert loading.load(replace(library)).best_level() >= 0
    assert library.built == [built]


@pytest.mark.usefixtures("no_compiler")
def test_without_a_compiler_one_line_says_what_helps(library):
    with pytest.raises(InputError, match=r"no C compiler .*: install one .* or `pip install") as e:
        loading.load(library)
    assert "\n" not in str(e.value)
    assert list(library.folder.glob(".build-*")) == []


def test_a_source_that_does_not_compile_is_shown_with_what_the_compiler_says(library):
    (library.folder / "strapdown.h").write_text("no C\n")
    with pytest.raises(InputError, match=r"strapdown\.h:1:1: error: "):
        building.build(library)
    assert library.built == []


def test_cc_names_the_only_compiler(monkeypatch, library):
    monkeypatch.setenv("CC", "/no/such/compiler -m64")
    with pytest.raises(InputError, match="CC=/no/such/compiler -m64: does not compile a C program"):
        building.build(library)
    assert build_hook(monkeypatch).dependencies() == []


class _Hook:
    def __init__(self, *_):
        pass


def build_module(monkeypatch):
    """`hatch_build.py`, whose base classes need not be installed."""
    bases = ("builders.hooks", "BuildHookInterface"), ("metadata", "MetadataHookInterface")
    for place, base in bases:
        parts = f"hatchling.{place}.plugin.interface".split(".")
        for end in range(1, len(parts) + 1):
            name = ".".join(parts[:end])
            if name not in sys.modules or end > 1:
                monkeypatch.setitem(sys.modules, name, type(sys)(name))
        vars(sys.modules[".".join(parts)])[base] = _Hook
    path = building.ROOT / "hatch_build.py"
    spec = importlib.util.spec_from_file_location("hatch_build", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_packages_page_leads_to_where_the_project_is_kept(monkeypatch):
    module = build_module(monkeypatch)
    metadata: dict[str, Any] = {"version": "1.2.3"}
    hook = module.LinkedMetadataHook()
    hook.root = str(building.ROOT)
    monkeypatch.setenv("AEROFED_REPOSITORY", "https://example.org/o/aerofed")
    hook.update(metadata)
    text = metadata["readme"]["text"]
    place = "https://example.org/o/aerofed"
    assert f"]({place}/raw/v1.2.3/docs/images/two-rounds.png)" in text
    assert f"]({place}/blob/v1.2.3/docs/getting-started.md" in text
    assert "](docs/" not in text
    assert "](#" in text or "](http" in text
    assert metadata["urls"]["Issues"] == f"{place}/issues"
    monkeypatch.delenv("AEROFED_REPOSITORY")
    hook.update(metadata)
    assert metadata["readme"]["text"] == (building.ROOT / "README.md").read_text(encoding="utf-8")
    assert list(metadata["urls"]) == ["Paper"]


def build_hook(monkeypatch):
    return build_module(monkeypatch).NativeBuildHook(Path())


def test_a_wheel_is_for_every_python_of_its_platform(monkeypatch):
    hook = build_hook(monkeypatch)
    data: dict[str, Any] = {"force_include": {}}
    hook.root = building.ROOT
    hook.initialize("standard", data)
    assert data["tag"].startswith("py3-none-")
    assert not data["tag"].endswith("-any")
    assert data["pure_python"] is False
    folders = {building.ROOT / Path(path).parent for path in data["force_include"].values()}
    assert folders == {library.folder for library in building.LIBRARIES}


def test_the_build_asks_for_a_compiler_where_there_is_none(monkeypatch, tmp_path):
    hook = build_hook(monkeypatch)
    assert hook.dependencies() == []
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert [*hook.dependencies()] == [building.ZIG]
