"""Every key of a configuration, from the models, with examples that are read before they count."""

import ast
import itertools
import re
from inspect import cleandoc, getsource

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from mission.config.models import RunConfig
from pages.examples import EXAMPLES
from pages.keys import Key, tag, top

HEAD = """# Configuration

Every key, generated from the code (`python docs/generate.py`). Units stand in the key names:
`_m` metres, `_s` seconds, `_mps` metres a second, `_deg` degrees, `_db` decibels, `_hz` hertz,
`_j` joules.

A file is TOML; tables are the headings below, `[]` marks a list of tables. Every key can be given
on the command line too: `--set mission.steps=8`, `--set communities.0.devices=4`,
`--set 'vehicle.aircraft.faults=[{kind="gnss_off", at_s=40}]'`. A file must hold one
`[[communities]]` with `name` and `task`; the examples below go beside it.
"""


def page() -> str:
    return HEAD + "\n".join(_section("", top(RunConfig), RunConfig)) + "\n"


def _section(heading: str, key: Key, model: type[BaseModel]) -> list[str]:
    """The table of one model and its examples, then those of the models in it."""
    title = f"`{heading}`" if heading else "Top level"
    lines = ["", f"## {title}", "", cleandoc(model.__doc__ or ""), ""]
    lines += ["| key | default | allowed | what |", "|---|---|---|---|"]
    inner: list[str] = []
    told = _told(model)
    for name, field in model.model_fields.items():
        one = Key(key.path, model).inner(name)
        assert one is not None
        path = f"{heading.split(' ')[0]}.{name}" if heading else name
        element = one.inner(0)
        if one.models:
            inner += _section(path, one, one.models[0])
        elif element is not None and element.models:
            for option in element.models:
                kind = f' kind = "{tag(option)}"' if len(element.models) > 1 else ""
                inner += _section(f"{path}[]{kind}", element, option)
        else:
            what = (told.get(name) or field.description or "").replace("|", "\\|")
            # A pattern is code: as text its brackets would be read as links.
            words = re.sub(r"matching (\S+)", r"matching `\1`", one.words.replace("|", "\\|"))
            lines.append(f"| `{name}` | {_default(field)} | {words} | {what} |")
    if lines[-1].startswith("|---"):
        lines = lines[:-2]
    if heading in EXAMPLES:
        lines += ["", "```toml", EXAMPLES[heading].strip(), "```"]
    return [*lines, *inner]


def _told(model: type[BaseModel]) -> dict[str, str]:
    """What the keys of a model are, by the docstrings under its fields and those of its bases."""
    found: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        try:
            body = ast.parse(getsource(kind)).body[0]
        except (OSError, TypeError):  # made while the program runs, or of a library in C
            continue
        inside = body.body if isinstance(body, ast.ClassDef) else []
        for key, words in itertools.pairwise(inside):
            if isinstance(key, ast.AnnAssign) and isinstance(words, ast.Expr):
                assert isinstance(key.target, ast.Name)
                found[key.target.id] = " ".join(ast.literal_eval(words.value).split())
    return found


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True, validated_data={})
    if value is PydanticUndefined:
        return "required"
    if value is None:
        return "none"
    if isinstance(value, tuple):
        value = list(value)
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"
