"""Lanes from tables and back: eight rows that may lie anywhere, a few neighbouring columns of each.

`columns` reads four neighbouring columns of eight rows, and `put_columns` writes them: eight short reads and a
transposition in registers, where an index for each number would cost several times as much. No two rows that are
written may be the same one, unless the same is written there; to rows that may be the same, `add_to_rows` adds.

`LaneRows` is a table on the stack whose numbers are lanes: a function that reads and writes ``rows[slot, column]`` of
an array finds eight there, whatever the slot is called.
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

from geometry.inner_functions import inner
from geometry.lanes import _DOUBLE, _EIGHT, LANES, Lanes, _chosen, intrinsic, lanes

WIDE = 4  # columns of a table that are read at once
_FOUR = ir.VectorType(_DOUBLE, WIDE)


class LaneRows(types.Type):
    """One row of a table whose columns are lanes; it lies on the stack of the kernel that has made it."""

    def __init__(self) -> None:
        super().__init__("LaneRows")


lane_rows_type = LaneRows()


@register_model(LaneRows)
class _LaneRowsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _EIGHT.as_pointer())


@intrinsic
def lane_rows(typing, columns):
    """Room for so many columns, a constant; what they hold is not told. It ends with the function that asks for it."""
    if not isinstance(columns, types.IntegerLiteral):
        return None

    def code(context, builder, kind, values):
        with builder.goto_entry_block():
            room = builder.alloca(ir.ArrayType(_EIGHT, columns.literal_value))
            room.align = 64
        return builder.bitcast(room, _EIGHT.as_pointer())

    return lane_rows_type(columns), code


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args, kws):
        rows = args[0]
        return signature(lanes, rows, types.UniTuple(types.intp, 2)) if isinstance(rows, LaneRows) else None


@infer_global(operator.setitem)
class _Put(AbstractTemplate):
    def generic(self, args, kws):
        rows = args[0]
        if not isinstance(rows, LaneRows):
            return None
        return signature(types.none, rows, types.UniTuple(types.intp, 2), lanes)


@lower_builtin(operator.getitem, LaneRows, types.UniTuple)
def _get_lane(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    return builder.load(builder.gep(values[0], [builder.extract_value(values[1], 1)]))


@lower_builtin(operator.setitem, LaneRows, types.UniTuple, Lanes)
def _put_lane(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    builder.store(values[2], builder.gep(values[0], [builder.extract_value(values[1], 1)]))
    return context.get_dummy_value()


@intrinsic
def eight_of(typing, table, row, column):
    """Eight numbers of rows: ``table[row, column, :]`` of an integer table (rows, columns, 8), of one (rows, columns)
    those from ``column`` on; of a float table as lanes."""
    real = isinstance(table.dtype, types.Float)

    def code(context, builder, kind, values):
        view = context.make_array(table)(context, builder, values[0])
        at = values[1:] if table.ndim == 2 else [*values[1:], ir.Constant(ir.IntType(64), 0)]
        begin = cgutils.get_item_pointer(context, builder, table, view, at, wraparound=False)
        if real:
            return builder.load(builder.bitcast(begin, _EIGHT.as_pointer()), align=8)
        places = (builder.gep(begin, [ir.Constant(ir.IntType(64), lane)]) for lane in range(LANES))
        found = [builder.sext(builder.load(place), ir.IntType(64)) for place in places]
        return context.make_tuple(builder, kind.return_type, found)

    return (lanes if real else types.UniTuple(types.intp, LANES))(table, types.intp, types.intp), code


@intrinsic
def put_eight(typing, table, row, column, a):
    """The opposite of `eight_of`, of lanes."""

    def code(context, builder, kind, values):
        view = context.make_array(table)(context, builder, values[0])
        at = values[1:3] if table.ndim == 2 else [*values[1:3], ir.Constant(ir.IntType(64), 0)]
        place = cgutils.get_item_pointer(context, builder, table, view, at, wraparound=False)
        builder.store(values[3], builder.bitcast(place, _EIGHT.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(table, types.intp, types.intp, lanes), code


@intrinsic
def eight_at_least(typing, array, first, bound):
    """Which of eight neighbours from ``first`` on of an array of unsigned integers are ``bound`` or more, as bits."""

    def code(context, builder, kind, values):
        view = context.make_array(array)(context, builder, values[0])
        eight = ir.VectorType(context.get_value_type(array.dtype), LANES)
        place = builder.bitcast(builder.gep(view.data, [values[1]]), eight.as_pointer())
        found = builder.load(place, align=array.dtype.bitwidth // 8)
        least = builder.insert_element(
            ir.Constant(eight, ir.Undefined), builder.trunc(values[2], eight.element), ir.Constant(ir.IntType(32), 0)
        )
        bits = builder.icmp_unsigned(">=", found, _chosen(builder, least, least, [0] * LANES))
        return builder.zext(builder.bitcast(bits, ir.IntType(LANES)), ir.IntType(64))

    return types.intp(array, types.intp, types.intp), code


@intrinsic
def columns(typing, table, rows, first):
    """The four columns from ``first`` on of eight rows of ``table`` (n, columns), as four `Lanes`."""

    def code(context, builder, kind, values):
        rows = [builder.load(place, align=8) for place in _places(context, builder, table, values)]
        halves = [_transposed(builder, rows[k : k + WIDE]) for k in range(0, LANES, WIDE)]
        found = [_chosen(builder, a, b, list(range(LANES))) for a, b in zip(*halves, strict=True)]
        return context.make_tuple(builder, kind.return_type, found)

    return types.UniTuple(lanes, WIDE)(table, types.UniTuple(types.intp, LANES), types.intp), code


@intrinsic
def two_columns(typing, table, rows, first):
    """The two columns from ``first`` on, as `columns`; ``first`` may be eight numbers, one a row."""

    def code(context, builder, kind, values):
        rows = [builder.load(place, align=8) for place in _places(context, builder, table, values, width=2)]
        while len(rows) > 1:
            both = list(range(2 * rows[0].type.count))
            rows = [_chosen(builder, one, next_one, both) for one, next_one in zip(rows[::2], rows[1::2], strict=True)]
        found = [_chosen(builder, rows[0], rows[0], list(range(k, 2 * LANES, 2))) for k in range(2)]
        return context.make_tuple(builder, kind.return_type, found)

    kind = types.intp if isinstance(first, types.Integer) else types.UniTuple(types.intp, LANES)
    return types.UniTuple(lanes, 2)(table, types.UniTuple(types.intp, LANES), kind), code


@intrinsic
def column(typing, table, rows, first):
    """One column of eight rows."""

    def code(context, builder, kind, values):
        made = ir.Constant(_EIGHT, ir.Undefined)
        for lane, place in enumerate(_places(context, builder, table, values, width=1)):
            x = builder.load(builder.bitcast(place, _DOUBLE.as_pointer()), align=8)
            made = builder.insert_element(made, x, ir.Constant(ir.IntType(32), lane))
        return made

    return lanes(table, types.UniTuple(types.intp, LANES), types.intp), code


@intrinsic
def entries(typing, array, rows):
    """``array[k]`` for eight k of an array (n,): lanes of a float array, eight integers of another."""
    real = isinstance(array.dtype, types.Float)

    def code(context, builder, kind, values):
        view = context.make_array(array)(context, builder, values[0])
        picked = (builder.extract_value(values[1], lane) for lane in range(LANES))
        found = [builder.load(builder.gep(view.data, [k])) for k in picked]
        if not real:
            wide = builder.sext if array.dtype.signed else builder.zext
            found = [wide(x, ir.IntType(64)) if x.type.width < 64 else x for x in found]
            return context.make_tuple(builder, kind.return_type, found)
        made = ir.Constant(_EIGHT, ir.Undefined)
        for lane, x in enumerate(found):
            made = builder.insert_element(made, x, ir.Constant(ir.IntType(32), lane))
        return made

    return (lanes if real else types.UniTuple(types.intp, LANES))(array, types.UniTuple(types.intp, LANES)), code


@inner(borrows=True, error_model="numpy", forceinline=True)
def eight_from(k, last):
    """k and the seven numbers after it, ``last`` at most."""
    return (
        k, min(k + 1, last), min(k + 2, last), min(k + 3, last),
        min(k + 4, last), min(k + 5, last), min(k + 6, last), min(k + 7, last),
    )  # fmt: skip


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def bilinear(values, row, x, column, y):
    """Eight numbers between the nodes of ``values`` (r, c), ``x`` behind rows and ``y`` behind columns, 0 to 1 each."""
    low, low_next = two_columns(values, row, column)
    high, high_next = two_columns(values[1:], row, column)
    low, high = low + y * (low_next - low), high + y * (high_next - high)
    return low + x * (high - low)


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def linear(values, row, x):
    """Eight numbers between the nodes of ``values`` (r,): ``x`` behind rows [0, 1]."""
    here, after = entries(values, row), entries(values[1:], row)
    return here + x * (after - here)


@inner(borrows=True, error_model="numpy", forceinline=True)
def entries_2d(table, a, b):
    """``table[a, b]`` for eight pairs of indices, as a tuple."""
    return (
        table[a[0], b[0]], table[a[1], b[1]], table[a[2], b[2]], table[a[3], b[3]],
        table[a[4], b[4]], table[a[5], b[5]], table[a[6], b[6]], table[a[7], b[7]],
    )  # fmt: skip


@intrinsic
def put_columns(typing, table, rows, first, a, b, c, d):
    """The opposite of `columns`."""

    def code(context, builder, kind, values):
        rows = []
        for k in range(0, LANES, WIDE):
            rows += _transposed(builder, [_chosen(builder, x, x, list(range(k, k + WIDE))) for x in values[3:]])
        for row, place in zip(rows, _places(context, builder, table, values), strict=True):
            builder.store(row, place, align=8)
        return context.get_dummy_value()

    return types.void(table, types.UniTuple(types.intp, LANES), types.intp, lanes, lanes, lanes, lanes), code


@intrinsic
def put_two_columns(typing, table, rows, first, a, b):
    """The opposite of `two_columns`."""

    def code(context, builder, kind, values):
        for lane, place in enumerate(_places(context, builder, table, values, width=2)):
            builder.store(_chosen(builder, values[3], values[4], [lane, LANES + lane]), place, align=8)
        return context.get_dummy_value()

    return types.void(table, types.UniTuple(types.intp, LANES), types.intp, lanes, lanes), code


@intrinsic
def put_column(typing, table, rows, column, a):
    """Write one column of eight rows of ``table`` (n, columns)."""

    def code(context, builder, kind, values):
        for lane, place in enumerate(_places(context, builder, table, values, width=1)):
            x = builder.extract_element(values[3], ir.Constant(ir.IntType(32), lane))
            builder.store(x, builder.bitcast(place, _DOUBLE.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(table, types.UniTuple(types.intp, LANES), types.intp, lanes), code


@intrinsic
def add_to_rows(typing, table, rows, first, other, places, added):
    """Add four or six lanes to neighbouring columns of eight rows, one row after the other: rows may be the same.

    They are the columns from ``first`` on of ``table[rows]``, or, where a place is not negative, the first ones of
    ``other[places]``; both are None where there is no other table.
    """
    many = len(added)

    def code(context, builder, kind, values):
        fours, twos = _rows_of(builder, [builder.extract_value(values[5], k) for k in range(many)])
        found = _places(context, builder, table, values)
        if other != types.none:
            zero = ir.Constant(ir.IntType(64), 0)
            away = (builder.icmp_signed(">=", builder.extract_value(values[4], lane), zero) for lane in range(LANES))
            there = _places(context, builder, other, [*values[3:5], zero])
            found = [builder.select(*which) for which in zip(away, there, found, strict=True)]
        for place, four, two in zip(found, fours, twos, strict=True):
            _add(builder, place, four, two)
        return context.get_dummy_value()

    eight = types.UniTuple(types.intp, LANES)
    return types.void(table, eight, types.intp, other, places, types.UniTuple(lanes, many)), code


def _rows_of(builder: Any, six: Any) -> tuple[list, list]:
    """Four or six columns of eight rows as rows: four numbers, and two or None."""
    fours = []
    for k in range(0, LANES, WIDE):
        fours += _transposed(builder, [_chosen(builder, x, x, list(range(k, k + WIDE))) for x in six[:4]])
    if len(six) == WIDE:
        return fours, [None] * LANES
    return fours, [_chosen(builder, six[4], six[5], [lane, LANES + lane]) for lane in range(LANES)]


def _add(builder: Any, place: Any, four: Any, two: Any) -> None:
    """Add to four numbers that lie side by side, and to the two after them."""
    builder.store(builder.fadd(builder.load(place, align=8), four), place, align=8)
    if two is None:
        return
    rest = builder.bitcast(builder.gep(place, [ir.Constant(ir.IntType(64), 1)]), two.type.as_pointer())
    builder.store(builder.fadd(builder.load(rest, align=8), two), rest, align=8)


def _places(context: Any, builder: Any, table: Any, values: Any, width: int = WIDE) -> list:
    """Addresses of so many neighbouring numbers in each of eight rows; ``values`` are table, rows and first column."""
    value, rows, first = values[:3]
    view = context.make_array(table)(context, builder, value)
    stride, byte = builder.extract_value(view.strides, 0), ir.IntType(8).as_pointer()
    apart = isinstance(first.type, ir.ArrayType)
    found = []
    for lane in range(LANES):
        begin = builder.gep(view.data, [builder.extract_value(first, lane) if apart else first])
        row = builder.mul(builder.extract_value(rows, lane), stride)
        found.append(builder.gep(builder.bitcast(begin, byte), [row]))
    return [builder.bitcast(place, ir.VectorType(_DOUBLE, width).as_pointer()) for place in found]


def _transposed(builder: Any, rows: list) -> list:
    """Four vectors of four, columns for rows."""
    a, b = (_chosen(builder, rows[0], rows[1], places) for places in ([0, 4, 2, 6], [1, 5, 3, 7]))
    c, d = (_chosen(builder, rows[2], rows[3], places) for places in ([0, 4, 2, 6], [1, 5, 3, 7]))
    low, high = [0, 1, 4, 5], [2, 3, 6, 7]
    return [_chosen(builder, *pair, half) for half in (low, high) for pair in ((a, c), (b, d))]
