"""Code of plug-ins: found by name, identified by a digest, reloaded where a file was edited.

A name is an import path, `package.module:callable`, found in the working directory too; that of an
entry point which an installed package declares in the group `aerofed.plugins`; or that of an
object which was passed from Python, `python:callable_DIGEST`. `LABEL=` before it is its label in
tables and pictures.
"""

import hashlib
import importlib
import importlib.util
import re
import sys
import sysconfig
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from native.errors import did_you_mean

IMPORT_PATH = r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*"
LABELLED = r"^[\w .+-]{1,40}="
GROUP = "aerofed.plugins"
PASSED = "python"  # in the place of a module, in the name of an object that was passed

_IMPORT = re.compile(r"(?m)(?:^|[:;])\s*(?:from\s+([.\w]+)\s+)?import\s+(\([^)]*\)|[^\n#;]+)")
_OURS = {"__main__", "aerofed", "fl", "flightdyn", "mission", "native", "sitl"}
# Of one process only, in a pickle: numbers that cloudpickle draws, and that of a notebook.
_DRAWN = re.compile(r"[0-9a-f]{32}|ipykernel_\d+")

_imported: dict[str, str] = {}  # files and digests of modules as they were imported
_searched: set[str] = set()  # the working directory, where it stands in sys.path for plug-ins
_passed: dict[str, "PassedObject"] = {}


@dataclass(frozen=True)
class PassedObject:
    """A plug-in that was passed as a Python object and has no import path."""

    value: object
    digest: str | None  # SHA-256 of its pickle and of the modules that it uses; None: it has none


def is_import_path(text: str) -> bool:
    """Whether the text has the form of an import path, `package.module:callable`."""
    return re.fullmatch(IMPORT_PATH, text) is not None


def is_plugin(name: str) -> bool:
    """Whether the name is an import path or that of an installed entry point."""
    bare = _bare(name)
    return is_import_path(bare) or bare in _entry_points()


def label_of(name: str) -> str:
    """Return what tables and pictures call a plug-in or a built-in: its LABEL, or else its name."""
    return name.partition("=")[0]


def _bare(name: str) -> str:
    return re.sub(LABELLED, "", name)


def checked_name(name: str, built_in: tuple[str, ...]) -> str:
    """Return the name if it is built in or a plug-in's.

    Raises:
        ValueError: it is neither; the message lists the names.
    """
    if name in built_in or is_plugin(name):
        return name
    names = (*built_in, *_entry_points())
    ours = f"one of {', '.join(map(repr, names))} or the" if names else "an"
    raise ValueError(
        f"must be {ours} import path of your own, 'package.module:callable'"
        f"{did_you_mean(name, names)}"
    )


def check_found(name: str) -> None:
    """Look a plug-in up; its module is not imported, only the packages around it are.

    Raises:
        ImportError: it is not there.
        BaseException: whatever the packages around it raise.
    """
    module = module_of(name)
    if module == PASSED:
        _passed_as(name)
    elif not importlib.util.find_spec(module):
        raise ModuleNotFoundError(f"No module named {module!r}")


def module_of(name: str) -> str:
    """Return the name of a plug-in's module; puts the working directory last in `sys.path`."""
    here = str(Path.cwd())
    for there in _searched - {here}:  # a session has moved on: the same name is another's there
        with suppress(ValueError):
            sys.path.remove(there)
        _searched.remove(there)
    if here not in sys.path:
        sys.path.append(here)  # after all others
        _searched.add(here)
    return _path(name).partition(":")[0]


def load(name: str) -> object:
    """Import and return the plug-in of that name, reloaded where its code has changed.

    A module is reloaded where it, or one that it imports from beside its outermost package, has
    changed, or where it was imported elsewhere first: what its file held then is unknown.

    Raises:
        BaseException: whatever importing it raises.
    """
    module = module_of(name)
    if module == PASSED:
        return _passed_as(name).value
    for each, (file, _) in _sources(module).items():
        now = f"{file} {_digest(_sources(each))}"
        if _imported.get(each) != now:
            sys.modules.pop(each, None)
            with suppress(OSError, NotImplementedError):
                # Python tells it from newer text by size and whole seconds.
                Path(importlib.util.cache_from_source(str(file))).unlink()
            _imported[each] = now
    importlib.invalidate_caches()
    return getattr(importlib.import_module(module), _path(name).partition(":")[2])


def digest_of(name: str) -> str | None:
    """Return the SHA-256 of a plug-in's module and of what it imports from the folder that holds
    its outermost package; of name and version of an installed package.

    None for an object passed from Python that cannot be pickled, or is not known to this process.
    """
    module = module_of(name)
    if module == PASSED:
        return _passed[bare].digest if (bare := _bare(name)) in _passed else None
    sources = _sources(module)
    if sources:
        return _digest(sources)
    package = module.partition(".")[0]
    return hashlib.sha256(f"{package} {_versions_of(package)}".encode()).hexdigest()


