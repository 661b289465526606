"""Writes the pages that are made from the code, and checks all pages.

`--check` writes nothing and fails where a page is not current. Either way it fails where a link
leads nowhere or an example is no configuration.
"""

import sys
from functools import partial
from pathlib import Path

from pages import api, architecture, channels, checks, commands, configuration, formats, outcomes

DOCS = Path(__file__).parent
PAGES = {
    "api.md": api.page,
    "architecture.md": architecture.page,
    "channels.md": channels.page,
    "commands.md": commands.page,
    "configuration.md": configuration.page,
    "file-formats.md": formats.page,
    **{
        str(sweep.parent.relative_to(DOCS) / "README.md"): partial(outcomes.page, sweep.parent)
        for sweep in sorted(DOCS.glob("data/*/sweep.json"))
    },
}


def main() -> int:
    faults = []
    for name, make in PAGES.items():
        path, text = DOCS / name, make()
        if "--check" not in sys.argv[1:]:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            faults.append(f"{path} is not current: run python docs/generate.py")
    faults += checks.faults(DOCS.parent)
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
