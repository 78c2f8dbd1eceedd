"""A SIMD vector of eight doubles (f64x8) as a numba type.

LLVM maps the vector to registers of whatever width the processor has. It supports + - * / and comparisons, with other
vectors and with scalars; a comparison gives a `Mask8`, for `select`. Each lane is computed as a scalar would be, so
results do not depend on the width of the registers. A scalar is converted to a vector (`splat`) where a variable may
be either. Also supported: abs, max of two, sqrt, integer powers.

A function without branches (`select`, `maximum`) serves scalars and vectors alike; contact laws are written so. Loads,
stores, gathers and scatters are in `geometry.kernels.simd_tables`.
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

from geometry.kernels.device_functions import INLINE

LANES = 8
_DOUBLE = ir.DoubleType()
_EIGHT = ir.VectorType(_DOUBLE, LANES)
_CONTRACT = ("contract",)  # as the kernels have it


class F64x8(types.Type):
    """Type of a vector of eight doubles."""

    def __init__(self) -> None:
        super().__init__("F64x8")

    def unify(self, typing_context: Any, other: Any) -> Any:
        """A variable that is a scalar on one path and a vector on another is a vector."""
        return self if isinstance(other, types.Float) else None

    def can_convert_from(self, typing_context: Any, other: Any) -> Any:
        """A scalar converts to a vector."""
        return Conversion.safe if other == types.float64 else None


class Mask8(types.Type):
    """Type of a vector of eight booleans."""

    def __init__(self) -> None:
        super().__init__("Mask8")


f64x8, mask8 = F64x8(), Mask8()


@register_model(F64x8)
class _F64x8Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _EIGHT)


@register_model(Mask8)
class _Mask8Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), LANES))


def _shuffle(builder: Any, one: Any, other: Any, places: list[int]) -> Any:
    """Elements of two vectors by their places, counted through both."""
    return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places))


def _splat(builder: Any, value: Any) -> Any:
    """Broadcast a scalar; a vector stays as it is."""
    if value.type == _EIGHT:
        return value
    first = builder.insert_element(ir.Constant(_EIGHT, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return _shuffle(builder, first, first, [0] * LANES)


@lower_cast(types.float64, f64x8)
def _cast_splat(context: Any, builder: Any, kind: Any, target: Any, value: Any) -> Any:
    return _splat(builder, value)


def _install(operation: Callable, result: types.Type, code: Callable) -> None:
    """Register an operation on vectors, and on vectors with scalars."""
    kinds = ((f64x8, f64x8), (f64x8, types.float64), (types.float64, f64x8))

    class Template(ConcreteTemplate):
        cases = [signature(result, *kind) for kind in kinds]

    infer_global(operation)(Template)

    def lower(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        return code(builder, *(_splat(builder, value) for value in values))

    for kind in kinds:
        lower_builtin(operation, *kind)(lower)


_install(operator.add, f64x8, lambda builder, x, y: builder.fadd(x, y, flags=_CONTRACT))
_install(operator.sub, f64x8, lambda builder, x, y: builder.fsub(x, y, flags=_CONTRACT))
_install(operator.mul, f64x8, lambda builder, x, y: builder.fmul(x, y, flags=_CONTRACT))
_install(operator.truediv, f64x8, lambda builder, x, y: builder.fdiv(x, y, flags=_CONTRACT))
_install(operator.lt, mask8, lambda builder, x, y: builder.fcmp_ordered("<", x, y))
_install(operator.le, mask8, lambda builder, x, y: builder.fcmp_ordered("<=", x, y))
_install(operator.gt, mask8, lambda builder, x, y: builder.fcmp_ordered(">", x, y))
_install(operator.ge, mask8, lambda builder, x, y: builder.fcmp_ordered(">=", x, y))


infer_global(operator.neg)(type("Template", (ConcreteTemplate,), {"cases": [signature(f64x8, f64x8)]}))


@lower_builtin(operator.neg, f64x8)
def _negative(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    return builder.fneg(values[0])


def intrinsic(function: Callable) -> Any:
    """`numba.extending.intrinsic`: a kernel calls the function without its first argument."""
    return extending.intrinsic(function)


@intrinsic
def splat(typing, x):
    """Broadcast a scalar to a vector."""
    return f64x8(types.float64), lambda context, builder, kind, values: _splat(builder, values[0])


def select(condition, x, y):
    """x where the condition holds, y elsewhere; both are computed. Of scalars too, also in Python."""
    return x if condition else y


def maximum(x, least):
    """The larger of x and ``least``; NaN in x stays NaN. Of scalars and of vectors."""
    return least if least > x else x


def _register_typed(function: Callable, typed: Callable) -> Callable:
    """Register a function of scalars and vectors; ``typed`` gives the types of its parameters from those given.

    The result is a vector where one of the arguments is. An overload would be resolved at every call, which takes a
    tenth of the time in which a step is compiled.
    """

    class Template(AbstractTemplate):
        def generic(self, args, kws):
            parameters = typed(*args)
            return signature(f64x8 if {f64x8, mask8} & set(parameters) else types.float64, *parameters)

    infer_global(function)(Template)
    return lower_builtin(function, *(types.Any,) * len(inspect.signature(function).parameters))


def _scalar_or_vector(kind: Any) -> Any:
    return f64x8 if kind == f64x8 else types.float64


def _types_of_select(c: Any, x: Any, y: Any) -> tuple:
    return mask8 if c == mask8 else types.boolean, _scalar_or_vector(x), _scalar_or_vector(y)


@_register_typed(select, _types_of_select)
def _lower_select(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    if kind.return_type == f64x8:
        values = values[0], _splat(builder, values[1]), _splat(builder, values[2])
    return builder.select(*values)


@_register_typed(maximum, lambda x, least: (_scalar_or_vector(x), _scalar_or_vector(least)))
def _lower_maximum(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    if kind.return_type == f64x8:
        values = [_splat(builder, value) for value in values]
    return builder.select(builder.fcmp_ordered(">", values[1], values[0]), values[1], values[0])


@intrinsic
def llvm_sqrt(typing, x):
    """LLVM's square root of a vector or a scalar."""

    def code(context, builder, kind, values):
        (value,) = values
        name = f"llvm.sqrt.v{LANES}f64" if kind.return_type == f64x8 else "llvm.sqrt.f64"
        return builder.call(
            cgutils.get_or_insert_function(builder.module, ir.FunctionType(value.type, [value.type]), name), [value]
        )

    return (f64x8(f64x8) if x == f64x8 else types.float64(types.float64)), code


