"""Eight numbers side by side: a type of numba's for kernels that do the same sum for eight of a kind at once.

`Lanes` are eight doubles, which LLVM puts into registers as wide as the processor has them. They know + - * / and
comparisons, among themselves and with plain numbers; a comparison is a `Mask` of eight, for `where`. Every lane is
computed as a number alone would be: not a bit depends on how wide the registers are.

`columns` reads four neighbouring columns of eight rows that may lie anywhere in a table, and `put_columns` writes them:
eight short reads and a transposition in registers, where an index for each number would cost several times as much. No
two rows that are written may be the same one, unless the same is written there.

Functions that also serve for one item alone are taken side by side by the compiler instead (`geometry.lane_functions`).
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import models, register_model

LANES = 8
WIDE = 4  # columns of a table that are read at once
_DOUBLE = ir.DoubleType()
_EIGHT, _FOUR = ir.VectorType(_DOUBLE, LANES), ir.VectorType(_DOUBLE, WIDE)
_CONTRACT = ("contract",)  # as the kernels have it


class Lanes(types.Type):
    """Eight doubles."""

    def __init__(self) -> None:
        super().__init__("Lanes")


class Mask(types.Type):
    """Eight truths."""

    def __init__(self) -> None:
        super().__init__("Mask")


lanes, mask = Lanes(), Mask()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _EIGHT)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), LANES))


def _chosen(builder: Any, one: Any, other: Any, places: list[int]) -> Any:
    """Some numbers of two vectors, counted through both."""
    return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places))


def _wide(builder: Any, value: Any) -> Any:
    """Eight of a number; lanes as they are."""
    if value.type == _EIGHT:
        return value
    first = builder.insert_element(ir.Constant(_EIGHT, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return _chosen(builder, first, first, [0] * LANES)


def _install(operation: Callable, result: types.Type, code: Callable) -> None:
    """Teach numba an operation on lanes, and on lanes and numbers."""
    kinds = ((lanes, lanes), (lanes, types.float64), (types.float64, lanes))

    class Template(ConcreteTemplate):
        cases = [signature(result, *kind) for kind in kinds]

    infer_global(operation)(Template)

    def lowered(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        return code(builder, *(_wide(builder, value) for value in values))

    for kind in kinds:
        lower_builtin(operation, *kind)(lowered)


_install(operator.add, lanes, lambda builder, x, y: builder.fadd(x, y, flags=_CONTRACT))
_install(operator.sub, lanes, lambda builder, x, y: builder.fsub(x, y, flags=_CONTRACT))
_install(operator.mul, lanes, lambda builder, x, y: builder.fmul(x, y, flags=_CONTRACT))
_install(operator.truediv, lanes, lambda builder, x, y: builder.fdiv(x, y, flags=_CONTRACT))
_install(operator.lt, mask, lambda builder, x, y: builder.fcmp_ordered("<", x, y))
_install(operator.le, mask, lambda builder, x, y: builder.fcmp_ordered("<=", x, y))
_install(operator.gt, mask, lambda builder, x, y: builder.fcmp_ordered(">", x, y))
_install(operator.ge, mask, lambda builder, x, y: builder.fcmp_ordered(">=", x, y))


def intrinsic(function: Callable) -> Any:
    """Numba's: what a kernel calls has one argument less, the first one."""
    return extending.intrinsic(function)


@intrinsic
def lanes_of(typing, x):
    """Eight of one number."""
    return lanes(types.float64), lambda context, builder, kind, values: _wide(builder, values[0])


@intrinsic
def where(typing, condition, x, y):
    """x where the condition holds, y elsewhere; both are computed. Of a truth and numbers: one number."""

    def code(context, builder, kind, values):
        if kind.return_type == lanes:
            values = values[0], _wide(builder, values[1]), _wide(builder, values[2])
        return builder.select(*values)

    if condition == mask:
        return lanes(mask, *(lanes if kind == lanes else types.float64 for kind in (x, y))), code
    return types.float64(types.boolean, types.float64, types.float64), code


