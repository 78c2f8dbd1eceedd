"""The base of a source of the field: its table [field], and all that generic code may ask of it.

A source is one module of this package. Generic code asks the table that the scene has (`Scene.field`) and knows none by
name.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar, get_args

from pydantic import Field

from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Section
from emclutch.scene.units import Temperature
from emclutch.scene.usual_ranges import UsualRange

if TYPE_CHECKING:
    from coupling.field_source import FieldSource
    from emclutch.device_model.device import Device
    from emclutch.scene.model import Scene
    from field import MagneticField
    from field.three_d import Field3D
    from geometry.walls import Wall
    from particles import Body

Check = Callable[[PartialScene], Iterator[Fault]]


class SourceSection(Section):
    """Table [field] of a source.

    Attributes
    ----------
    CHECKS : tuple of (check, sections)
        Checks of this source against the other sections, and the sections that must be valid for each
        (`emclutch.scene.consistency`).
    is_solved : bool
        Whether the field of the device's coil is solved; else it is prescribed.
    """

    CHECKS: ClassVar[tuple[tuple[Check, tuple[str, ...]], ...]] = ()
    is_solved: ClassVar[bool] = False

    source: str
    temperature: Temperature = Field(
        default=20.0,
        description="temperature of grains and steel; their saturation falls as that of iron, by 2.8 % at 200 degC",
    )

    @classmethod
    def name(cls) -> str:
        """Return its entry of `field.source`."""
        return get_args(cls.model_fields["source"].annotation)[0]

    def usual_entries(self) -> Iterator[tuple[UsualRange, str, float]]:
        """Yield entries that have a usual range: the range, the key, and the value in the range's unit."""
        yield from ()

    @abstractmethod
    def equip(self, device: Device, scene: Scene) -> Device:
        """Return the device with what makes its field."""

    @abstractmethod
    def build(
        self,
        scene: Scene,
        device: Device,
        bodies: Sequence[Body],
        walls: Sequence[Wall],
        peak: MagneticField | Field3D | None,
    ) -> FieldSource:
        """Return the field of the coupled loop.

        Parameters
        ----------
        device : Device
            As `equip` returned it.
        bodies : sequence of Body
            Of the loop.
        walls : sequence of Wall
        peak : MagneticField, Field3D or None
            The field at the largest current, solved before the run; None where there is none.
        """
