"""Eight numbers side by side: a type of numba's for kernels that do the same sum for eight of a kind at once.

`Lanes` are eight doubles, which LLVM puts into registers as wide as the processor has them. They know + - * / and
comparisons, among themselves and with plain numbers; a comparison is a `Mask` of eight, for `where`. Every lane is
computed as a number alone would be: not a bit depends on how wide the registers are. A plain number becomes eight of
itself where a variable holds now the one, now the other. Of Python's and numpy's functions they know abs, max of two,
sqrt and whole powers.

A function without branches (`where`, `larger`) serves for one item and for eight: contact laws are written so. How
lanes come from tables and go back there is in `geometry.lane_tables`.
"""

from __future__ import annotations

import inspect
import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global, signature
from numba.extending import models, register_model

from geometry.inner_functions import INTO_CALLER

LANES = 8
_DOUBLE = ir.DoubleType()
_EIGHT = ir.VectorType(_DOUBLE, LANES)
_CONTRACT = ("contract",)  # as the kernels have it


class Lanes(types.Type):
    """Eight doubles."""

    def __init__(self) -> None:
        super().__init__("Lanes")

    def unify(self, typing_context: Any, other: Any) -> Any:
        """A variable that is a number on one way and lanes on another is lanes."""
        return self if isinstance(other, types.Float) else None

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """A number is eight of itself."""
        return Conversion.safe if other == types.float64 else None


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


@lower_cast(types.float64, lanes)
def _widened(context: Any, builder: Any, kind: Any, wanted: Any, value: Any) -> Any:
    return _wide(builder, value)


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


infer_global(operator.neg)(type("Template", (ConcreteTemplate,), {"cases": [signature(lanes, lanes)]}))


