"""One number of each of 16 images, side by side in a vector register.

Every image of a batch goes through the same network with the same weights, so that a vector of
one feature of 16 images needs no shuffling anywhere: a weight times such a vector is one
instruction. LLVM splits the vector where registers are shorter. All operations round the same
on every processor.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model
from numpy.typing import NDArray

from fl.kernels.views import address

Floats = NDArray[np.float32]
Lanes = Any  # a vector, within compiled code
Index = tuple[int, ...]

WIDTH = 16

_FLOAT = ir.FloatType()
_INT = ir.IntType(32)
_VECTOR = ir.VectorType(_FLOAT, WIDTH)


class _LanesType(types.Type):  # type: ignore[misc]  # numba has no type information
    """The vector, to numba's type inference."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{WIDTH}")


class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    """The vector, to LLVM."""

    def __init__(self, manager: Any, kind: _LanesType) -> None:
        super().__init__(manager, kind, _VECTOR)


_LANES = _LanesType()
register_model(_LanesType)(_LanesModel)


def _load(_: Any, view: Any, index: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer, _ = address(context, builder, signature, args)
        value = builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()))
        value.align = 4
        return value

    return _LANES(view, index), build


def _store(_: Any, view: Any, index: Any, value: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer, _ = address(context, builder, signature, args)
        builder.store(args[2], builder.bitcast(pointer, _VECTOR.as_pointer())).align = 4
        return context.get_dummy_value()

    return types.void(view, index, value), build


def _splat(_: Any, value: Any) -> Any:  # noqa: ARG001  # its kind is always float32
    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        one = builder.insert_element(undefined, args[0], _INT(0))
        zeros = ir.Constant(ir.VectorType(_INT, WIDTH), [0] * WIDTH)
        return builder.shuffle_vector(one, undefined, zeros)

    return _LANES(types.float32), build


def _multiply_add(_: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001  # all of a kind
    number = _LANES if a is _LANES else types.float32
    of, name = (_VECTOR, f"v{WIDTH}f32") if a is _LANES else (_FLOAT, "f32")

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(of, [of] * 3), f"llvm.fma.{name}"
        )
        return builder.call(function, args)

    return number(number, number, number), build


def _choose(sign: str) -> Callable[..., Any]:
    def typed(_: Any, a: Any, b: Any, yes: Any, no: Any) -> Any:  # noqa: ARG001
        def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
            return builder.select(builder.fcmp_ordered(sign, args[0], args[1]), args[2], args[3])

        return _LANES(_LANES, _LANES, _LANES, _LANES), build

    return typed


def _total(_: Any, value: Any) -> Any:  # noqa: ARG001
    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        rest, width = args[0], WIDTH
        while width > 1:
            width //= 2
            undefined, of = ir.Constant(rest.type, ir.Undefined), ir.VectorType(_INT, width)
            low = builder.shuffle_vector(rest, undefined, ir.Constant(of, list(range(width))))
            high = ir.Constant(of, list(range(width, 2 * width)))
            rest = builder.fadd(low, builder.shuffle_vector(rest, undefined, high))
        return builder.extract_element(rest, _INT(0))

    return types.float32(_LANES), build


load: Callable[[Floats, Index], Lanes] = intrinsic(_load)
"""The lanes at `view[index]`, whose last axis is `WIDTH` long."""

store: Callable[[Floats, Index, Lanes], None] = intrinsic(_store)
"""Put them there."""

splat: Callable[[np.float32], Lanes] = intrinsic(_splat)
"""One number in all lanes."""

multiply_add: Callable[[Any, Any, Any], Any] = intrinsic(_multiply_add)
"""a b + c rounded once, of lanes or of float32 numbers."""

if_greater: Callable[[Lanes, Lanes, Lanes, Lanes], Lanes] = intrinsic(_choose(">"))
"""In each lane, the third where the first is greater than the second, else the fourth."""

if_equal: Callable[[Lanes, Lanes, Lanes, Lanes], Lanes] = intrinsic(_choose("=="))
"""The same where they are equal."""

total: Callable[[Lanes], np.float32] = intrinsic(_total)
"""The sum over the lanes, in pairs."""
