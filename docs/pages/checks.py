"""What every page is checked for: links that lead somewhere, TOML and commands that are taken."""

import re
import shlex
import tempfile
from collections.abc import Iterator
from pathlib import Path

from cyclopts import CycloptsError

from mission.base.errors import InputError
from mission.cli import app
from mission.commands.usage import spread
from mission.config.loading import load_config

_COMMUNITY = '\n[[communities]]\nname = "a"\ntask = "digits"\n'
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
_CODE = re.compile(r"^```\w*\n.*?^```$", re.MULTILINE | re.DOTALL)
_TOML = re.compile(r"^```toml\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# A line of code that calls `aerofed`; on the generated page the line of usage is no command.
_COMMAND = re.compile(r"^    (?:\.venv/bin/)?aerofed ((?!.*(?:\[|[A-Z]$)).+)$", re.MULTILINE)


def faults(root: Path) -> Iterator[str]:
    """What is wrong with the pages beside the README and in docs/, a line each."""
    for page in (*sorted(root.glob("*.md")), *sorted((root / "docs").glob("*.md"))):
        text, name = page.read_text(encoding="utf-8"), page.relative_to(root)
        for link in _LINK.findall(_CODE.sub("", text)):
            if not link.startswith(("http://", "https://")):
                yield from (f"{name}: {fault}" for fault in _link_faults(page, link))
        for example in _TOML.findall(text):
            yield from (f"{name}: {fault}" for fault in _example_faults(example))
        for command in _COMMAND.findall(text):
            yield from (f"{name}: {fault}" for fault in _command_faults(command))


def _link_faults(page: Path, link: str) -> Iterator[str]:
    file, _, anchor = link.partition("#")
    target = page.parent / file if file else page
    if not target.exists():
        yield f"the link to {link} leads nowhere"
    elif anchor and anchor not in _anchors(target.read_text(encoding="utf-8")):
        yield f"the link to {link}: no such heading"


def _anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


def _example_faults(example: str) -> Iterator[str]:
    whole = example if "[[communities]]" in example else example + _COMMUNITY
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "example.toml"
        path.write_text(whole, encoding="utf-8")
        try:
            load_config(path)
        except InputError as error:
            yield f"an example is refused: {error}\n{example}"


def _command_faults(command: str) -> Iterator[str]:
    """Whether the words and options of a command exist; it is not carried out."""
    try:
        words = shlex.split(command.partition(" > ")[0], comments=True)
        app.parse_args(spread(words), exit_on_error=False, print_error=False)
    except CycloptsError as error:
        yield f"the command is refused: aerofed {command}: {error}"