@intrinsic
def root(typing, x):
    """The square root of lanes, or of a number."""

    def code(context, builder, kind, values):
        (value,) = values
        name = f"llvm.sqrt.v{LANES}f64" if kind.return_type == lanes else "llvm.sqrt.f64"
        return builder.call(
            cgutils.get_or_insert_function(builder.module, ir.FunctionType(value.type, [value.type]), name), [value]
        )

    return (lanes(lanes) if x == lanes else types.float64(types.float64)), code


@intrinsic
def largest_lane(typing, x):
    """The largest of eight numbers."""

    def code(context, builder, kind, values):
        name = f"llvm.vector.reduce.fmax.v{LANES}f64"
        call = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_DOUBLE, [_EIGHT]), name)
        return builder.call(call, values)

    return types.float64(lanes), code


@intrinsic
def eight_of(typing, table, row, column):
    """``table[row, column, :]`` of an integer table (rows, columns, 8), as eight numbers of rows."""

    def code(context, builder, kind, values):
        view = context.make_array(table)(context, builder, values[0])
        at = [*values[1:], ir.Constant(ir.IntType(64), 0)]
        begin = cgutils.get_item_pointer(context, builder, table, view, at, wraparound=False)
        places = (builder.gep(begin, [ir.Constant(ir.IntType(64), lane)]) for lane in range(LANES))
        found = [builder.sext(builder.load(place), ir.IntType(64)) for place in places]
        return context.make_tuple(builder, kind.return_type, found)

    return types.UniTuple(types.intp, LANES)(table, types.intp, types.intp), code


@intrinsic
def columns(typing, table, rows, first):
    """The four columns from ``first`` on of eight rows of ``table`` (n, columns), as four `Lanes`."""

    def code(context, builder, kind, values):
        rows = [builder.load(place, align=8) for place in _places(context, builder, table, *values)]
        halves = [_transposed(builder, rows[k : k + WIDE]) for k in range(0, LANES, WIDE)]
        found = [_chosen(builder, a, b, list(range(LANES))) for a, b in zip(*halves, strict=True)]
        return context.make_tuple(builder, kind.return_type, found)

    return types.UniTuple(lanes, WIDE)(table, types.UniTuple(types.intp, LANES), types.intp), code


@intrinsic
def put_columns(typing, table, rows, first, a, b, c, d):
    """The opposite of `columns`."""

    def code(context, builder, kind, values):
        rows = []
        for k in range(0, LANES, WIDE):
            rows += _transposed(builder, [_chosen(builder, x, x, list(range(k, k + WIDE))) for x in values[3:]])
        for row, place in zip(rows, _places(context, builder, table, *values[:3]), strict=True):
            builder.store(row, place, align=8)
        return context.get_dummy_value()

    return types.void(table, types.UniTuple(types.intp, LANES), types.intp, lanes, lanes, lanes, lanes), code


def _places(context: Any, builder: Any, table: Any, value: Any, rows: Any, first: Any) -> list:
    """Addresses of four neighbouring numbers in each of eight rows."""
    view = context.make_array(table)(context, builder, value)
    begin, stride = builder.gep(view.data, [first]), builder.extract_value(view.strides, 0)
    begin = builder.bitcast(begin, ir.IntType(8).as_pointer())
    found = (builder.gep(begin, [builder.mul(builder.extract_value(rows, lane), stride)]) for lane in range(LANES))
    return [builder.bitcast(place, _FOUR.as_pointer()) for place in found]


def _transposed(builder: Any, rows: list) -> list:
    """Four vectors of four, columns for rows."""
    a, b = (_chosen(builder, rows[0], rows[1], places) for places in ([0, 4, 2, 6], [1, 5, 3, 7]))
    c, d = (_chosen(builder, rows[2], rows[3], places) for places in ([0, 4, 2, 6], [1, 5, 3, 7]))
    low, high = [0, 1, 4, 5], [2, 3, 6, 7]
    return [_chosen(builder, *pair, half) for half in (low, high) for pair in ((a, c), (b, d))]
