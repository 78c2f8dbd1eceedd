"""[contact]: how grains touch each other and the walls.

Each law has its own keys (`emclutch.contact_laws`), and a key of another law is refused. Whatever gives the stiffness
(``stiffness``, ``hertz_stiffness``, ``youngs_modulus``) may be left out: it then follows from ``max_overlap`` under the
largest load. A ``wall_`` key is its twin at walls, and is as between grains where it is not given.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field, StrictBool, create_model, model_validator

from emclutch.contact_laws import KEYS, LAWS, LawKind
from emclutch.contact_laws.law_kind import Expected, StiffnessEntry
from emclutch.scene.section import Automatic, Choice, Integer, Section, refuse
from emclutch.scene.units import LinearSpeed, Time, number
from emclutch.scene.usual_ranges import USUAL_FRICTION

if TYPE_CHECKING:
    from particles.laws.contact_law import ContactLaw


class DviSection(Section):
    """Solver of the rigid contacts. It may stand in a scene by DEM too: a study may then change the method alone."""

    friction_law: Annotated[str, Choice(("coulomb", "convex"))] = Field(
        default="coulomb",
        description="coulomb: exact; convex: the cone complementarity of Project Chrono, which lifts sliding grains",
    )
    solver: Annotated[str, Choice(("accelerated", "gauss_seidel"))] = Field(
        default="accelerated",
        description="accelerated: Gauss-Seidel sweeps, accelerated where they stall; gauss_seidel: sweeps alone",
    )
    springs: StrictBool = Field(
        default=True,
        description="contacts are compliant, with the scene's stiffness taken implicitly: jams have finite forces, and "
        "those of packings are unique at moderate friction and steps; false: perfectly rigid",
    )
    tolerance: Annotated[LinearSpeed | None, Automatic()] = Field(
        default=None, description="on the natural map of every contact; default: 1e-4 of the slip speed"
    )
    max_sweeps: Annotated[int, Integer(1, 1_000_000, "500")] = Field(
        default=500, description="sweeps over all contacts that a step may take"
    )
    # A tenth: the centrifugal clutch of cases/thesis/centrifugal_held.toml at 400 rpm, torque from 0.8 to 1.3 s, by
    # max_sweeps (2026-11-23). Misses of less than 1 %: 241.0 +- 1.1 N m (11 runs); 11 to 12 %: 239.3 (2); 60 %: 243.8
    # (2); 94 %: 231.8 (2); 98 %: 217 (1), and of 14 runs with 94 % and more 10 stopped for overlaps. So a tenth costs
    # less than the 1.5 % that these runs can resolve.
    allowed_misses: Annotated[float, number("0.1", 0.0, 1.0)] = Field(
        default=0.1,
        description="fraction of the steps that may miss the tolerance before the run is stopped",
    )
    step: Annotated[Time | None, Automatic()] = Field(
        default=None,
        description="step of the rigid grains; default: time.step, else by the rules of travel and force",
        examples=["5 us"],
    )
    allow_long_step: StrictBool = Field(default=False, description="take a step that is longer than the rules allow")
    theta: Annotated[float, number("1", 0.5, 1.0)] = Field(
        default=1.0, description="weight of the new velocity in a step's drift"
    )
    threshold: Annotated[LinearSpeed | None, Automatic()] = Field(
        default=None, description="approach below which nothing rebounds; default: 2 h g, at least 1 mm/s"
    )


_Friction = Annotated[float, number("0.3", 0.0, 10.0)]
_Restitution = Annotated[float, number("0.5", 0.0, 1.0, above=True)]
_COHESION = tuple(
    (name, f"is a cohesion, not a contact law; add [effects.cohesion] with model = '{name}' to a law")
    for name in ("jkr", "dmt")
)


class BaseContactSection(Section):
    """Keys of [contact] that every law has."""

    method: Annotated[str, Choice(("dem", "dvi"))] = Field(
        default="dem",
        description="dem: contacts are springs and dashpots, with small steps; dvi: contacts obey Coulomb's "
        "law, rigid or with springs, with longer steps",
    )
    law: Annotated[str, Choice(tuple(LAWS), elsewhere=_COHESION)] = Field(
        default="linear", description="; ".join(f"{name}: {law.summary}" for name, law in LAWS.items())
    )
    dvi: DviSection = Field(default=DviSection(), description="solver of rigid contacts, read with method = 'dvi' only")
    friction: _Friction = Field(default=USUAL_FRICTION, description="between grains")
    wall_friction: _Friction | None = Field(default=None, description="between grain and wall; default: friction")
    restitution: _Restitution = Field(default=0.5, description="speed after / before a head-on collision")
    wall_restitution: _Restitution | None = Field(default=None, description="at walls; default: restitution")
    max_overlap: Annotated[float, number("0.005", 1e-5, 0.05)] = Field(
        default=0.005, description="overlap / diameter allowed under the largest load to be expected"
    )

    @model_validator(mode="after")
    def _has_the_keys_of_its_law(self) -> Self:
        given = {key for key in self.model_fields_set if getattr(self, key) is not None}
        foreign = sorted(given & KEYS.keys() - self.kind.KEYS.keys())
        if foreign:
            others = f" (nor {', '.join(foreign[1:])})" if foreign[1:] else ""
            laws = " or ".join(f"'{name}'" for name, law in LAWS.items() if foreign[0] in law.KEYS)
            raise refuse(
                f"does not belong to contact.law = '{self.law}'{others}; remove it, or take law = {laws}",
                key=foreign[0],
            )
        self.kind.check(self, given)
        return self

    @property
    def kind(self) -> type[LawKind]:
        """The law that is chosen."""
        return LAWS[self.law]

    @property
    def friction_at_walls(self) -> float:
        """Coefficient of friction between grain and wall."""
        return self.at("friction", wall=True)

    @property
    def stiffness_entry(self) -> StiffnessEntry:
        """The key that gives the stiffness."""
        return self.kind.STIFFNESS

    @property
    def needs_a_load(self) -> bool:
        """True if the stiffness is left to follow from the largest load."""
        return getattr(self, self.stiffness_entry.name) is None

    def laws(
        self, *, mass: float, diameter: float, force: float = 0.0, speed: float = 0.0
    ) -> tuple[ContactLaw, ContactLaw]:
        """Return the laws between grains and at walls.

        Parameters
        ----------
        mass, diameter : of a grain [kg], [m]
        force, speed : the largest load [N] and impact [m/s] to be expected: they set a stiffness that is not given,
            and the speed at which a restitution that depends on it is met

        Raises
        ------
        ValueError
            If a stiffness or a reference speed is not given and nothing is expected that it could follow from.
        """
        at = Expected(mass, diameter, force, speed)
        return self.kind.build(self, at, wall=False), self.kind.build(self, at, wall=True)

    def at(self, key: str, wall: bool) -> Any:
        """Return the entry between grains, or its twin at walls where that is wanted and given."""
        own = getattr(self, f"wall_{key}") if wall else None
        return getattr(self, key) if own is None else own


if TYPE_CHECKING:

    class ContactSection(BaseContactSection):
        """The table [contact]."""

        def __getattr__(self, name: str) -> Any: ...

else:
    ContactSection = create_model(
        "ContactSection",
        __base__=BaseContactSection,
        __doc__="Contact law and Coulomb friction; unless given the stiffness follows from the allowed overlap.",
        **KEYS,
    )
