"""Square root and logarithm of scalars and SIMD vectors (`geometry.kernels.simd`) in kernels, and prefetching.

Numba's square root and logarithm call the C library (the root wherever its argument may be negative, to set errno),
and a loop with such a call is not vectorised.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array

from geometry.kernels.device_functions import INLINE
from geometry.kernels.simd import f64x8, llvm_sqrt, select

DOUBLES_A_LINE = 8  # in a cache line of 64 bytes
EXPONENT_BIAS, MANTISSA, ONE = 1023, (1 << 52) - 1, 1023 << 52  # of the 64 bits of a number


def sqrt(x):
    """The square root of a scalar or vector; in a kernel NaN for negative numbers. Also callable from Python."""
    return math.sqrt(x)


def log(x):
    """The natural logarithm of normal numbers above 0, relative error below 4e-16. Also callable from Python."""
    return math.log(x)


def _parts(typing_context, x):
    """Exponent and mantissa, 1 <= m < 2, of a normal number above 0, both as floats; of a vector as vectors."""
    kind = f64x8 if x == f64x8 else types.float64

    def code(context, builder, signature, arguments):
        (value,) = arguments
        word = ir.IntType(64) if kind == types.float64 else ir.VectorType(ir.IntType(64), value.type.count)

        def constant(number):
            return ir.Constant(word, number if kind == types.float64 else [number] * value.type.count)

        bits = builder.bitcast(value, word)
        exponent = builder.sub(builder.lshr(bits, constant(52)), constant(EXPONENT_BIAS))
        mantissa = builder.or_(builder.and_(bits, constant(MANTISSA)), constant(ONE))
        picked = builder.sitofp(exponent, value.type), builder.bitcast(mantissa, value.type)
        return context.make_tuple(builder, signature.return_type, picked)

    return types.UniTuple(kind, 2)(kind), code


def _prefetch(typing_context, array, row, many):
    """Prefetch the cache lines that hold ``many`` rows from ``row`` on of a float array (n, m).

    ``many`` is a constant, a multiple of 8: rows of m doubles fill m many/8 lines.
    """
    if not isinstance(many, types.IntegerLiteral):
        return None

    def code(context, builder, signature, arguments):
        source = make_array(signature.args[0])(context, builder, arguments[0])
        width = builder.extract_value(source.shape, 1)
        place = builder.gep(source.data, [builder.mul(arguments[1], width)])
        word, byte = ir.IntType(32), ir.IntType(8).as_pointer()
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(ir.VoidType(), [byte, word, word, word]), "llvm.prefetch.p0"
        )
        lines = builder.mul(width, ir.Constant(width.type, many.literal_value // DOUBLES_A_LINE))
        with cgutils.for_range(builder, lines) as loop:
            at = builder.gep(place, [builder.mul(loop.index, ir.Constant(width.type, DOUBLES_A_LINE))])
            builder.call(function, [builder.bitcast(at, byte), *(ir.Constant(word, k) for k in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, types.int64, many), code


prefetch_rows: Any = intrinsic(_prefetch)
_parts_of: Any = intrinsic(_parts)


@overload(sqrt, jit_options=INLINE)
def _square_root(x):
    return lambda x: llvm_sqrt(x)


@overload(log, jit_options=INLINE)
def _logarithm(x):
    """ln(2^e m) = e ln 2 + 2 artanh((m - 1)/(m + 1)), with m between sqrt(1/2) and sqrt(2): ten terms of the series."""

    def of_number(x):
        e, m = _parts_of(x)
        large = m > 1.4142135623730951
        m, e = select(large, 0.5 * m, m), select(large, e + 1.0, e)
        s = (m - 1.0) / (m + 1.0)
        t = s * s
        series = t * (1.0 / 3.0 + t * (1.0 / 5.0 + t * (1.0 / 7.0 + t * (1.0 / 9.0 + t * (1.0 / 11.0 + t * (
            1.0 / 13.0 + t * (1.0 / 15.0 + t * (1.0 / 17.0 + t * (1.0 / 19.0)))))))))  # fmt: skip
        return e * 0.6931471805599453 + 2.0 * (s + s * series)

    return of_number
