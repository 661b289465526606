"""Draws in a process of its own: reads jobs, writes results. Run as a script, by `render`.

The JavaScript engine that draws ends its process when it finds no memory: that must not be ours.
Jobs are a JSON list of [kind, text] on the standard input; results go to the standard output as a
JSON list of base64.
"""

import base64
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
    """Draw what the standard input asks for, with the Vega-Lite version of the first argument."""
    results = []
    for kind, text in json.load(sys.stdin):
        drawn = DRAW[kind](text, sys.argv[1])
        content = drawn.encode() if isinstance(drawn, str) else drawn
        results.append(base64.b64encode(content).decode())
    json.dump(results, sys.stdout)


if __name__ == "__main__":
    main()
