"""The compiled springs of all laws: the law of a scene is a number in its table, which a kernel reads at run time.

A law's file has its spring (`particles.laws.contact_law` for the signature). A kernel calls `spring(table, ...)`; all
contacts of a scene follow one law, so the branch is taken once for eight contacts, and one machine code serves every
law. Only the linear law between equal grains, whose dashpots are constants, has a table and machine code of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from particles.laws.hertz import hertz_spring
from particles.laws.hertz_mindlin import hertz_mindlin_spring
from particles.laws.linear import equal_linear_spring, linear_spring
from particles.laws.thesis import thesis_spring
from particles.laws.walton_braun import walton_braun_spring

INTO_CALLER: Any = {
    "error_model": "numpy", "fastmath": {"contract"}, "forceinline": True, "no_cfunc_wrapper": True, "_nrt": False,
}  # fmt: skip

SPRINGS: dict[str, Callable] = {
    "linear": linear_spring,
    "hertz_mindlin": hertz_mindlin_spring,
    "hertz": hertz_spring,
    "thesis": thesis_spring,
    "walton_braun": walton_braun_spring,
}
LINEAR, HERTZ_MINDLIN, HERTZ, THESIS, WALTON_BRAUN = (
    list(SPRINGS).index(name) for name in ("linear", "hertz_mindlin", "hertz", "thesis", "walton_braun")
)


class LawTable(NamedTuple):
    """Parameters of a law between grains of any sizes.

    Attributes
    ----------
    rows : ndarray (rows, N_LAW)
        By pair of materials (`particles.laws.columns`).
    law : int
        Place of its spring in `SPRINGS`.
    """

    rows: np.ndarray
    law: int


class EqualLinearTable(NamedTuple):
    """Parameters of the linear law between grains of one size and mass: gamma_n, gamma_t [kg/s] instead of zetas."""

    rows: np.ndarray


def law_table(kernel: str, rows: np.ndarray) -> LawTable:
    """Build the table of the law whose spring has the name ``kernel`` in `SPRINGS`, of ``rows`` (rows, N_LAW)."""
    return LawTable(rows, list(SPRINGS).index(kernel))


def spring(table, kind, delta, m_eff, r_eff, memory):
    """The spring of a table (`particles.laws.contact_law`), in Python without the compiler."""
    force = equal_linear_spring if equal(table) else list(SPRINGS.values())[table.law]
    return getattr(force, "py_func", force)(table.rows, kind, delta, m_eff, r_eff, memory)


def with_rows(table, rows):
    """A table of the same law that reads other ``rows``."""
    return table._replace(rows=rows)


def equal(table):
    """True if a table is for grains of one size and mass; in a kernel a constant."""
    return isinstance(table, EqualLinearTable)


def varies(table):
    """True if the tangential stiffness may change while a contact lasts: the contact keeps the last one."""
    return not equal(table) and table.law != LINEAR


def remembers(table):
    """True if the spring has a memory, and no normal dashpot: what it took and does not hold is lost."""
    return not equal(table) and table.law == WALTON_BRAUN


@overload(spring, jit_options=INTO_CALLER)
def _spring(table, kind, delta, m_eff, r_eff, memory):
    def of_equal_grains(table, kind, delta, m_eff, r_eff, memory):
        return equal_linear_spring(table.rows, kind, delta, m_eff, r_eff, memory)

    def of_law(table, kind, delta, m_eff, r_eff, memory):
        if table.law == LINEAR:
            return linear_spring(table.rows, kind, delta, m_eff, r_eff, memory)
        if table.law == HERTZ_MINDLIN:
            return hertz_mindlin_spring(table.rows, kind, delta, m_eff, r_eff, memory)
        if table.law == HERTZ:
            return hertz_spring(table.rows, kind, delta, m_eff, r_eff, memory)
        if table.law == THESIS:
            return thesis_spring(table.rows, kind, delta, m_eff, r_eff, memory)
        return walton_braun_spring(table.rows, kind, delta, m_eff, r_eff, memory)

    return of_equal_grains if table.instance_class is EqualLinearTable else of_law


@overload(with_rows, jit_options=INTO_CALLER)
def _with_rows(table, rows):
    if table.instance_class is EqualLinearTable:
        return lambda table, rows: EqualLinearTable(rows)
    return lambda table, rows: LawTable(rows, table.law)


@overload(equal, jit_options=INTO_CALLER)
def _equal(table):
    return (lambda table: True) if table.instance_class is EqualLinearTable else lambda table: False


@overload(varies, jit_options=INTO_CALLER)
def _varies(table):
    return (lambda table: False) if table.instance_class is EqualLinearTable else lambda table: table.law != LINEAR


@overload(remembers, jit_options=INTO_CALLER)
def _remembers(table):
    constant = table.instance_class is EqualLinearTable
    return (lambda table: False) if constant else lambda table: table.law == WALTON_BRAUN