@extending.overload(math.sqrt, jit_options=INLINE)
@extending.overload(np.sqrt, jit_options=INLINE)
def _sqrt(x):
    return (lambda x: llvm_sqrt(x)) if x == f64x8 else None


@intrinsic
def _abs(typing, x):
    def code(context, builder, kind, values):
        made = ir.FunctionType(_EIGHT, [_EIGHT])
        return builder.call(cgutils.get_or_insert_function(builder.module, made, f"llvm.fabs.v{LANES}f64"), values)

    return f64x8(f64x8), code


@extending.overload(abs, jit_options=INLINE)
def _abs_of_vector(x):
    return (lambda x: _abs(x)) if x == f64x8 else None


@extending.overload(max, jit_options=INLINE)
def _max(x, y):
    return (lambda x, y: maximum(x, y)) if f64x8 in (x, y) else None


@extending.overload(operator.pow, jit_options=INLINE)
def _power(x, n):
    """x^n for integer n."""
    if x != f64x8 or not isinstance(n, types.Integer):
        return None

    def power(x, n):
        product = splat(1.0)
        for _ in range(abs(n)):
            product = product * x
        return product if n >= 0 else 1.0 / product

    return power


@intrinsic
def reduce_max(typing, x):
    """The largest element."""

    def code(context, builder, kind, values):
        name = f"llvm.vector.reduce.fmax.v{LANES}f64"
        call = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_DOUBLE, [_EIGHT]), name)
        return builder.call(call, values)

    return types.float64(f64x8), code


@intrinsic
def to_tuple(typing, x):
    """The eight elements as a tuple."""

    def code(context, builder, kind, values):
        each = (builder.extract_element(values[0], ir.Constant(ir.IntType(32), lane)) for lane in range(LANES))
        return context.make_tuple(builder, kind.return_type, list(each))

    return types.UniTuple(types.float64, LANES)(f64x8), code


@intrinsic
def reduce_add(typing, x):
    """The sum of the elements, added in order."""

    def code(context, builder, kind, values):
        total = builder.extract_element(values[0], ir.Constant(ir.IntType(32), 0))
        for lane in range(1, LANES):
            total = builder.fadd(total, builder.extract_element(values[0], ir.Constant(ir.IntType(32), lane)))
        return total

    return types.float64(f64x8), code


@intrinsic
def movemask(typing, condition):
    """The mask as bits of an integer, the first lane lowest."""

    def code(context, builder, kind, values):
        return builder.zext(builder.bitcast(values[0], ir.IntType(LANES)), ir.IntType(64))

    return types.intp(mask8), code


@intrinsic
def any_lane(typing, condition):
    """True if any lane of a mask, or a boolean, is true."""

    def code(context, builder, kind, values):
        if condition != mask8:
            return values[0]
        bits = builder.bitcast(values[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(condition), code


@intrinsic
def mask_of_first(typing, count):
    """A mask of the first ``count`` lanes."""

    def code(context, builder, kind, values):
        words = ir.VectorType(ir.IntType(64), LANES)
        first = builder.insert_element(ir.Constant(words, ir.Undefined), values[0], ir.Constant(ir.IntType(32), 0))
        numbers = ir.Constant(words, list(range(LANES)))
        return builder.icmp_signed("<", numbers, _shuffle(builder, first, first, [0] * LANES))

    return mask8(types.intp), code


@intrinsic
def to_integers(typing, x):
    """Truncate to eight integers; NaN is undefined behaviour."""

    def code(context, builder, kind, values):
        integers = builder.fptosi(values[0], ir.VectorType(ir.IntType(64), LANES))
        each = (builder.extract_element(integers, ir.Constant(ir.IntType(32), lane)) for lane in range(LANES))
        return context.make_tuple(builder, kind.return_type, list(each))

    return types.UniTuple(types.intp, LANES)(f64x8), code


@intrinsic
def from_integers(typing, numbers):
    """Convert eight integers to a vector."""

    def code(context, builder, kind, values):
        made = ir.Constant(_EIGHT, ir.Undefined)
        for lane in range(LANES):
            number = builder.sitofp(builder.extract_value(values[0], lane), _DOUBLE)
            made = builder.insert_element(made, number, ir.Constant(ir.IntType(32), lane))
        return made

    return f64x8(types.UniTuple(types.intp, LANES)), code
