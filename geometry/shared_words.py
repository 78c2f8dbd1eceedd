"""Words that threads of a compiled loop share: read, written, taken and counted so that each sees what others did.

``words`` is an array of int64, ``place`` an index into it. Whoever reads a word by `seen` also sees all that its writer
had written before `tell`; `taken` and `counted` are both at once.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

LINE = 16  # words from one place to the next that another thread writes: two lines of the cache, fetched as a pair


def _pointer(context, builder, signature, arguments):
    source = make_array(signature.args[0])(context, builder, arguments[0])
    return builder.gep(source.data, [arguments[1]])


def _seen(typing_context, words, place):
    """The word at ``place``."""

    def code(context, builder, signature, arguments):
        return builder.load_atomic(_pointer(context, builder, signature, arguments), "acquire", 8)

    return types.int64(words, types.int64), code


def _tell(typing_context, words, place, value):
    """Put ``value`` at ``place``."""

    def code(context, builder, signature, arguments):
        builder.store_atomic(arguments[2], _pointer(context, builder, signature, arguments), "release", 8)
        return context.get_dummy_value()

    return types.void(words, types.int64, types.int64), code


def _taken(typing_context, words, place, before, after):
    """Whether the word was ``before`` and this thread made it ``after``: of several that try, one does."""

    def code(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature, arguments)
        answer = builder.cmpxchg(pointer, arguments[2], arguments[3], "acq_rel", "acquire")
        return builder.extract_value(answer, 1)

    return types.boolean(words, types.int64, types.int64, types.int64), code


def _counted(typing_context, words, place):
    """Add one; returns the sum."""

    def code(context, builder, signature, arguments):
        one = ir.Constant(ir.IntType(64), 1)
        before = builder.atomic_rmw("add", _pointer(context, builder, signature, arguments), one, "acq_rel")
        return builder.add(before, one)

    return types.int64(words, types.int64), code


def _give_way(typing_context):
    """Let another thread have this core."""

    def code(context, builder, signature, arguments):
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(ir.IntType(32), []), "sched_yield")
        builder.call(function, [])
        return context.get_dummy_value()

    return types.void(), code


seen: Any = intrinsic(_seen)
tell: Any = intrinsic(_tell)
taken: Any = intrinsic(_taken)
counted: Any = intrinsic(_counted)
give_way: Any = intrinsic(_give_way)
