"""The guard against shadowing: `geometry`, `field`, `particles` and `coupling` must be ours."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

SIBLINGS = ("geometry", "field", "particles", "coupling")


def check_siblings() -> None:
    """Raise ImportError, with the file, when one of the sibling packages would be imported from elsewhere."""
    home = Path(__file__).resolve().parent.parent
    for name in SIBLINGS:
        spec = find_spec(name)
        where = None if spec is None else Path(spec.origin or next(iter(spec.submodule_search_locations or [""])))
        ours = home / name
        if where is None:
            raise ImportError(
                f"emclutch needs its package {name!r} in {ours}, which is missing; install emclutch again"
            )
        if ours not in (where.resolve(), where.resolve().parent):
            raise ImportError(
                f"{where} hides emclutch's package {name!r} in {ours}; rename or move that file, or "
                "start Python in another folder"
            )
