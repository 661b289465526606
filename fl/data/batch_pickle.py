"""A pickled CIFAR-10 batch, read by a machine that calls nothing.

A pickle is a program. Python's own unpickler, told which names it may look up, still builds real
objects from what the file says, and a crafted `numpy.dtype` turns bytes into pointers. The machine
below knows the two dozen instructions that batches consist of, from Python 2's cPickle to
protocol 4, and only these values: None, truths, integers, texts, bytes, lists, tuples, tables with
texts for keys, and three stand-ins for what a batch names of numpy. A stand-in becomes an array of
uint8 or nothing.
"""

import pickletools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MULTIARRAY = ("numpy.core.multiarray", "numpy._core.multiarray")
_NAMES = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    *((module, "_reconstruct") for module in _MULTIARRAY),
}


class BatchPickleError(ValueError):
    """A pickle that is damaged, or holds what has no place in a batch."""


@dataclass(frozen=True, slots=True)
class _Name:
    """Something of numpy's that the pickle names; it is never looked up."""

    name: str


@dataclass(frozen=True, slots=True)
class _DataType:
    code: str


@dataclass(slots=True)
class _Array:
    """An array before and after its state has arrived."""

    content: NDArray[np.generic] | None = None


def load_batch(content: bytes) -> dict[str, object]:
    """The table in a pickled batch; arrays in it are of uint8 or of no use.

    Raises:
        BatchPickleError: anything else.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of odd escapes, which are the file's
            found = _Machine().run(content)
    except BatchPickleError:
        raise
    # What pickletools and a stack that runs empty raise on damage.
    except (ValueError, LookupError, TypeError, OverflowError, MemoryError) as error:
        raise BatchPickleError(f"damaged pickle ({type(error).__name__})") from error
    if not isinstance(found, dict):
        raise BatchPickleError("it holds no table")
    return {k: v.content if isinstance(v, _Array) else v for k, v in found.items()}


class _Machine:
    """One run over the instructions of a pickle."""

    def __init__(self) -> None:
        self._stack: list[object] = []
        self._below: list[list[object]] = []  # the stacks under the marks
        self._memo: dict[int, object] = {}

    def run(self, content: bytes) -> object:
        for opcode, argument, _ in pickletools.genops(content):
            name = opcode.name
            if name == "STOP":
                return self._stack.pop()
            if name in _CONSTANTS:
                self._stack.append(_CONSTANTS[name]())
            elif name in _LITERALS:
                self._stack.append(argument)
            elif name not in _IGNORED:
                step = _STEPS.get(name)
                if step is None:
                    raise BatchPickleError(f"the instruction {name} has no place in a batch")
                step(self, argument)
        raise BatchPickleError("damaged pickle (no end)")

    def _marked(self) -> list[object]:
        """Everything above the last mark, taken off together with it."""
        values, self._stack = self._stack, self._below.pop()
        return values

    def mark(self, _: object) -> None:
        self._below.append(self._stack)
        self._stack = []

    def _take(self, count: int) -> list[object]:
        if len(self._stack) < count:
            raise IndexError
        values = self._stack[-count:]
        del self._stack[-count:]
        return values

    def put(self, number: int) -> None:
        self._memo[number] = self._stack[-1]

    def memoize(self, _: object) -> None:
        self._memo[len(self._memo)] = self._stack[-1]

    def get(self, number: int) -> None:
        self._stack.append(self._memo[number])

    def tuple_of(self, count: int | None) -> None:
        values = self._marked() if count is None else self._take(count)
        self._stack.append(tuple(values))

    def list_of(self, _: object) -> None:
        values = self._marked()
        self._stack.append(values)

    def append(self, _: object) -> None:
        (value,) = self._take(1)
        self._extend([value])

    def appends(self, _: object) -> None:
        self._extend(self._marked())

    def _extend(self, values: list[object]) -> None:
        target = self._stack[-1]
        if not isinstance(target, list):
            raise BatchPickleError("damaged pickle (no list)")
        target.extend(values)

    def dict_of(self, _: object) -> None:
        values = self._marked()
        self._stack.append({})
        self._update(values)

    def setitem(self, _: object) -> None:
        self._update(self._take(2))

    def setitems(self, _: object) -> None:
        self._update(self._marked())

    def _update(self, values: list[object]) -> None:
        target = self._stack[-1]
        if not isinstance(target, dict):
            raise BatchPickleError("damaged pickle (no table)")
        for key, value in zip(values[::2], values[1::2], strict=True):
            if isinstance(key, bytes):
                key = key.decode("latin-1")
            if not isinstance(key, str):
                raise BatchPickleError("damaged pickle (a key that is no text)")
            target[key] = value

    def name(self, argument: str) -> None:
        module, _, name = argument.partition(" ")
        self._look_up(module, name)

    def stack_name(self, _: object) -> None:
        module, name = self._take(2)
        self._look_up(module, name)

    def _look_up(self, module: object, name: object) -> None:
        if not (isinstance(module, str) and isinstance(name, str)):
            raise BatchPickleError("damaged pickle (a name that is no text)")
        if (module, name) == ("_codecs", "encode"):  # bytes, as Python 3 writes them for Python 2
            self._stack.append(_Name("encode"))
        elif (module, name) in _NAMES:
            self._stack.append(_Name(name))
        else:
            raise BatchPickleError(f"{module[:60]}.{name[:60]} has no place in a batch")

    def call(self, _: object) -> None:
        function, arguments = self._take(2)
        match function, arguments:
            case _Name("_reconstruct"), (_Name("ndarray"), (0,), _):
                self._stack.append(_Array())
            case _Name("dtype"), (str(code), _, _):
                self._stack.append(_DataType(code))
            case _Name("encode"), (str(text), "latin1"):
                self._stack.append(text.encode("latin-1"))
            case _:
                raise BatchPickleError("a call that has no place in a batch")

    def build(self, _: object) -> None:
        target, state = self._take(2)
        match target, state:
            case _DataType(), tuple():
                pass  # byte order and layout: nothing that bytes have
            case _Array(None), (
                int(),
                tuple(shape),
                _DataType("u1"),
                False,
                str() | bytes() as raw,
            ):
                target.content = _bytes(shape, raw)
            case _Array(None), (int(), tuple(), _DataType(), _, _):
                pass  # of another type, or Fortran's order: no array of bytes
            case _:
                raise BatchPickleError("a state that has no place in a batch")
        self._stack.append(target)


def _bytes(shape: tuple[int, ...], raw: str | bytes) -> NDArray[np.uint8]:
    content = raw.encode("latin-1") if isinstance(raw, str) else raw
    if not (len(shape) <= 4 and all(type(n) is int and 0 <= n <= len(content) for n in shape)):
        raise BatchPickleError("an array of more values than bytes")
    if int(np.prod(shape, dtype=object)) != len(content):
        raise BatchPickleError(f"an array of shape {shape} in {len(content)} bytes")
    return np.frombuffer(content, np.uint8).reshape(shape)


_IGNORED = {"PROTO", "FRAME"}
_CONSTANTS: dict[str, Callable[[], object]] = {
    "NONE": lambda: None,
    "NEWTRUE": lambda: True,
    "NEWFALSE": lambda: False,
    "EMPTY_DICT": dict,
    "EMPTY_LIST": list,
    "EMPTY_TUPLE": tuple,
}
_LITERALS = {
    *("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4"),
    *("STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE"),
    *("BINBYTES", "SHORT_BINBYTES"),
}
_STEPS: dict[str, Callable[[_Machine, Any], None]] = {
    "MARK": _Machine.mark,
    "PUT": _Machine.put,
    "BINPUT": _Machine.put,
    "LONG_BINPUT": _Machine.put,
    "MEMOIZE": _Machine.memoize,
    "GET": _Machine.get,
    "BINGET": _Machine.get,
    "LONG_BINGET": _Machine.get,
    "TUPLE": lambda machine, _: machine.tuple_of(None),
    "TUPLE1": lambda machine, _: machine.tuple_of(1),
    "TUPLE2": lambda machine, _: machine.tuple_of(2),
    "TUPLE3": lambda machine, _: machine.tuple_of(3),
    "LIST": _Machine.list_of,
    "APPEND": _Machine.append,
    "APPENDS": _Machine.appends,
    "DICT": _Machine.dict_of,
    "SETITEM": _Machine.setitem,
    "SETITEMS": _Machine.setitems,
    "GLOBAL": _Machine.name,
    "STACK_GLOBAL": _Machine.stack_name,
    "REDUCE": _Machine.call,
    "BUILD": _Machine.build,
}