def register(value: object) -> object:
    """Register a plug-in that is passed as an object; return the name by which `load` finds it.

    A function or class of a module is named by its import path, so that it is loaded from its file.
    Values that are not callable are returned as they are.
    """
    if not callable(value):
        return value
    module, qualified = (str(getattr(value, key, "")) for key in ("__module__", "__qualname__"))
    path = f"{module}:{qualified}"
    if is_import_path(path) and module != "__main__":
        known = getattr(sys.modules.get(module), qualified, None)
        # Imported anew, it is another object; wrapped by somebody else, it is other code.
        alike = callable(known) and _wrappings(known) == _wrappings(value)
        if known is value or (alike and module in _imported):
            return path
    inner = getattr(value, "func", value)  # of a functools.partial
    label = re.sub(r"\W", "", getattr(inner, "__name__", type(value).__name__))
    digest = _digest_of_object(value)
    name = f"{PASSED}:{label}_{digest[:8] if digest else len(_passed)}"
    _passed[name] = PassedObject(value, digest)
    return name


def _wrappings(value: object) -> int:
    """Number of wrappers around a function, counted by `__wrapped__`."""
    count = 0
    while (value := getattr(value, "__wrapped__", None)) is not None:
        count += 1
    return count


def passed(names: Iterable[str]) -> dict[str, PassedObject]:
    """Return by name the plug-ins passed from Python, for other processes to `bring`."""
    return {name: _passed[name] for name in map(_bare, names) if name in _passed}


def bring(objects: Mapping[str, PassedObject]) -> None:
    """Register plug-ins that were passed to another process, so that `load` finds them here."""
    _passed.update(objects)


def _passed_as(name: str) -> PassedObject:
    if (bare := _bare(name)) not in _passed:
        raise ImportError("it was passed from Python, in a process that has ended; pass it again")
    return _passed[bare]


def _digest_of_object(value: object) -> str | None:
    """SHA-256 of an object's pickle and of the modules that it uses; None: it has no pickle."""
    # Imported here: few runs need them.
    import pickletools

    import cloudpickle

    try:
        operations = [*pickletools.genops(cloudpickle.dumps(value))]
    except Exception:  # of any kind: methods of the object are asked
        return None
    parts = [f"{operation.name} {argument!r}" for operation, argument, _ in operations]
    used = {argument for _, argument, _ in operations if isinstance(argument, str)}
    every = map(_sources, sorted(used & sys.modules.keys()))
    parts += [_digest(sources) for sources in every if sources]
    return hashlib.sha256(_DRAWN.sub("", "\n".join(parts)).encode("utf-8", "replace")).hexdigest()


def _sources(module: str) -> dict[str, tuple[Path, bytes]]:
    """Return file and text, by name, of a module and what it imports from beside its package.

    Empty for a module without a file, and for an installed package, which nobody edits.
    """
    root, todo = _root(module), [module]
    found: dict[str, tuple[Path, bytes]] = {}
    while todo and root is not None and not _is_installed(root):
        name = todo.pop()
        if name in found or name.partition(".")[0] in _OURS:
            continue
        path = root.joinpath(*name.split("."))
        for file in (path / "__init__.py", path.with_name(f"{path.name}.py")):
            if file.is_file():
                found[name] = file, file.read_bytes()
                todo += _imports(name, *found[name])
                break
    return found


def _imports(name: str, file: Path, text: bytes) -> list[str]:
    """Names that a module may import: its package, and of `from a import b` both `a` and `a.b`."""
    outer = name.rpartition(".")[0]
    classes = [outer] if outer else []
    for base, listed in _IMPORT.findall(text.decode(errors="replace")):
        names = re.findall(r"[\w.]+", listed)
        with suppress(ImportError):  # beyond the outermost package, which importing it says
            package = name if file.name == "__init__.py" else outer
            base = base and importlib.util.resolve_name(base, package)
            classes += [base, *(f"{base}.{one}" for one in names)] if base else names
    return classes


def _digest(sources: Mapping[str, tuple[Path, bytes]]) -> str:
    digest = hashlib.sha256()
    for name, (_, text) in sorted(sources.items()):
        digest.update(f"{name} {len(text)} ".encode() + text)
    return digest.hexdigest()


def _root(module: str) -> Path | None:
    """The folder that a module's outermost package lies in; None where it has no file."""
    if module == "__main__":
        return None
    # As Python looks for what is not imported yet: the module of that name may be another folder's.
    found = (finder.find_spec(module.partition(".")[0], None) for finder in sys.meta_path)
    spec = next(filter(None, found), None)
    places = [*(spec.submodule_search_locations or ())] if spec else []
    place = places[0] if places else spec.origin if spec and spec.has_location else None
    return Path(place).parent if place else None


@cache
def _versions_of(package: str) -> str:
    """Names and versions of the distributions that provide a package; else Python's version."""
    import importlib.metadata  # with email in it, for which no `--help` waits

    names = importlib.metadata.packages_distributions().get(package, ())
    versions = {f"{name} {importlib.metadata.version(name)}" for name in names}
    return " ".join(sorted(versions)) or sys.version


@cache
def _is_installed(path: Path) -> bool:
    installed = {"site-packages", "dist-packages"} & {*path.parts}
    return bool(installed) or path.is_relative_to(sysconfig.get_path("stdlib"))


def _path(name: str) -> str:
    bare = _bare(name)
    return bare if is_import_path(bare) else _entry_points().get(bare, bare)


def _entry_points() -> dict[str, str]:
    """Import paths by the name of the entry point."""
    import importlib.metadata  # with email in it, for which no `--help` waits

    return {item.name: item.value for item in importlib.metadata.entry_points(group=GROUP)}