@lower_builtin(operator.neg, lanes)
def _negative(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    return builder.fneg(values[0])


def intrinsic(function: Callable) -> Any:
    """Numba's: what a kernel calls has one argument less, the first one."""
    return extending.intrinsic(function)


@intrinsic
def lanes_of(typing, x):
    """Eight of one number."""
    return lanes(types.float64), lambda context, builder, kind, values: _wide(builder, values[0])


def where(condition, x, y):
    """x where the condition holds, y elsewhere; both are computed. Of a truth and numbers, also in Python: a number."""
    return x if condition else y


def larger(x, least):
    """x, or ``least`` where that is more; what is not a number stays so. Of numbers and of lanes."""
    return least if least > x else x


def _taught(function: Callable, typed: Callable) -> Callable:
    """Teach numba a function of numbers and lanes: ``typed`` gives the types of its arguments from those given.

    The result is lanes where one of the arguments is. An overload would be looked for at every call, which takes a
    tenth of the time in which a step is compiled.
    """

    class Template(AbstractTemplate):
        def generic(self, args, kws):
            wanted = typed(*args)
            return signature(lanes if {lanes, mask} & set(wanted) else types.float64, *wanted)

    infer_global(function)(Template)
    return lower_builtin(function, *(types.Any,) * len(inspect.signature(function).parameters))


def _number_or_lanes(kind: Any) -> Any:
    return lanes if kind == lanes else types.float64


@_taught(where, lambda c, x, y: (mask if c == mask else types.boolean, _number_or_lanes(x), _number_or_lanes(y)))
def _lower_where(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    if kind.return_type == lanes:
        values = values[0], _wide(builder, values[1]), _wide(builder, values[2])
    return builder.select(*values)


@_taught(larger, lambda x, least: (_number_or_lanes(x), _number_or_lanes(least)))
def _lower_larger(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    if kind.return_type == lanes:
        values = [_wide(builder, value) for value in values]
    return builder.select(builder.fcmp_ordered(">", values[1], values[0]), values[1], values[0])


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


@extending.overload(math.sqrt, jit_options=INTO_CALLER)
@extending.overload(np.sqrt, jit_options=INTO_CALLER)
def _sqrt_of_lanes(x):
    return (lambda x: root(x)) if x == lanes else None


@intrinsic
def _size(typing, x):
    def code(context, builder, kind, values):
        made = ir.FunctionType(_EIGHT, [_EIGHT])
        return builder.call(cgutils.get_or_insert_function(builder.module, made, f"llvm.fabs.v{LANES}f64"), values)

    return lanes(lanes), code


@extending.overload(abs, jit_options=INTO_CALLER)
def _abs_of_lanes(x):
    return (lambda x: _size(x)) if x == lanes else None


@extending.overload(max, jit_options=INTO_CALLER)
def _max_of_lanes(x, y):
    return (lambda x, y: larger(x, y)) if lanes in (x, y) else None


@extending.overload(operator.pow, jit_options=INTO_CALLER)
def _power_of_lanes(x, n):
    """x^n of a whole n."""
    if x != lanes or not isinstance(n, types.Integer):
        return None

    def power(x, n):
        product = lanes_of(1.0)
        for _ in range(abs(n)):
            product = product * x
        return product if n >= 0 else 1.0 / product

    return power


@intrinsic
def largest_lane(typing, x):
    """The largest of eight numbers."""

    def code(context, builder, kind, values):
        name = f"llvm.vector.reduce.fmax.v{LANES}f64"
        call = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_DOUBLE, [_EIGHT]), name)
        return builder.call(call, values)

    return types.float64(lanes), code


@intrinsic
def numbers_of(typing, x):
    """The eight numbers, one by one."""

    def code(context, builder, kind, values):
        each = (builder.extract_element(values[0], ir.Constant(ir.IntType(32), lane)) for lane in range(LANES))
        return context.make_tuple(builder, kind.return_type, list(each))

    return types.UniTuple(types.float64, LANES)(lanes), code


@intrinsic
def sum_of_lanes(typing, x):
    """The sum of eight numbers, one after the other."""

    def code(context, builder, kind, values):
        total = builder.extract_element(values[0], ir.Constant(ir.IntType(32), 0))
        for lane in range(1, LANES):
            total = builder.fadd(total, builder.extract_element(values[0], ir.Constant(ir.IntType(32), lane)))
        return total

    return types.float64(lanes), code


@intrinsic
def bits_of(typing, condition):
    """The truths of a mask as the bits of an integer, the first lane lowest."""

    def code(context, builder, kind, values):
        return builder.zext(builder.bitcast(values[0], ir.IntType(LANES)), ir.IntType(64))

    return types.intp(mask), code


@intrinsic
def any_of(typing, condition):
    """Whether a truth, or one of a mask, holds."""

    def code(context, builder, kind, values):
        if condition != mask:
            return values[0]
        bits = builder.bitcast(values[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(condition), code


@intrinsic
def first_lanes(typing, count):
    """Whether a lane is one of the first ``count``: a mask."""

    def code(context, builder, kind, values):
        words = ir.VectorType(ir.IntType(64), LANES)
        first = builder.insert_element(ir.Constant(words, ir.Undefined), values[0], ir.Constant(ir.IntType(32), 0))
        numbers = ir.Constant(words, list(range(LANES)))
        return builder.icmp_signed("<", numbers, _chosen(builder, first, first, [0] * LANES))

    return mask(types.intp), code


@intrinsic
def whole_part(typing, x):
    """Lanes without their fractions, as eight integers; what is not a number must not come here."""

    def code(context, builder, kind, values):
        whole = builder.fptosi(values[0], ir.VectorType(ir.IntType(64), LANES))
        each = (builder.extract_element(whole, ir.Constant(ir.IntType(32), lane)) for lane in range(LANES))
        return context.make_tuple(builder, kind.return_type, list(each))

    return types.UniTuple(types.intp, LANES)(lanes), code


@intrinsic
def as_lanes(typing, numbers):
    """Eight integers as lanes."""

    def code(context, builder, kind, values):
        made = ir.Constant(_EIGHT, ir.Undefined)
        for lane in range(LANES):
            number = builder.sitofp(builder.extract_value(values[0], lane), _DOUBLE)
            made = builder.insert_element(made, number, ir.Constant(ir.IntType(32), lane))
        return made

    return lanes(types.UniTuple(types.intp, LANES)), code
