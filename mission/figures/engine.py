"""Draws in a process of its own: reads jobs, writes results. Run as a script, by `render`.

The JavaScript engine that draws ends its process when it finds no memory: that must not be ours.
The first job is in the arguments; each of the others is a line of the standard input, [kind, text]
in JSON. Their results are lines of base64 on the standard output.
"""

import base64
import itertools
import json
import sys
from collections.abc import Callable

import vl_convert as vlc

DRAW: dict[str, Callable[[str, str], bytes | str]] = {
    "png": lambda text, version: vlc.vegalite_to_png(text, version, scale=2),
    "svg": vlc.vegalite_to_svg,
    "pdf": vlc.vegalite_to_pdf,
    # The JavaScript that a page draws with: Vega, Vega-Lite and Vega-Embed, BSD-3-Clause.
    "libraries": vlc.javascript_bundle,
}


def main() -> None:
    """Draw what is asked for; arguments: the version of Vega-Lite, kind and text of the first."""
    version, *first = sys.argv[1:]
    for kind, text in itertools.chain([first], map(json.loads, sys.stdin)):
        drawn = DRAW[kind](text, version)
        content = drawn.encode() if isinstance(drawn, str) else drawn
        sys.stdout.write(base64.b64encode(content).decode() + "\n")


if __name__ == "__main__":
    main()
