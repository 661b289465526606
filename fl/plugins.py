"""Plug-ins, code of a researcher's own: called under guard, its answers checked.

Each place for such code is a subclass of `PlugIn`, which says by which setting it is named and what
it must have. `fl.plugin_code` finds it.
"""

import importlib.util
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, field, fields
from types import ModuleType
from typing import Any, ClassVar, NoReturn, Self, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from fl.arrays import frozen
from fl.plugin_code import check_found, load, module_of
from native.errors import AerofedError, UsersCodeError, did_you_mean, first_line, kind_of

Kind = TypeVar("Kind")
_COPIED_BYTES = 1 << 24


def problem_of(name: str) -> str | None:
    """Return why a plug-in is not found, or None; imports the packages around its module only."""
    try:
        check_found(name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return _not_imported(error)
    return None


@contextmanager
def failures_as(
    make: Callable[[BaseException], Exception], *, but: type[BaseException] = KeyboardInterrupt
) -> Iterator[None]:
    """Context manager: raise `make(error)` for any exception in the block, SystemExit too;
    KeyboardInterrupt and `but` pass unchanged."""
    try:
        yield
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt | but):
            raise
        raise make(error) from error


def needs_torch() -> str | None:
    """Return how to install torch, an extra; None where it is installed."""
    if importlib.util.find_spec("torch"):
        return None
    return "needs torch, which is an extra and not installed: pip install 'aerofed[torch]'"


@dataclass(frozen=True)
class PlugIn:
    """A researcher's own function or object at one extension point; each point has a subclass.

    Its arguments are read-only. What it raises, and answers that break a rule, become one line with
    the setting and the name: an `error`, whose `__cause__` is what it raised.
    """

    setting: ClassVar[str]  # that names it
    members: ClassVar[tuple[str, ...]] = ()  # of what its factory makes; none: it is a function
    error: ClassVar[type[Exception]] = UsersCodeError

    name: str
    inner: Any = field(repr=False)
    community: int | None = field(default=None, repr=False, compare=False)  # whose, from 0

    @property
    def key(self) -> str:
        """Full key of the setting in the configuration, such as `communities.0.network`."""
        if self.community is None:
            return self.setting
        return self.setting.replace("communities.", f"communities.{self.community}.")

    @classmethod
    def found(cls, name: str, community: int | None = None) -> Self:
        """Load the function of that name.

        Raises:
            error: it cannot be imported, or cannot be called.
        """
        plugin = cls(name, None, community)
        with failures_as(lambda error: plugin._error(_not_imported(error))):
            inner = load(name)
        if not callable(inner):
            plugin.refuse(f"is {kind_of(inner)}, not callable")
        return cls(name, inner, community)

    @classmethod
    def made(cls, name: str, *arguments: object) -> Self:
        """Load the factory of that name, and call it with read-only `arguments`.

        Raises:
            error: it cannot be imported or called, or makes something without the `members`.
        """
        factory = cls.found(name)
        with failures_as(lambda error: factory._told("calling it fails", error)):
            inner = factory.inner(*map(read_only, arguments))
        missing = [member for member in cls.members if not hasattr(inner, member)]
        if missing:
            factory.refuse(
                f"gives {kind_of(inner)} without {', '.join(missing)}; needed: "
                f"{', '.join(cls.members)}"
            )
        return cls(name, inner)

    def ask(self, member: str, *arguments: object, of: str = "") -> Any:
        """Call a method with read-only arguments; `of` says in errors which call it is."""
        with self.guarded(f"{member}(){of}"):
            return getattr(self.inner, member)(*map(read_only, arguments))

    def value(self, member: str) -> Any:
        """Return the value of an attribute of the plug-in's object."""
        with self.guarded(member):
            return getattr(self.inner, member)

    def array(
        self,
        found: object,
        what: str,
        *,
        shape: tuple[int, ...] | None = None,
        low: float = -np.inf,
        high: float = np.inf,
        dtype: DTypeLike = np.float64,
    ) -> NDArray[Any]:
        """Return the plug-in's numbers as a checked, read-only copy; `what` names them in errors.

        Raises:
            error: another shape, or a number that is not finite, or not from `low` to `high`.
        """
        with self.guarded(what):
            made: NDArray[Any] = np.array(found)
            if np.iscomplexobj(made):
                self.refuse(f"{what} is complex: must be real numbers")
            made = made.astype(dtype)
        if shape is not None and made.shape != shape:
            self.refuse(f"{what} is of shape {made.shape}, not {shape}")
        wrong = ~(np.isfinite(made) & (made >= low) & (made <= high))
        if wrong.any():
            at = tuple(np.argwhere(wrong)[0].tolist())
            value = f"is {made[at]}" if made.ndim == 0 else f"holds {made[at]} at {list(at)}"
            bounds = "finite" if low == -np.inf else f"finite and {low:g} or more"
            bounds = bounds if high == np.inf else f"from {low:g} to {high:g}"
            self.refuse(f"{what} {value}: must be {bounds}")
        return frozen(made)

    def of_kind(self, found: object, kind: type[Kind], what: str) -> Kind:
        """Return what the plug-in gave, checked to be of type `kind`.

        Raises:
            error: it is of another type.
        """
        if not isinstance(found, kind):
            self.refuse(f"{what} gives {kind_of(found)}, not a {kind.__name__}")
        return found

    @contextmanager
    def guarded(self, doing: str) -> Iterator[None]:
        """Context manager: run the plug-in's code in the block; `doing` names it in errors.

        Raises:
            error: the code raised; one line with the place in its file.
        """
        with failures_as(lambda error: self._told(doing, error), but=AerofedError):
            yield

    def refuse(self, reason: str) -> NoReturn:
        """Raise `error`: the plug-in breaks a rule, as `reason` says."""
        raise self._error(reason)

    def _told(self, doing: str, error: BaseException) -> Exception:
        return self._error(f"{doing}: {first_line(error)}{self._place(error)}")

    def _error(self, reason: str) -> Exception:
        return self.error(f"{self.key} = {self.name!r}: {reason}")

    def _place(self, error: BaseException) -> str:
        """Where in its module an error was raised, or else in any code that is not ours."""
        module = sys.modules.get(module_of(self.name))
        file = getattr(module, "__file__", None)
        frames = [
            (frame.f_code.co_filename, line, str(frame.f_globals.get("__name__")).partition(".")[0])
            for frame, line in traceback.walk_tb(error.__traceback__)
        ]
        own = [frame for frame in frames if frame[0] == file]
        # The first is the one who asked: where nothing but its package failed, no place helps.
        others = [frame for frame in frames if frame[2] != frames[0][2]]
        return "".join(f" ({name}, line {line})" for name, line, _ in (own or others)[-1:])


