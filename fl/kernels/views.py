"""Arrays within compiled code as no more than where they begin and how long their axes are.

Numba's own arrays are seven to eleven numbers each, are handed to every function one by one,
counted in and out of every use, and may be indexed from behind: ten times as much code to compile
for the same loads and stores. A view owns nothing: the array that it was made of is kept by the
caller of the kernel. `view[i, j]` reads and writes one number, `view[i]` of a table is the view of
a row. Indices count from 0; like numba's they are not checked.
"""

import operator
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.errors import TypingError
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_global,
    signature,
)
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_builtin,
    lower_getattr,
    register_model,
)
from numpy.typing import NDArray

T = TypeVar("T")
D = TypeVar("D", bound=np.generic)


class _View(types.Type):  # type: ignore[misc]  # numba has no type information
    """A view, to numba's type inference."""

    def __init__(self, dtype: Any, ndim: int) -> None:
        self.dtype, self.ndim = dtype, ndim
        super().__init__(name=f"View({dtype}, {ndim})")

    @property
    def key(self) -> tuple[Any, int]:
        return self.dtype, self.ndim


@register_model(_View)
class _Model(models.StructModel):  # type: ignore[misc]
    """A view, to LLVM."""

    def __init__(self, manager: Any, kind: _View) -> None:
        shape = types.UniTuple(types.intp, kind.ndim)
        super().__init__(manager, kind, [("data", types.CPointer(kind.dtype)), ("shape", shape)])


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):  # type: ignore[misc]
    metadata = {"target": "cpu"}  # noqa: RUF012  # asked before those of all targets

    def generic(self, args: Any, _: Any) -> Any:
        view, index = args
        if not isinstance(view, _View):
            return None
        left = view.ndim - (1 if isinstance(index, types.Integer) else len(index))
        return signature(_View(view.dtype, left) if left else view.dtype, view, index)


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):  # type: ignore[misc]
    metadata = {"target": "cpu"}  # noqa: RUF012

    def generic(self, args: Any, _: Any) -> Any:
        view, index = args[:2]
        return signature(types.none, view, index, view.dtype) if isinstance(view, _View) else None


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    key = _View

    def resolve_shape(self, view: _View) -> Any:
        return types.UniTuple(types.intp, view.ndim)


@lower_getattr(_View, "shape")  # type: ignore[untyped-decorator]
def _shape(_: Any, builder: Any, __: Any, view: Any) -> Any:
    return builder.extract_value(view, 1)


def address(context: Any, builder: Any, signature: Any, args: Any) -> tuple[Any, list[Any]]:
    """LLVM's pointer to `view[index]`, the first two arguments, and the axes left out in it."""
    (kind, index_kind), (view, index) = signature.args[:2], args[:2]
    data, axes = (builder.extract_value(view, i) for i in range(2))
    axes = cgutils.unpack_tuple(builder, axes, kind.ndim)
    single = isinstance(index_kind, types.Integer)
    parts = [index] if single else cgutils.unpack_tuple(builder, index)
    kinds = [index_kind] if single else index_kind
    offset = context.get_constant(types.intp, 0)
    for axis, length in enumerate(axes):
        offset = builder.mul(offset, length) if axis else offset
        if axis < len(parts):
            part = context.cast(builder, parts[axis], kinds[axis], types.intp)
            offset = builder.add(offset, part)
    return builder.gep(data, [offset]), axes[len(parts) :]


def _make(context: Any, builder: Any, kind: _View, data: Any, axes: list[Any]) -> Any:
    view = cgutils.create_struct_proxy(kind)(context, builder)
    view.data, view.shape = data, cgutils.pack_array(builder, axes)
    return view._getvalue()


@lower_builtin(operator.getitem, _View, types.Integer)  # type: ignore[untyped-decorator]
@lower_builtin(operator.getitem, _View, types.BaseTuple)  # type: ignore[untyped-decorator]
def _getitem(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    data, axes = address(context, builder, signature, args)
    if axes:
        return _make(context, builder, signature.return_type, data, axes)
    return context.unpack_value(builder, signature.return_type, data)


@lower_builtin(operator.setitem, _View, types.Integer, types.Any)  # type: ignore[untyped-decorator]
@lower_builtin(operator.setitem, _View, types.BaseTuple, types.Any)  # type: ignore[untyped-decorator]
def _setitem(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    data, _ = address(context, builder, signature, args)
    context.pack_value(builder, signature.args[2], args[2], data)
    return context.get_dummy_value()


def _kind(arrays: Any) -> Any:
    """The type of what `views` makes of a type."""
    if isinstance(arrays, types.Array):
        if arrays.layout != "C":
            raise TypingError(f"a kernel takes contiguous arrays, not {arrays}")
        return _View(arrays.dtype, arrays.ndim)
    if isinstance(arrays, types.BaseTuple):
        parts = [_kind(part) for part in arrays]
        return types.BaseTuple.from_types(parts, getattr(arrays, "instance_class", None))
    return arrays


def _views(_: Any, arrays: Any) -> Any:
    def convert(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            axes = cgutils.unpack_tuple(builder, array.shape, kind.ndim)
            return _make(context, builder, _kind(kind), array.data, axes)
        if isinstance(kind, types.BaseTuple):
            parts = zip(kind, cgutils.unpack_tuple(builder, value), strict=True)
            made = [convert(context, builder, *part) for part in parts]
            return context.make_tuple(builder, _kind(kind), made)
        return value

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return convert(context, builder, signature.args[0], args[0])

    return _kind(arrays)(arrays), build


def _part(_: Any, view: Any, start: Any, shape: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data, _ = address(context, builder, signature, args)
        axes = cgutils.unpack_tuple(builder, args[2])
        kinds = signature.args[2]
        axes = [context.cast(builder, *pair, types.intp) for pair in zip(axes, kinds, strict=True)]
        return _make(context, builder, signature.return_type, data, axes)

    return _View(view.dtype, len(shape))(view, start, shape), build


part: Callable[[NDArray[D], int, tuple[int, ...]], NDArray[D]] = intrinsic(_part)
"""The numbers from `view[start]` on, as a view of that shape."""

views: Callable[[T], T] = intrinsic(_views)
"""An array as a view; a tuple of arrays, numbers and tuples with views in place of its arrays."""
