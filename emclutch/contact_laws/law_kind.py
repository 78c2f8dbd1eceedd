"""The base of a contact law in the scene: its keys of [contact], and how it is built.

A law is one module of this package; its compiled spring is one module of `particles.laws`. Generic code asks the law
that the scene has chosen (`ContactSection.kind`) and knows none by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field

from emclutch.scene.units import LinearSpeed, Stiffness, number

if TYPE_CHECKING:
    from particles.laws.contact_law import ContactLaw

# Keys that several laws share: type and field of pydantic
STIFFNESS = (Stiffness | None, Field(default=None, description="normal stiffness; default: from max_overlap"))
WALL_STIFFNESS = (Stiffness | None, Field(default=None, description="at walls; default: as between grains"))
TANGENTIAL_RATIO = (
    Annotated[float, number("0.2857", 0.0, 2.0)] | None,
    Field(default=None, description="tangential / normal stiffness; default: 2/7, with which both have one period"),
)
REFERENCE_SPEED = (
    LinearSpeed | None,
    Field(
        default=None,
        description="impact speed with the given restitution, if it depends on speed; default: the expected speed",
    ),
)


@dataclass(frozen=True, slots=True)
class StiffnessEntry:
    """The key of `[contact]` that gives the stiffness: its name, its unit and an example."""

    name: str
    unit: str
    example: str

    def __str__(self) -> str:
        return f"contact.{self.name}, e.g. '{self.example}'"


@dataclass(frozen=True, slots=True)
class Expected:
    """What a stiffness that is not given follows from.

    Attributes
    ----------
    mass, diameter : float
        Of the largest grain [kg], [m].
    force, speed : float
        The largest load [N] and impact [m/s] to be expected.
    """

    mass: float
    diameter: float
    force: float
    speed: float


class LawKind:
    """A contact law; the methods get the table [contact] as ``section``.

    Attributes
    ----------
    name, summary : str
        The entry of `contact.law`, and what it is in a few words.
    KEYS : dict
        Its keys in addition to those of every law: (type, pydantic field) by name.
    STIFFNESS : StiffnessEntry
        The key that gives the stiffness.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    KEYS: ClassVar[dict[str, tuple[Any, Any]]]
    STIFFNESS: ClassVar[StiffnessEntry] = StiffnessEntry("stiffness", "N/m", "1000 N/m")

    @classmethod
    def check(cls, section: Any, given: set[str]) -> None:
        """Raise a pydantic error where the ``given`` keys contradict each other."""

    @classmethod
    def build(cls, section: Any, at: Expected, *, wall: bool) -> ContactLaw:
        """Return the law between grains, or at walls.

        Raises
        ------
        ValueError
            A stiffness or a reference speed is not given, and nothing is expected from which it could follow.
        """
        raise NotImplementedError


def tangential_ratio(section: Any) -> float:
    """Tangential over normal stiffness; 2/7 where it is not given."""
    return 2.0 / 7.0 if section.tangential_ratio is None else section.tangential_ratio


def linear_stiffness(section: Any, at: Expected, *, wall: bool) -> float:
    """Stiffness [N/m] as given, or such that the overlap under load and impact stays within max_overlap."""
    from particles.dem.time_step import stiffness_for_overlap  # local: the schema itself needs no particles

    given = section.at("stiffness", wall)
    if given is not None:
        return given
    return stiffness_for_overlap(at.force, at.diameter, section.max_overlap, mass=at.mass, speed=at.speed)


def hertzian_stiffness(section: Any, at: Expected) -> float:
    """k of F = k overlap^1.5 [N/m^1.5] for max_overlap, where an impact is deepest: at a wall."""
    from particles.laws.hertz_impact import stiffness_for_depth

    return stiffness_for_depth(section.max_overlap * at.diameter, at.force, at.mass, at.speed)


def reference_speed(section: Any, at: Expected) -> float:
    """Impact [m/s] at which a restitution that depends on speed is met."""
    if section.reference_speed is not None:
        return section.reference_speed
    if at.speed > 0.0:
        return at.speed
    raise ValueError(
        "nothing moves, so there is no impact at which the restitution could be met; give contact.reference_speed, "
        "e.g. '0.1 m/s'"
    )
