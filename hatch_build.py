"""Builds the native libraries into the wheel, or into the tree of an editable installation."""

import importlib.util
import os
import sys
import sysconfig
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


def _building() -> ModuleType:
    """`native.building` by its path: in a build nothing of the project can be imported."""
    path = Path(__file__).with_name("native") / "building.py"
    spec = importlib.util.spec_from_file_location("native_building", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look themselves up there
    spec.loader.exec_module(module)
    return module


class NativeBuildHook(BuildHookInterface):  # type: ignore[misc, type-arg]
    """Compiles with what compiler there is, and asks for one where there is none."""

    def dependencies(self) -> list[str]:
        """What the build needs besides hatchling."""
        building = _building()
        return [] if next(building.compilers(), None) else [building.ZIG]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the libraries, and name the wheel after the platform that they run on."""
        del version
        building = _building()
        for library in building.LIBRARIES:
            path = library.path if library.path.exists() else building.build(library)
            where = path.relative_to(self.root)
            build_data["force_include"][str(path)] = str(where)
        build_data["pure_python"] = False
        host = os.environ.get("_PYTHON_HOST_PLATFORM") or sysconfig.get_platform()
        # No header of Python is used: one wheel serves all its versions.
        build_data["tag"] = f"py3-none-{host.replace('-', '_').replace('.', '_')}"
