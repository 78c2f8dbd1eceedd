"""The compiled springs, a line a law; a kernel takes the one that belongs to the type of its table.

A law's file has its spring (`particles.laws.contact_law` for the signature) and a table: a NamedTuple of the array
that the spring reads, a type of its own. A kernel that is given the table calls `spring(table, ...)`: numba asks for
the machine code of that type, so only one law is compiled, and nothing else in a kernel knows which.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from numba.extending import overload

from particles.laws.hertz import HertzTable, hertz_spring
from particles.laws.hertz_mindlin import HertzMindlinTable, hertz_mindlin_spring
from particles.laws.linear import EqualLinearTable, LinearTable, equal_linear_spring, linear_spring
from particles.laws.thesis import ThesisTable, thesis_spring
from particles.laws.walton_braun import WaltonBraunTable, walton_braun_spring

INTO_CALLER: Any = {
    "error_model": "numpy", "fastmath": {"contract"}, "forceinline": True, "no_cfunc_wrapper": True, "_nrt": False,
}  # fmt: skip


class Spring(NamedTuple):
    """A compiled spring and what the contact must do for it.

    Attributes
    ----------
    table : type
        NamedTuple with the one field ``rows`` (rows, N_LAW), which the spring reads.
    force : callable
        The compiled function.
    varies : bool
        Its tangential stiffness may change while a contact lasts: the contact keeps the last one.
    remembers : bool
        It has a memory, and no normal dashpot: what it took and does not hold is lost.
    equal : bool
        It holds for grains of one size and mass only.
    """

    table: Any
    force: Any
    varies: bool = True
    remembers: bool = False
    equal: bool = False


SPRINGS = {
    "linear": Spring(LinearTable, linear_spring, varies=False),
    "hertz_mindlin": Spring(HertzMindlinTable, hertz_mindlin_spring),
    "hertz": Spring(HertzTable, hertz_spring),
    "thesis": Spring(ThesisTable, thesis_spring),
    "walton_braun": Spring(WaltonBraunTable, walton_braun_spring, remembers=True),
}
EQUAL_LINEAR = Spring(EqualLinearTable, equal_linear_spring, varies=False, equal=True)
OF_TABLE = {one.table: one for one in (*SPRINGS.values(), EQUAL_LINEAR)}


def spring(table, kind, delta, m_eff, r_eff, memory):
    """The spring of a table's type; in Python as in a kernel."""
    return OF_TABLE[type(table)].force(table, kind, delta, m_eff, r_eff, memory)


def with_rows(table, rows):
    """A table of the same law that reads other ``rows``; in Python as in a kernel."""
    return type(table)(rows)


def varies(table):
    """True if the tangential stiffness of a table's spring may change (`Spring`); in a kernel a constant."""
    return OF_TABLE[type(table)].varies


def remembers(table):
    """True if a table's spring has a memory (`Spring`); in a kernel a constant."""
    return OF_TABLE[type(table)].remembers


def equal(table):
    """True if a table is for grains of one size and mass (`Spring`); in a kernel a constant."""
    return OF_TABLE[type(table)].equal


@overload(spring, jit_options=INTO_CALLER)
def _spring(table, kind, delta, m_eff, r_eff, memory):
    force = OF_TABLE[table.instance_class].force

    def of_type(table, kind, delta, m_eff, r_eff, memory):
        return force(table, kind, delta, m_eff, r_eff, memory)

    return of_type


@overload(with_rows, jit_options=INTO_CALLER)
def _with_rows(table, rows):
    made = table.instance_class

    def of_type(table, rows):
        return made(rows)

    return of_type


def _constant(question: Callable, name: str) -> None:
    """Let kernels ask what is True of a table's spring: a constant, whose branches the compiler leaves out."""

    @overload(question, jit_options=INTO_CALLER)
    def answer(table):
        value = getattr(OF_TABLE[table.instance_class], name)

        def of_type(table):
            return value

        return of_type


for _question in (varies, remembers, equal):
    _constant(_question, _question.__name__)
