"""The base of an effect: its table of the scene, and all that generic code may ask of it.

An effect is one module of this package. Generic code loops over the effects that a scene has (`EffectsSection.present`)
or over all (`EFFECTS`), or asks for the one with a role (`EffectsSection.attraction`, ...); it knows none by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from emclutch.results.columns import Column
from emclutch.scene.errors import Fault
from emclutch.scene.section import Section
from emclutch.scene.usual_ranges import UsualRange

if TYPE_CHECKING:
    import pandas

    from coupling import Effect, Simulation
    from emclutch.device_model.device import Device
    from emclutch.effects.omitted_effect import OmittedEffect
    from emclutch.scene.model import Scene
    from emclutch.scene.partial_scene import PartialScene
    from emclutch.simulation.forecast.regime import Regime
    from particles import Body

Check = Callable[["PartialScene"], Iterator[Fault]]


@dataclass(frozen=True, slots=True)
class Load:
    """A force that presses grains together.

    Attributes
    ----------
    source : str
        Name of the effect that causes it, or "magnetism".
    force : float
        The largest on one contact that is to be expected [N].
    text : str
        Its cause in words, after "from".
    """

    source: str
    force: float
    text: str


class EffectSection(Section):
    """Table [effects.NAME]; the defaults below are those of an effect that asks for nothing.

    Attributes
    ----------
    name, summary : str
        The key in the scene, and what it is in a few words.
    role : str
        What generic code finds it by, where it must: `attraction`, `feedback`, `images`, `weight`, `rolling`,
        `circuit`, `eddy`, `drag`, `memory`, `thermal`.
    CHECKS : tuple of (check, sections)
        Checks between sections, and the sections that must be valid for each (`emclutch.scene.consistency`).
    USUAL : dict of str to UsualRange
        Usual ranges by key; a value outside gives a warning.
    needs_field : bool
        Whether the scene must have a [field].
    needs_moments : bool
        Whether it acts on magnetised grains: the field is sampled at them.
    has_lagged_forces : bool
        Whether it adds to the lagged forces, which are constant over several steps.
    saturates : bool
        Whether the grains' law saturates.
    of_the_field_alone : bool
        Whether a scene without [particles] may have it.
    acts_on_grains : bool
        Whether a run of the grains depends on it.
    not_in_3d : str
        Why it cannot be computed in a 3D field; empty where it can.
    window_solves : float
        Solves of the field in a window that it calls for, in units of a static one.
    neighbour_ns : float
        Processor time of one of a grain's `neighbours` in an evaluation of the magnetic forces [ns].
    size_note : str
        How its stress depends on the size of the grains, where it does.
    changes_stress : bool
        Whether powder has another shear stress with it than that of its law (`forecast.powder_law`).
    has_scale : bool
        Whether the stress with it depends on the diameter and the saturation of the grains.
    columns : tuple of Column
        Those that it adds to the history.
    """

    name: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    role: ClassVar[str] = ""
    CHECKS: ClassVar[tuple[tuple[Check, tuple[str, ...]], ...]] = ()
    USUAL: ClassVar[dict[str, UsualRange]] = {}
    needs_field: ClassVar[bool] = False
    needs_moments: ClassVar[bool] = False
    has_lagged_forces: ClassVar[bool] = False
    saturates: ClassVar[bool] = False
    of_the_field_alone: ClassVar[bool] = False
    acts_on_grains: ClassVar[bool] = True
    not_in_3d: ClassVar[str] = ""
    window_solves: ClassVar[float] = 0.0
    neighbour_ns: ClassVar[float] = 0.0
    size_note: ClassVar[str] = ""
    changes_stress: ClassVar[bool] = False
    has_scale: ClassVar[bool] = False
    columns: ClassVar[tuple[Column, ...]] = ()

    @classmethod
    def omitted_effects(cls, at: Regime) -> Iterator[OmittedEffect]:
        """Yield the omitted effect of a scene without it, with the criterion of its significance."""
        yield from ()

    def limits(self, scene: Scene, field_strength: float) -> Iterator[str]:
        """Yield why a mean field in the powder [A/m] is outside of what the effect's model holds for."""
        return iter(())

    def warnings(self, scene: Scene) -> Iterator[str]:
        """Yield what is allowed and yet likely not meant."""
        yield from ()

    def loads(self, scene: Scene, device: Device, M_max: float) -> Iterator[Load]:
        """Yield forces that press grains together; ``M_max`` is the largest magnetisation to be expected [A/m]."""
        yield from ()

    def step_ns(self) -> float:
        """Return the processor time that it adds to each grain and step of DEM [ns], on the machine of `cost`."""
        return 0.0

    def neighbours(self, scene: Scene, device: Device) -> float:
        """Return the other grains that act on one besides its contacts: the rows that are kept of each."""
        return 0.0

    def contact_terms(self) -> dict[str, Any]:
        """Return parts of every contact, by the keyword of `particles.PairLaws.of_one`."""
        return {}

    def summarise(self, history: pandas.DataFrame, simulation: Simulation) -> dict[str, Any]:
        """Entries of ``summary.json`` at the end of a run."""
        return {}

    def acting(self, scene: Scene, bodies: Sequence[Body]) -> Iterator[Effect]:
        """Yield the objects that act in the coupled loop (`coupling.effects`); ``bodies`` are those of the walls."""
        yield from ()
