"""Builds the native libraries into the wheel, or into the tree of an editable installation."""

import platform
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent))  # in a build, nothing of the project is on the path
from native import building


class NativeBuildHook(BuildHookInterface):  # type: ignore[misc, type-arg]
    """Compiles with what compiler there is, and asks for one where there is none."""

    def dependencies(self) -> list[str]:
        """What the build needs besides hatchling."""
        return [] if building.env_cc() or next(building.compilers(), None) else [building.ZIG]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the libraries, and name the wheel after the platform that they run on."""
        del version
        for library in building.LIBRARIES:
            path = library.path if library.path.exists() else building.build(library)
            where = path.relative_to(self.root)
            build_data["force_include"][str(path)] = str(where)
        build_data["pure_python"] = False
        host = sysconfig.get_platform()
        if sys.platform == "darwin":  # where Python may be for two kinds of processor
            host = f"macosx-{building.MACOS}-{platform.machine()}"
        # No header of Python is used: one wheel serves all its versions.
        build_data["tag"] = f"py3-none-{host.replace('-', '_').replace('.', '_')}"
