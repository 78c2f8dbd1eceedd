"""Atomic operations on int64 words that the threads of a compiled loop share, with the memory orders of C++11.

``words`` is an array of int64, ``place`` an index into it. `load_acquire` sees all that the writer had written before
its `store_release`; `compare_exchange` and `fetch_add` are both acquire and release.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

WORDS_APART = (
    16  # words from one place to the next that another thread writes: two lines of the cache, fetched as a pair
)


def _pointer(context, builder, signature, arguments):
    source = make_array(signature.args[0])(context, builder, arguments[0])
    return builder.gep(source.data, [arguments[1]])


def _load_acquire(typing_context, words, place):
    """Load the word at ``place``."""

    def code(context, builder, signature, arguments):
        return builder.load_atomic(_pointer(context, builder, signature, arguments), "acquire", 8)

    return types.int64(words, types.int64), code


def _store_release(typing_context, words, place, value):
    """Store ``value`` at ``place``."""

    def code(context, builder, signature, arguments):
        builder.store_atomic(arguments[2], _pointer(context, builder, signature, arguments), "release", 8)
        return context.get_dummy_value()

    return types.void(words, types.int64, types.int64), code


def _compare_exchange(typing_context, words, place, before, after):
    """Replace ``before`` by ``after``; True if the word was ``before``. Of several threads that try, one succeeds."""

    def code(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature, arguments)
        exchanged = builder.cmpxchg(pointer, arguments[2], arguments[3], "acq_rel", "acquire")
        return builder.extract_value(exchanged, 1)

    return types.boolean(words, types.int64, types.int64, types.int64), code


def _fetch_add(typing_context, words, place, value):
    """Add ``value``; returns the word before."""

    def code(context, builder, signature, arguments):
        return builder.atomic_rmw("add", _pointer(context, builder, signature, arguments), arguments[2], "acq_rel")

    return types.int64(words, types.int64, types.int64), code


def _sched_yield(typing_context):
    """Yield the processor to another thread."""

    def code(context, builder, signature, arguments):
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(ir.IntType(32), []), "sched_yield")
        builder.call(function, [])
        return context.get_dummy_value()

    return types.void(), code


load_acquire: Any = intrinsic(_load_acquire)
store_release: Any = intrinsic(_store_release)
compare_exchange: Any = intrinsic(_compare_exchange)
fetch_add: Any = intrinsic(_fetch_add)
sched_yield: Any = intrinsic(_sched_yield)
