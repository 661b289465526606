"""Builds the native libraries into the wheel, or into the tree of an editable installation; gives
the package's page its links."""

import os
import platform
import re
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

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
        building.build_missing()
        for path in (library.path for library in building.LIBRARIES):
            build_data["force_include"][str(path)] = str(path.relative_to(self.root))
        build_data["pure_python"] = False
        host = sysconfig.get_platform()
        if sys.platform == "darwin":  # where Python may be for two kinds of processor
            host = f"macosx-{building.MACOS}-{platform.machine()}"
        # No header of Python is used: one wheel serves all its versions.
        build_data["tag"] = f"py3-none-{host.replace('-', '_').replace('.', '_')}"


# Hatchling is there in a build only: where types are checked its classes are Any.
class LinkedMetadataHook(MetadataHookInterface):  # type: ignore[misc]
    """Links of the README lead to files, which the page of a package is not beside: they are made
    absolute by the address where the project is kept, AEROFED_REPOSITORY, which a release sets."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set README and addresses."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        urls = {"Paper": "https://arxiv.org/abs/2206.02043"}
        if address := os.environ.get("AEROFED_REPOSITORY"):
            tag = f"v{metadata['version']}"
            files = f"{address}/blob/{tag}"
            text = re.sub(r"(!\[[^\]]*\]\()(?!\w+:|#)", rf"\1{address}/raw/{tag}/", text)
            text = re.sub(r"(\]\()(?!\w+:|#)", rf"\1{files}/", text)
            urls |= {
                "Source": address,
                "Documentation": f"{files}/docs/README.md",
                "Changelog": f"{files}/CHANGELOG.md",
                "Issues": f"{address}/issues",
            }
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        metadata["urls"] = urls
