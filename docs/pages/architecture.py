"""The packages of `docs/architecture.md`, from their own words and the contracts of imports."""

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- made from the code: begin -->\n", "<!-- made from the code: end -->\n"
GROUPED = ("mission.flight", "sitl", "sitl.autopilot", "fl", "flightdyn")


def page() -> str:
    """The page as it is, with its packages as they are."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    return before + BEGIN + "\n".join(_body()) + "\n" + END + after


def _body() -> Iterator[str]:
    """Tables of packages, from above to below, and of the homes of libraries."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
        "importlinter"
    ]["contracts"]
    yield from (
        "",
        "`mission`, from top to bottom. A package imports only from packages below it:",
    )
    yield from ("", "| package | what |", "|---|---|")
    for layer in _layers(contracts, "mission"):
        yield from (_row(f"mission.{name}") for name in layer.replace(":", "|").split(" | "))
    for package in GROUPED:
        yield from (
            "",
            f"The packages of `{package}`:",
            "",
            "| package | what |",
            "|---|---|",
        )
        folders = sorted(path.parent.name for path in _folder(package).glob("*/__init__.py"))
        yield from (_row(f"{package}.{name}") for name in folders)
    yield from ("", "The only places that import these libraries:")
    yield from ("", "| library | home |", "|---|---|")
    for library, homes in _homes(contracts).items():
        yield f"| {library} | {', '.join(f'`{home}`' for home in homes)} |"
    yield ""


def _homes(contracts: list[dict[str, Any]]) -> dict[str, list[str]]:
    """Where each third-party library may be imported, by the library's name."""
    homes: dict[str, list[str]] = {}
    for contract in contracts:
        if contract["name"].startswith("home of "):
            for line in contract["ignore_imports"]:
                module, library = line.split(" -> ")
                places, home = homes.setdefault(library, []), module.rstrip(".*")
                if home not in places:
                    places.append(home)
    return homes


def _layers(contracts: list[dict[str, Any]], container: str) -> list[str]:
    for contract in contracts:
        if contract.get("containers") == [container]:
            layers: list[str] = contract["layers"]
            return layers
    raise LookupError(f"no contract of layers in {container}")


def _folder(package: str) -> Path:
    return ROOT.joinpath(*package.split("."))


def _row(package: str) -> str:
    """A module or package with the first sentence of its docstring."""
    folder = _folder(package)
    source = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    words = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
    return f"| `{package}` | {' '.join(words.split(chr(10) * 2)[0].split())} |"
