"""`--set KEY=VALUE`: single keys of a configuration, set over what its file says."""

from typing import Any

from aerofed_errors import SettingError
from mission.base.errors import InputError
from mission.base.explain import shown
from mission.base.user_files import MOST_DEEP, parse_toml


def parse_override(text: str) -> tuple[str, object]:
    """Parse `a.b=value` into a dotted path and a TOML value; a bare word is a string.

    Raises:
        InputError: there is no `=` or no key.
    """
    key, sep, raw = text.partition("=")
    key = key.strip()
    if not sep or not key or any(not part for part in key.split(".")):
        raise InputError(
            f"--set {text}: expected KEY=VALUE with a dotted key, e.g. mission.steps=8"
        )
    try:
        return key, parse_toml(f"value = {raw}")["value"]
    except ValueError:
        return key, raw.strip()


def override(data: dict[str, Any], dotted: str, value: object) -> None:
    """Set one key in `data`; the value is not checked yet. Tables on the way are made.

    Raises:
        SettingError: the way leads through what is neither a table nor a list, or past its end.
    """
    parts: list[Any] = dotted.split(".")
    if len(parts) > MOST_DEEP:
        reason = f"no key has {len(parts)} parts; {MOST_DEEP} at most"
        raise SettingError(shown(dotted), value, reason)
    node: Any = data
    for depth, part in enumerate(parts):
        name, last = ".".join(parts[:depth]), depth == len(parts) - 1
        reason = ""
        if isinstance(node, list):
            if part.isdecimal() and int(part) < len(node):
                part = int(part)
            else:
                most = f"an index from 0 to {len(node) - 1} must follow, not {part!r}"
                reason = f"{name} is a list of {len(node)}{f', so {most}' if node else ''}"
        elif not isinstance(node, dict):
            reason = f"{name} is {shown(node)}, and has nothing in it"
        if reason:
            raise SettingError(dotted, value, reason)
        if last:
            node[part] = value
        else:
            node = node.setdefault(part, {}) if isinstance(node, dict) else node[part]
