"""Keys of a scene that have got another name: the former one is read for one version more, with a warning."""

from __future__ import annotations

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


def rename_keys(data: dict[str, Any]) -> tuple[list[str], list[Fault]]:
    """Give the entries of a scene the names of now, in place; the warnings, and a fault where both names are given."""
    warnings, faults = [], []
    for former, now in RENAMED.items():
        *tables, old = former.split(".")
        table: Any = data
        for name in tables:
            table = table.get(name) if isinstance(table, dict) else None
        if not isinstance(table, dict) or old not in table:
            continue
        new = now.rpartition(".")[2]
        if new in table:
            faults.append(
                Fault(former, shown(table[old]), f"is the former name of {now}, which is given too; remove it")
            )
            continue
        table[new] = table.pop(old)
        warnings.append(f"{former} is now called {now}; the former name is read for one version more")
    return warnings, faults
