"""A scene that is being checked, as far as its sections are right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from emclutch.scene.errors import Fault, entry_at, shown


@dataclass(frozen=True, slots=True)
class PartialScene:
    """A scene whose sections are right one by one; those that are not are left out and listed as broken.

    Of a geometry with faults at the keys `of_geometry` the scene has a sketch, if its kind is known
    (`emclutch.scene.geometry_sketch`).
    """

    scene: Any
    data: dict[str, Any]
    broken: frozenset[str]
    of_geometry: frozenset[str] = frozenset()

    @property
    def is_of_the_field_alone(self) -> bool:
        """True if the scene has no [particles]; one whose [particles] are faulty has."""
        return self.scene.particles is None and "particles" not in self.broken

    def fault(self, key: str, message: str) -> Fault:
        """Return a fault that shows the user's entry at the key."""
        entry = entry_at(self.data, key.split("."))
        return Fault(key, "" if entry is None or isinstance(entry, dict) else shown(entry), message)


def size_key(particles: Any) -> str:
    """The key of [particles] that says how large the grains are."""
    return "sizes" if particles.sizes is not None else "packing_file" if particles.diameter is None else "diameter"
