"""Writes docs/configuration.md from the models; `--check` fails where the file is not current."""

import sys
import types
from pathlib import Path
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from mission.config import RunConfig

TARGET = Path(__file__).with_name("configuration.md")
HEAD = """# Configuration

Every key, generated from the code (`python docs/generate.py`). Units stand in the key names:
`_m` metres, `_s` seconds, `_mps` metres a second, `_deg` degrees, `_db` decibels, `_hz` hertz.
A file is TOML; tables are the headings below. Every key can be given on the command line too:
`--set mission.steps=8`, `--set communities.0.devices=4`.
"""


def main() -> int:
    text = HEAD + "\n".join(section("", RunConfig)) + "\n"
    if "--check" in sys.argv[1:]:
        return int(not TARGET.is_file() or TARGET.read_text(encoding="utf-8") != text)
    TARGET.write_text(text, encoding="utf-8")
    return 0


def section(path: str, model: type[BaseModel]) -> list[str]:
    """The table of one model, then those of the models in it."""
    lines = ["", f"## {path or 'Top level'}", "", (model.__doc__ or "").strip(), ""]
    lines += ["| key | default | allowed | what |", "|---|---|---|---|"]
    inner: list[str] = []
    for name, field in model.model_fields.items():
        key = f"{path}.{name}" if path else name
        models = nested(field.annotation)
        if models:
            for one in models:
                many = get_origin(field.annotation) is tuple
                inner += section(f"{key}[]" if many else key, one)
            continue
        what = (field.description or "").replace("|", "\\|")
        lines.append(f"| `{name}` | {default(field)} | {allowed(field)} | {what} |")
    if lines[-1].startswith("|---"):
        lines = lines[:-2]
    return [*lines, *inner]


def nested(annotation: Any) -> list[type[BaseModel]]:
    """The models in an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in nested(argument)]


def default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "required"
    if value is None:
        return "none"
    if isinstance(value, tuple):
        value = list(value)
    return f"`{value}`"


def allowed(field: FieldInfo) -> str:
    """Type and bounds, in words."""
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "pattern": "matching"}
    bounds = []
    for item in field.metadata:
        for name, sign in signs.items():
            bound = getattr(item, name, None)
            if bound is not None:
                bounds.append(f"{sign} `{bound}`")
    return ", ".join([kind(field.annotation), *bounds]).replace("|", "\\|")


def kind(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, types.UnionType):
        return " or ".join(kind(a) for a in arguments if a is not type(None))
    if hasattr(annotation, "__metadata__"):
        return kind(annotation.__origin__)
    if origin is tuple:
        inner = [a for a in arguments if a is not Ellipsis]
        count = "several" if Ellipsis in arguments else str(len(inner))
        return f"{count} of {kind(inner[0])}"
    if origin is dict:
        return f"table of {kind(arguments[0])} to {kind(arguments[1])}"
    if origin is not None:  # Literal
        return ", ".join(f"`{a}`" for a in arguments)
    names = {float: "number", int: "whole number", str: "text", bool: "true or false", Path: "path"}
    return names.get(annotation, str(annotation))


if __name__ == "__main__":
    sys.exit(main())
