"""Hooks of the site (mkdocs.yml): pages that lie outside docs/ belong to it, too."""

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
# Where a page stands on the site, and where in the repository.
OUTSIDE = {
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "SECURITY.md": "SECURITY.md",
    "data-sources.md": "fl/data/README.md",
    "airframe.md": "flightdyn/physics/airframe/README.md",
}


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that lie outside docs/."""
    for name, path in OUTSIDE.items():
        files.append(File.generated(config, name, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Links that leave docs/, or come from outside it, as they are on the site."""
    for name, path in OUTSIDE.items():
        markdown = markdown.replace(f"](../{path}", f"]({name}")
    if page.file.src_uri in OUTSIDE:
        markdown = markdown.replace("](docs/", "](")
    # The repository's README is no page: its name stays.
    return re.sub(r"\[([^]]+)\]\(\.\./README\.md[^)]*\)", r"\1", markdown)
