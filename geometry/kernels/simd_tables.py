"""Gather and scatter: SIMD vectors from tables and back, eight rows at any places, a few adjacent columns of each.

`gather_columns` reads four adjacent columns of eight rows and `scatter_columns` writes them: eight short loads and a
transposition in registers, which costs a fraction of a gather with one index per number. The rows of a scatter must
differ, unless equal values are written; `scatter_add` accepts repeated rows.

`StackTable` is a table on the stack whose entries are vectors: a function that reads and writes ``rows[slot, column]``
of an array finds a vector there, whatever the slot is.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import models, register_model

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import _DOUBLE, _EIGHT, LANES, F64x8, _shuffle, f64x8, intrinsic

WIDE = 4  # columns of a table that one load takes


class StackTable(types.Type):
    """One row of a table whose columns are vectors, on the stack of the kernel that made it."""

    def __init__(self) -> None:
        super().__init__("StackTable")


stack_table_type = StackTable()


@register_model(StackTable)
class _StackTableModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _EIGHT.as_pointer())


@intrinsic
def stack_table(typing, columns):
    """A table of ``columns`` vectors (a constant), not initialised, which lives as long as the calling function."""
    if not isinstance(columns, types.IntegerLiteral):
        return None

    def code(context, builder, kind, values):
        with builder.goto_entry_block():
            room = builder.alloca(ir.ArrayType(_EIGHT, columns.literal_value))
            room.align = 64
        return builder.bitcast(room, _EIGHT.as_pointer())

    return stack_table_type(columns), code


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args, kws):
        rows = args[0]
        return signature(f64x8, rows, types.UniTuple(types.intp, 2)) if isinstance(rows, StackTable) else None


@infer_global(operator.setitem)
class _Put(AbstractTemplate):
    def generic(self, args, kws):
        rows = args[0]
        if not isinstance(rows, StackTable):
            return None
        return signature(types.none, rows, types.UniTuple(types.intp, 2), f64x8)


@lower_builtin(operator.getitem, StackTable, types.UniTuple)
def _get_lane(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    return builder.load(builder.gep(values[0], [builder.extract_value(values[1], 1)]))


@lower_builtin(operator.setitem, StackTable, types.UniTuple, F64x8)
def _put_lane(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    builder.store(values[2], builder.gep(values[0], [builder.extract_value(values[1], 1)]))
    return context.get_dummy_value()


@intrinsic
def load(typing, table, row, column):
    """Load eight adjacent numbers: ``table[row, column, :]`` of a table (rows, columns, 8), or those from ``column`` on
    of a table (rows, columns). A vector from a float table, a tuple of eight integers from another."""
    real = isinstance(table.dtype, types.Float)

    def code(context, builder, kind, values):
        view = context.make_array(table)(context, builder, values[0])
        at = values[1:] if table.ndim == 2 else [*values[1:], ir.Constant(ir.IntType(64), 0)]
        begin = cgutils.get_item_pointer(context, builder, table, view, at, wraparound=False)
        if real:
            return builder.load(builder.bitcast(begin, _EIGHT.as_pointer()), align=8)
        places = (builder.gep(begin, [ir.Constant(ir.IntType(64), lane)]) for lane in range(LANES))
        integers = [builder.sext(builder.load(place), ir.IntType(64)) for place in places]
        return context.make_tuple(builder, kind.return_type, integers)

    return (f64x8 if real else types.UniTuple(types.intp, LANES))(table, types.intp, types.intp), code


@intrinsic
def store(typing, table, row, column, a):
    """Store a vector where `load` reads it."""

    def code(context, builder, kind, values):
        view = context.make_array(table)(context, builder, values[0])
        at = values[1:3] if table.ndim == 2 else [*values[1:3], ir.Constant(ir.IntType(64), 0)]
        place = cgutils.get_item_pointer(context, builder, table, view, at, wraparound=False)
        builder.store(values[3], builder.bitcast(place, _EIGHT.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(table, types.intp, types.intp, f64x8), code


@intrinsic
def movemask_at_least(typing, array, first, bound):
    """Compare eight adjacent unsigned integers from ``first`` on: bit k of the result is that the k-th >= bound."""

    def code(context, builder, kind, values):
        view = context.make_array(array)(context, builder, values[0])
        eight = ir.VectorType(context.get_value_type(array.dtype), LANES)
        place = builder.bitcast(builder.gep(view.data, [values[1]]), eight.as_pointer())
        loaded = builder.load(place, align=array.dtype.bitwidth // 8)
        least = builder.insert_element(
            ir.Constant(eight, ir.Undefined), builder.trunc(values[2], eight.element), ir.Constant(ir.IntType(32), 0)
        )
        bits = builder.icmp_unsigned(">=", loaded, _shuffle(builder, least, least, [0] * LANES))
        return builder.zext(builder.bitcast(bits, ir.IntType(LANES)), ir.IntType(64))

    return types.intp(array, types.intp, types.intp), code


@intrinsic
def gather_columns(typing, table, rows, first):
    """Gather four columns from ``first`` on of eight ``rows`` of ``table`` (n, columns), as four vectors."""

    def code(context, builder, kind, values):
        rows = [builder.load(place, align=8) for place in _places(context, builder, table, values)]
        halves = [_transpose(builder, rows[k : k + WIDE]) for k in range(0, LANES, WIDE)]
        columns = [_shuffle(builder, a, b, list(range(LANES))) for a, b in zip(*halves, strict=True)]
        return context.make_tuple(builder, kind.return_type, columns)

    return types.UniTuple(f64x8, WIDE)(table, types.UniTuple(types.intp, LANES), types.intp), code


@intrinsic
def gather_two_columns(typing, table, rows, first):
    """Gather two columns from ``first`` on; ``first`` may be eight integers, one a row."""

    def code(context, builder, kind, values):
        rows = [builder.load(place, align=8) for place in _places(context, builder, table, values, width=2)]
        while len(rows) > 1:
            both = list(range(2 * rows[0].type.count))
            rows = [_shuffle(builder, one, next_one, both) for one, next_one in zip(rows[::2], rows[1::2], strict=True)]
        columns = [_shuffle(builder, rows[0], rows[0], list(range(k, 2 * LANES, 2))) for k in range(2)]
        return context.make_tuple(builder, kind.return_type, columns)

    kind = types.intp if isinstance(first, types.Integer) else types.UniTuple(types.intp, LANES)
    return types.UniTuple(f64x8, 2)(table, types.UniTuple(types.intp, LANES), kind), code


@intrinsic
def gather_column(typing, table, rows, first):
    """Gather one column of eight rows."""

    def code(context, builder, kind, values):
        made = ir.Constant(_EIGHT, ir.Undefined)
        for lane, place in enumerate(_places(context, builder, table, values, width=1)):
            x = builder.load(builder.bitcast(place, _DOUBLE.as_pointer()), align=8)
            made = builder.insert_element(made, x, ir.Constant(ir.IntType(32), lane))
        return made

    return f64x8(table, types.UniTuple(types.intp, LANES), types.intp), code


@intrinsic
def gather(typing, array, rows):
    """Gather ``array[k]`` for eight k of an array (n,): a vector of a float array, eight integers of another."""
    real = isinstance(array.dtype, types.Float)

    def code(context, builder, kind, values):
        view = context.make_array(array)(context, builder, values[0])
        picked = (builder.extract_value(values[1], lane) for lane in range(LANES))
        loaded = [builder.load(builder.gep(view.data, [k])) for k in picked]
        if not real:
            wide = builder.sext if array.dtype.signed else builder.zext
            loaded = [wide(x, ir.IntType(64)) if x.type.width < 64 else x for x in loaded]
            return context.make_tuple(builder, kind.return_type, loaded)
        made = ir.Constant(_EIGHT, ir.Undefined)
        for lane, x in enumerate(loaded):
            made = builder.insert_element(made, x, ir.Constant(ir.IntType(32), lane))
        return made

    return (f64x8 if real else types.UniTuple(types.intp, LANES))(array, types.UniTuple(types.intp, LANES)), code


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def eight_indices(k, last):
    """The integers k to k + 7, limited to ``last``, as a tuple."""
    return (
        k, min(k + 1, last), min(k + 2, last), min(k + 3, last),
        min(k + 4, last), min(k + 5, last), min(k + 6, last), min(k + 7, last),
    )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def interpolate_bilinear(values, row, x, column, y):
    """Interpolate ``values`` (r, c) at eight points: fractions ``x`` past rows and ``y`` past columns, in [0, 1]."""
    low, low_next = gather_two_columns(values, row, column)
    high, high_next = gather_two_columns(values[1:], row, column)
    low, high = low + y * (low_next - low), high + y * (high_next - high)
    return low + x * (high - low)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def interpolate_linear(values, row, x):
    """Interpolate ``values`` (r,) at eight points: fractions ``x`` past rows, in [0, 1]."""
    here, after = gather(values, row), gather(values[1:], row)
    return here + x * (after - here)


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def gather_2d(table, a, b):
    """Gather ``table[a, b]`` for eight pairs of indices, as a tuple."""
    return (
        table[a[0], b[0]], table[a[1], b[1]], table[a[2], b[2]], table[a[3], b[3]],
        table[a[4], b[4]], table[a[5], b[5]], table[a[6], b[6]], table[a[7], b[7]],
    )  # fmt: skip


@intrinsic
def scatter_columns(typing, table, rows, first, a, b, c, d):
    """Scatter four vectors where `gather_columns` reads them."""

    def code(context, builder, kind, values):
        rows = []
        for k in range(0, LANES, WIDE):
            rows += _transpose(builder, [_shuffle(builder, x, x, list(range(k, k + WIDE))) for x in values[3:]])
        for row, place in zip(rows, _places(context, builder, table, values), strict=True):
            builder.store(row, place, align=8)
        return context.get_dummy_value()

    return types.void(table, types.UniTuple(types.intp, LANES), types.intp, f64x8, f64x8, f64x8, f64x8), code


@intrinsic
def scatter_two_columns(typing, table, rows, first, a, b):
    """Scatter two vectors where `gather_two_columns` reads them."""

    def code(context, builder, kind, values):
        for lane, place in enumerate(_places(context, builder, table, values, width=2)):
            builder.store(_shuffle(builder, values[3], values[4], [lane, LANES + lane]), place, align=8)
        return context.get_dummy_value()

    return types.void(table, types.UniTuple(types.intp, LANES), types.intp, f64x8, f64x8), code


@intrinsic
def scatter_column(typing, table, rows, column, a):
    """Scatter one column of eight rows of ``table`` (n, columns)."""

    def code(context, builder, kind, values):
        for lane, place in enumerate(_places(context, builder, table, values, width=1)):
            x = builder.extract_element(values[3], ir.Constant(ir.IntType(32), lane))
            builder.store(x, builder.bitcast(place, _DOUBLE.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(table, types.UniTuple(types.intp, LANES), types.intp, f64x8), code


@intrinsic
def scatter_add(typing, table, rows, first, other, places, added):
    """Add four or six vectors to adjacent columns of eight rows, one row after the other: rows may repeat.

    Columns from ``first`` on of ``table[rows]`` are added to or, where a place is not negative, the first columns of
    ``other[places]``; both are None where there is no other table.
    """
    many = len(added)

    def code(context, builder, kind, values):
        fours, twos = _rows_of(builder, [builder.extract_value(values[5], k) for k in range(many)])
        places = _places(context, builder, table, values)
        if other != types.none:
            zero = ir.Constant(ir.IntType(64), 0)
            away = (builder.icmp_signed(">=", builder.extract_value(values[4], lane), zero) for lane in range(LANES))
            there = _places(context, builder, other, [*values[3:5], zero])
            places = [builder.select(*which) for which in zip(away, there, places, strict=True)]
        for place, four, two in zip(places, fours, twos, strict=True):
            _add(builder, place, four, two)
        return context.get_dummy_value()

    eight = types.UniTuple(types.intp, LANES)
    return types.void(table, eight, types.intp, other, places, types.UniTuple(f64x8, many)), code


def _rows_of(builder: Any, six: Any) -> tuple[list, list]:
    """Four or six columns of eight rows as rows: four numbers, and two or None."""
    fours = []
    for k in range(0, LANES, WIDE):
        fours += _transpose(builder, [_shuffle(builder, x, x, list(range(k, k + WIDE))) for x in six[:4]])
    if len(six) == WIDE:
        return fours, [None] * LANES
    return fours, [_shuffle(builder, six[4], six[5], [lane, LANES + lane]) for lane in range(LANES)]


def _add(builder: Any, place: Any, four: Any, two: Any) -> None:
    """Add to four adjacent numbers, and to the two after them."""
    builder.store(builder.fadd(builder.load(place, align=8), four), place, align=8)
    if two is None:
        return
    rest = builder.bitcast(builder.gep(place, [ir.Constant(ir.IntType(64), 1)]), two.type.as_pointer())
    builder.store(builder.fadd(builder.load(rest, align=8), two), rest, align=8)


def _places(context: Any, builder: Any, table: Any, values: Any, width: int = WIDE) -> list:
    """Addresses of ``width`` adjacent numbers in each of eight rows; ``values`` are table, rows and first column."""
    value, rows, first = values[:3]
    view = context.make_array(table)(context, builder, value)
    stride, byte = builder.extract_value(view.strides, 0), ir.IntType(8).as_pointer()
    apart = isinstance(first.type, ir.ArrayType)
    places = []
    for lane in range(LANES):
        begin = builder.gep(view.data, [builder.extract_value(first, lane) if apart else first])
        row = builder.mul(builder.extract_value(rows, lane), stride)
        places.append(builder.gep(builder.bitcast(begin, byte), [row]))
    return [builder.bitcast(place, ir.VectorType(_DOUBLE, width).as_pointer()) for place in places]


def _transpose(builder: Any, rows: list) -> list:
    """Four vectors of four, columns for rows."""
    a, b = (_shuffle(builder, rows[0], rows[1], places) for places in ([0, 4, 2, 6], [1, 5, 3, 7]))
    c, d = (_shuffle(builder, rows[2], rows[3], places) for places in ([0, 4, 2, 6], [1, 5, 3, 7]))
    low, high = [0, 1, 4, 5], [2, 3, 6, 7]
    return [_shuffle(builder, *pair, half) for half in (low, high) for pair in ((a, c), (b, d))]
