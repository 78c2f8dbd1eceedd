"""Keys of a scene that have got another name: the former one is read for one version more, with a warning."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from emclutch.scene.errors import Fault, shown

RENAMED = {
    "contact.dvi.insist": "contact.dvi.allow_long_step",
    "geometry.in_space": "geometry.three_dimensional",
    "output.energies": "output.energy_budget",
}
"""Former keys and those of now, in the same table; version 0.2 drops the former ones."""


def current_key(key: str) -> str:
    """A dotted key by its name of now."""
    return RENAMED.get(key, key)


def rename_keys(data: dict[str, Any]) -> tuple[dict[str, str], list[Fault]]:
    """Give the entries of a scene the names of now, in place.

    Returns the names of now that were written by their former ones, now -> former, and a fault where both are given.
    """
    renamed, faults = {}, []
    for former, now in RENAMED.items():
        *tables, old = former.split(".")
        table: Any = data
        for name in tables:
            table = table.get(name) if isinstance(table, dict) else None
        if not isinstance(table, dict) or old not in table:
            continue
        new = now.rpartition(".")[2]
        if new in table:
            reason = f"is the former name of {now}, which is given too; remove it"
            faults.append(Fault(former, shown(table[old]), reason))
            continue
        table[new] = table.pop(old)
        renamed[now] = former
    return renamed, faults


def renaming_warnings(renamed: dict[str, str]) -> list[str]:
    """What is to be said of keys that were written by their former names, see `rename_keys`."""
    return [f"{former} is now called {now}; the former name is read for one version more"
            for now, former in renamed.items()]  # fmt: skip


def as_written(faults: list[Fault], renamed: dict[str, str]) -> list[Fault]:
    """Faults under the keys that stand in the file."""
    return [replace(fault, key=renamed[fault.key], message=f"{fault.message} (the key is now called {fault.key})")
            if fault.key in renamed else fault for fault in faults]  # fmt: skip
