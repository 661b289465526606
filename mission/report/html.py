"""Renders the pages of all reports from their templates."""

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from mission.base.palette import DARK, LIGHT
from mission.figures.render import libraries
from mission.figures.style import CONFIG


def page(template: str, **content: object) -> str:
    """Render a self-contained HTML page from a template; all of `content` is text, escaped."""
    return (
        _templates()
        .get_template(template)
        .render(light=LIGHT, dark=DARK, look=CONFIG, libraries=Markup(libraries()), **content)
    )


@cache
def _templates() -> Environment:
    return Environment(
        loader=PackageLoader("mission.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