def read_only(value: Any) -> Any:
    """Return the value with read-only arrays, also within lists, tuples, mappings and frozen
    dataclasses, which are copied where necessary."""
    if isinstance(value, np.ndarray):
        # torch, say, writes to an array whatever its flags: to a copy, where that costs little.
        return frozen(value.copy("K") if value.nbytes <= _COPIED_BYTES else value.view())
    if type(value) in (list, tuple):
        return type(value)(map(read_only, value))
    if isinstance(value, Mapping):
        return {key: read_only(item) for key, item in value.items()}
    params = getattr(type(value), "__dataclass_params__", None)
    if params is None or not params.frozen or isinstance(value, PlugIn):
        return value
    kept = getattr(value, "__dict__", {})  # with what it has worked out before
    now = {item.name: getattr(value, item.name) for item in fields(value)} | kept
    other = {name: read_only(item) for name, item in now.items()}
    changed = {name: item for name, item in other.items() if item is not now[name]}
    copied = copy(value) if changed else value
    for name, item in changed.items():
        object.__setattr__(copied, name, item)
    return copied


def _not_imported(error: BaseException) -> str:
    if getattr(error, "name", None) == "torch" and (reason := needs_torch()):
        return reason
    more = ""
    if isinstance(error, ModuleNotFoundError):
        more = "; looked for in the working directory, in PYTHONPATH and among what is installed"
    elif isinstance(error, AttributeError) and isinstance(error.obj, ModuleType):
        more = did_you_mean(str(error.name), vars(error.obj))
    return f"cannot be imported: {first_line(error)}{more}"
