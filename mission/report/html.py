"""What all reports have in common: the document, tiles, cards and tables."""

from collections.abc import Sequence
from html import escape
from importlib.resources import files

# Nothing may be fetched from anywhere: the file is all there is.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


def document(title: str, sections: Sequence[str], *, footer: str) -> str:
    """A whole page; `sections` are HTML, everything else is text."""
    assets = files("mission.report") / "assets"
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        f"<title>{escape(title)} · Aerofed</title>"
        f"<style>{(assets / 'report.css').read_text('utf-8')}</style></head>"
        f"<body><main>{''.join(sections)}<footer>{escape(footer)}</footer>"
        f"</main><script>{(assets / 'report.js').read_text('utf-8')}</script></body></html>\n"
    )


def heading(
    title: str, *, badge: str = "", good: bool = True, facts: Sequence[str], notice: str = ""
) -> str:
    """The page's title with a badge beside it, a line of facts and a notice under it."""
    kind = "status" if good else "status bad"
    mark = f' <span class="{kind}">{escape(badge)}</span>' if badge else ""
    told = f'<p class="notice">{escape(notice)}</p>' if notice else ""
    return f'<h1>{escape(title)}{mark}</h1><p class="sub">{escape(" · ".join(facts))}</p>{told}'


def key(style: str, text: str, *, dot: bool = False) -> str:
    """An entry of a legend; `style` is CSS of its line or dot."""
    kind = ' class="dot"' if dot else ""
    return f'<span class="key"><i{kind} style="{style}"></i>{escape(text)}</span>'


def tiles(items: Sequence[tuple[str, str]]) -> str:
    """Large numbers, each with what it is."""
    body = "".join(
        f'<div class="tile"><b>{escape(value)}</b><span>{escape(label)}</span></div>'
        for value, label in items
    )
    return f'<div class="tiles">{body}</div>'


def cards(title: str, items: Sequence[str]) -> str:
    """A section of cards; nothing without any."""
    if not items:
        return ""
    return f'<h2>{escape(title)}</h2><div class="cards">{"".join(items)}</div>'


def table(
    title: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    text: int = 0,
    note: str = "",
) -> str:
    """A section with a wide table; the first `text` columns are words, the others numbers."""
    kinds = ["" if index < text else " class=number" for index in range(len(heads))]

    def line(tag: str, cells: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{kind}>{escape(cell)}</{tag}>" for kind, cell in zip(kinds, cells, strict=True)
        )

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    about = f'<p class="sub">{escape(note)}</p>' if note else ""
    return (
        f'<h2>{escape(title)}</h2><section class="card scroll">{about}<table>'
        f"<thead><tr>{line('th', heads)}</tr></thead><tbody>{body}</tbody></table></section>"
    )


def folded(title: str, text: str) -> str:
    """A card with text to unfold."""
    return (
        f'<section class="card"><details><summary>{escape(title)}</summary>'
        f"<pre>{escape(text)}</pre></details></section>"
    )
