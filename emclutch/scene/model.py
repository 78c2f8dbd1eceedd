"""The scene as a whole. A scene file is this model in TOML."""

from __future__ import annotations

import unicodedata
from typing import Annotated, Any

from pydantic import AfterValidator, Field, StringConstraints

from emclutch.devices import Geometry
from emclutch.effects import EffectsSection
from emclutch.scene.coil import CoilSection
from emclutch.scene.contact import ContactSection
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.grains import ParticlesSection
from emclutch.scene.materials import Material
from emclutch.scene.motion import MotionSection
from emclutch.scene.section import Integer, Section, refuse
from emclutch.scene.surfaces import SurfaceSection
from emclutch.scene.timing import AccuracySection, OutputSection, TimeSection
from emclutch.sources import FieldSection

_Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]


def _one_line(title: str) -> str:
    """Reject control characters, which a terminal would execute."""
    if any(unicodedata.category(letter) == "Cc" for letter in title):
        raise refuse("has line breaks or other control characters; write one line of text")
    return title


NO_GRAINS = Fault(
    "particles",
    "",
    "is missing: this scene describes the field alone, and the command needs grains; add [particles], with [time] and "
    "the effects that act on grains, or solve the field: emclutch field",
)


class HeaderSection(Section):
    """[scene]: what the scene is."""

    title: Annotated[str, AfterValidator(_one_line)] = Field(min_length=1, max_length=200, description="a line of text")
    description: str = Field(default="", description="question of the scene and expected result")
    seed: Annotated[int, Integer(0, 2**63 - 1, "1")] = Field(
        default=1, description="seed of the random numbers for the packing"
    )


class Scene(Section):
    """A scene of an electromagnetic particle clutch. Quantities: text with a unit, or a bare SI number.

    Without [particles] it is of the field alone, that of its coil: commands that move grains refuse it.
    """

    scene: HeaderSection
    geometry: Geometry
    materials: dict[_Name, Material] = Field(default={}, description='own materials by name, e.g. table = "file.csv"')
    surfaces: dict[_Name, SurfaceSection] = Field(
        default={}, description="surfaces from files that grains touch as well"
    )
    coil: CoilSection | None = None
    field: FieldSection | None = None
    particles: ParticlesSection | None = None
    contact: ContactSection = ContactSection()
    motion: MotionSection = MotionSection()
    effects: EffectsSection = EffectsSection()
    time: TimeSection | None = None
    accuracy: AccuracySection = AccuracySection()
    output: OutputSection = OutputSection()

    @property
    def grains(self) -> ParticlesSection:
        """[particles], where grains are asked for; SceneError in a scene of the field alone."""
        if self.particles is None:
            raise SceneError([NO_GRAINS])
        return self.particles

    @property
    def span(self) -> TimeSection:
        """[time], where grains move; SceneError in a scene of the field alone."""
        if self.time is None:
            raise SceneError([NO_GRAINS])
        return self.time

    def shape(self) -> Any:
        """Return the device's shape, for meshing, walls and volumes (`geometry.device_shape`)."""
        return self.geometry.shape_in(self)

    @property
    def coil_field(self) -> Any:
        """[field] where the field of the coil is solved; None where it is prescribed, or there is none."""
        return self.field if self.field is not None and self.field.is_solved else None

    @property
    def prescribed_field(self) -> Any:
        """[field] where it is prescribed; None where it is solved, or there is none."""
        return None if self.field is None or self.field.is_solved else self.field
