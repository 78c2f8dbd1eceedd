"""A winding and its current in time: what every device with a coil has."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from field.coil.winding import Winding
from field.solved_field import SolvedField
from geometry.time_profile import TimeProfile

if TYPE_CHECKING:
    from emclutch.scene.model import Scene
    from geometry.device_shape import WoundShape


@dataclass(frozen=True, slots=True)
class Supply:
    """What drives a coil at a voltage.

    Attributes
    ----------
    voltage : TimeProfile
        [V].
    resistance : float
        Of the coil at its temperature [ohm].
    """

    voltage: TimeProfile
    resistance: float


def supply_of(scene: Scene, shape: WoundShape) -> Supply | None:
    """What drives the scene's coil; None: its current is prescribed."""
    coil = scene.coil
    if coil is None or coil.voltage is None or not coil.is_at_voltage:
        return None
    return Supply(coil.voltage, coil.resistance_in(shape.coil_area, shape.coil_mean_radius))


@dataclass(frozen=True, slots=True)
class Excitation(ABC):
    """A winding and its current in time.

    Attributes
    ----------
    winding : Winding
    currents : TimeProfile
        [A].
    """

    winding: Winding
    currents: TimeProfile

    @property
    def turns(self) -> float:
        """Turns of the coil."""
        return self.winding.turns

    @abstractmethod
    def pole_line(self, *, faces: bool = False) -> np.ndarray:
        """Points (r, z) [m] in the gap under the poles, at the rim or at the faces, shape (k, 2)."""

    def gap_flux_density(self, solution: SolvedField, *, faces: bool = False) -> float:
        """Mean |B| [T] of a solution in the gap under the poles, of that at the faces where `faces` says so."""
        return solution.mean_flux_density(self.pole_line(faces=faces))

    @abstractmethod
    def mesh_in_words(self) -> str:
        """Domain on which the field is solved."""

    @property
    def largest_current(self) -> float:
        """Largest |I| at any time [A]."""
        return self.currents.largest
