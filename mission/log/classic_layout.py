"""Our Foxglove layout in the form that Lichtblick and Foxglove Studio import.

The SDK describes a layout as a tree of splits with any number of children; the older form is a
table of panels (`configById`) beside a tree of pairs. Keys within a panel are nearly the same.
"""

import json
from collections.abc import Sequence
from typing import Any

ATTACHMENT = "lichtblick-layout.json"

_KINDS = {
    "ThreeDee": "3D",
    "Map": "map",
    "Plot": "Plot",
    "StateTransitions": "StateTransitions",
    "Log": "RosOut",
}
_TITLE_KEYS = ("lichtblickPanelTitle", "foxglovePanelTitle")
_SERIES: dict[str, object] = {"enabled": True, "timestampMethod": "receiveTime"}
_LOG: dict[str, object] = {"minLogLevel": 1, "searchTerms": []}


def classic(layout: bytes) -> bytes:
    """A layout of the SDK, converted."""
    panels: dict[str, dict[str, object]] = {}
    tree = _node(json.loads(layout)["content"], panels)
    document = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": tree,
    }
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


def _node(content: dict[str, Any], panels: dict[str, dict[str, object]]) -> object:
    """A panel's name, or a pair; `panels` gets every panel's configuration."""
    if content["type"] == "panel":
        kind = _KINDS[content["panelType"]]
        name = f"{kind}!p{len(panels)}"
        panels[name] = _config(kind, content)
        return name
    items = [(item["proportion"], item["content"]) for item in content["items"]]
    return _pairs(items, content["direction"], panels)


def _pairs(
    items: Sequence[tuple[float, dict[str, object]]],
    direction: str,
    panels: dict[str, dict[str, object]],
) -> object:
    (share, first), rest = items[0], items[1:]
    if not rest:
        return _node(first, panels)
    return {
        "direction": direction,
        "first": _node(first, panels),
        "second": _pairs(rest, direction, panels),
        "splitPercentage": round(100 * share / sum(share for share, _ in items), 2),
    }


def _config(kind: str, content: dict[str, Any]) -> dict[str, object]:
    config = dict(content["config"]) | dict.fromkeys(_TITLE_KEYS, content["title"])
    if "paths" in config:
        config["paths"] = [_SERIES | series for series in config["paths"]]
    elif kind == "RosOut":
        config |= _LOG
    return config
