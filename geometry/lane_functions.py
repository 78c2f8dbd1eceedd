"""Room, square root and logarithm for compiled loops that take many numbers at once.

Work with long arithmetic is done for LANES items side by side: they are gathered one after the other into `lane_room`,
a loop over all lanes has the arithmetic, and the items there are take what is theirs. Lanes without an item hold what
was in the room before: they are computed, and nothing that follows from them may be read or be an index.

Numba's own root and logarithm call the C library (the root wherever a number may be negative: it must set errno
there), and a loop with such a call is never compiled to instructions that take many numbers side by side.

The compiler finds the width itself, from functions that are written for one item and serve elsewhere as such: contact
laws, tables. Where a kernel is nothing but arithmetic on rows of tables it is written for eight at once instead
(`geometry.lanes`).
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array, populate_array

INTO_CALLER: Any = {"forceinline": True, "no_cfunc_wrapper": True, "_nrt": False}
LANES = 16
LINES = 2  # of the cache, 8 numbers each
EXPONENT_BIAS, MANTISSA, ONE = 1023, (1 << 52) - 1, 1023 << 52  # of the 64 bits of a number


def square_root(x):
    """The square root of a float; in a kernel NaN of what is negative. In Python as in a kernel."""
    return math.sqrt(x)


def logarithm(x):
    """The natural logarithm of a normal number above 0, to 4e-16 of itself; in Python as in a kernel."""
    return math.log(x)


def _lane_room(typing_context, fields):
    """An array (LANES, fields) on the stack of the kernel that asks for it, in which a field's lanes lie side by side.

    Its strides are known to the compiler, and that nothing else points to it: only then does it see that lanes do not
    touch each other. ``fields`` is a constant.
    """
    if not isinstance(fields, types.IntegerLiteral):
        return None
    of_lanes, count = types.Array(types.float64, 2, "F"), fields.literal_value

    def code(context, builder, signature, arguments):
        word = context.get_value_type(types.intp)
        with builder.goto_entry_block():
            room = builder.alloca(ir.ArrayType(ir.DoubleType(), LANES * count))
            room.align = 64
        made = make_array(of_lanes)(context, builder)
        populate_array(
            made,
            data=builder.bitcast(room, ir.DoubleType().as_pointer()),
            shape=[ir.Constant(word, LANES), ir.Constant(word, count)],
            strides=[ir.Constant(word, 8), ir.Constant(word, 8 * LANES)],
            itemsize=ir.Constant(word, 8),
            meminfo=None,
        )
        return made._getvalue()

    return of_lanes(fields), code


def _one_by_one(typing_context):
    """Said in a loop that gathers items into lanes: it is compiled as it stands.

    The compiler would take its loads from all over the memory eight at once, which is slower than one after the other.
    """

    def code(context, builder, signature, arguments):
        builder.asm(ir.FunctionType(ir.VoidType(), []), "", "", [], True)
        return context.get_dummy_value()

    return types.none(), code


def _fused(typing_context, a, b, c):
    """a b + c, rounded once.

    Of a sum of two products the compiler may take either into one instruction, and what it takes may change when numba
    compiles a kernel's loop a second time for its cache: a run that compiles would then differ from the next.
    """

    def code(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), code


def _root(typing_context, x):
    def code(context, builder, signature, arguments):
        return builder.call(builder.module.declare_intrinsic("llvm.sqrt", [arguments[0].type]), arguments)

    return types.float64(types.float64), code


def _bits(typing_context, x):
    def code(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), code


def _of_bits(typing_context, x):
    def code(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.int64), code


def _prefetch(typing_context, array, row):
    """Ask for the first two lines of the cache that hold row ``row`` of a float array (n, m); nothing is read yet."""

    def code(context, builder, signature, arguments):
        source = make_array(signature.args[0])(context, builder, arguments[0])
        width = builder.extract_value(source.shape, 1)
        place = builder.gep(source.data, [builder.mul(arguments[1], width)])
        word, byte = ir.IntType(32), ir.IntType(8).as_pointer()
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(ir.VoidType(), [byte, word, word, word]), "llvm.prefetch.p0"
        )
        for line in range(LINES):
            at = builder.gep(place, [ir.Constant(ir.IntType(64), 8 * line)])
            builder.call(function, [builder.bitcast(at, byte), *(ir.Constant(word, k) for k in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, types.int64), code


lane_room: Any = intrinsic(_lane_room)
one_by_one: Any = intrinsic(_one_by_one)
fused: Any = intrinsic(_fused)
prefetch_row: Any = intrinsic(_prefetch)
_root_of: Any = intrinsic(_root)
_bits_of: Any = intrinsic(_bits)
_float_of: Any = intrinsic(_of_bits)


@overload(square_root, jit_options=INTO_CALLER)
def _square_root(x):
    return lambda x: _root_of(x)


@overload(logarithm, jit_options=INTO_CALLER)
def _logarithm(x):
    """ln(2^e m) = e ln 2 + 2 artanh((m - 1)/(m + 1)), with m between sqrt(1/2) and sqrt(2): ten terms of the series."""

    def of_float(x):
        bits = _bits_of(x)
        exponent = (bits >> 52) - EXPONENT_BIAS
        m = _float_of((bits & MANTISSA) | ONE)
        large = m > 1.4142135623730951
        m = 0.5 * m if large else m
        e = float(exponent + 1) if large else float(exponent)
        s = (m - 1.0) / (m + 1.0)
        t = s * s
        series = t * (1.0 / 3.0 + t * (1.0 / 5.0 + t * (1.0 / 7.0 + t * (1.0 / 9.0 + t * (1.0 / 11.0 + t * (
            1.0 / 13.0 + t * (1.0 / 15.0 + t * (1.0 / 17.0 + t * (1.0 / 19.0)))))))))  # fmt: skip
        return e * 0.6931471805599453 + 2.0 * (s + s * series)

    return of_float
