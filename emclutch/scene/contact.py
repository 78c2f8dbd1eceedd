"""[contact]: how grains touch each other and the walls.

Each law has its own keys, and a key of another law is refused. Whatever gives the stiffness (``stiffness``,
``hertz_stiffness``, ``youngs_modulus``) may be left out: it then follows from ``max_overlap`` under the largest load.
A ``wall_`` key is its twin at walls, and is as between grains where it is not given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field, model_validator

from emclutch.scene.dvi import DviSection
from emclutch.scene.section import Choice, Section, refuse
from emclutch.scene.units import HertzStiffness, LinearSpeed, Modulus, Stiffness, number

if TYPE_CHECKING:
    from particles.laws.contact_law import ContactLaw
    from particles.laws.elastic import Elastic

_Friction = Annotated[float, number("0.3", 0.0, 10.0)]
_Restitution = Annotated[float, number("0.5", 0.0, 1.0, above=True)]
_Poisson = Annotated[float, number("0.3", 0.0, 0.5)]

KEYS_OF_LAWS = {
    "linear": ("stiffness", "wall_stiffness", "tangential_ratio"),
    "hertz_mindlin": (
        "youngs_modulus",
        "wall_youngs_modulus",
        "poisson_ratio",
        "wall_poisson_ratio",
        "shear_modulus",
        "wall_shear_modulus",
    ),
    "hertz": ("hertz_stiffness", "wall_hertz_stiffness", "tangential_ratio", "reference_speed"),
    "thesis": ("stiffness", "wall_stiffness", "tangential_ratio", "overlap_factor", "reference_speed"),
    "walton_braun": (
        "stiffness",
        "wall_stiffness",
        "unloading_stiffness",
        "wall_unloading_stiffness",
        "tangential_ratio",
    ),
}
"""Keys beside those that every law has."""
_OWN_KEYS = {key for keys in KEYS_OF_LAWS.values() for key in keys}


@dataclass(frozen=True, slots=True)
class StiffnessEntry:
    """An entry of `[contact]` that gives the stiffness: its name there, its unit and an example."""

    name: str
    unit: str
    example: str

    def __str__(self) -> str:
        return f"contact.{self.name}, e.g. '{self.example}'"


STIFFNESS_ENTRIES = {
    "hertz_mindlin": StiffnessEntry("youngs_modulus", "Pa", "10 MPa"),
    "hertz": StiffnessEntry("hertz_stiffness", "N/m^1.5", "1e7 N/m^1.5"),
}
"""By law; of all others it is `stiffness`."""


class ContactSection(Section):
    """Spring, dashpot and Coulomb friction; the stiffness follows from the overlap that is allowed, unless given."""

    method: Annotated[str, Choice(("dem", "dvi"))] = Field(
        default="dem",
        description="dem: grains press in, step by contact; dvi: rigid grains, impulses that obey Coulomb's law, "
        "longer steps",
    )
    law: Annotated[str, Choice(tuple(KEYS_OF_LAWS))] = Field(
        default="linear",
        description="linear: spring and dashpot; hertz_mindlin: elastic spheres, Tsuji's damping; hertz: k delta^1.5 "
        "and a linear dashpot; thesis: f(delta/d)(k delta - gamma m v); walton_braun: stiffer when it unloads",
    )
    dvi: DviSection = Field(default=DviSection(), description="solver of rigid contacts, read with method = 'dvi' only")
    friction: _Friction = Field(default=0.3, description="between grains")
    wall_friction: _Friction | None = Field(default=None, description="between grain and wall; default: friction")
    restitution: _Restitution = Field(default=0.5, description="speed after / before a head-on collision")
    wall_restitution: _Restitution | None = Field(default=None, description="at walls; default: restitution")
    max_overlap: Annotated[float, number("0.005", 1e-5, 0.05)] = Field(
        default=0.005, description="overlap / diameter allowed under the largest load to be expected"
    )
    stiffness: Stiffness | None = Field(default=None, description="normal stiffness; default: from max_overlap")
    wall_stiffness: Stiffness | None = Field(default=None, description="at walls; default: as between grains")
    tangential_ratio: Annotated[float, number("0.2857", 0.0, 2.0)] | None = Field(
        default=None, description="tangential / normal stiffness; default: 2/7, with which both have one period"
    )
    unloading_stiffness: Stiffness | None = Field(
        default=None, description="walton_braun: its ratio to stiffness is 1 / restitution^2; instead of restitution"
    )
    wall_unloading_stiffness: Stiffness | None = Field(default=None, description="at walls; default: as between grains")
    hertz_stiffness: HertzStiffness | None = Field(
        default=None, description="k of F = k overlap^1.5; default: from max_overlap"
    )
    wall_hertz_stiffness: HertzStiffness | None = Field(default=None, description="at walls; default: between grains")
    overlap_factor: Annotated[str, Choice(("sqrt", "one"))] | None = Field(
        default=None, description="thesis: f = sqrt(overlap / diameter), the default, or f = 1"
    )
    reference_speed: LinearSpeed | None = Field(
        default=None,
        description="impact that has the restitution, where that depends on speed; default: expected",
    )
    youngs_modulus: Modulus | None = Field(default=None, description="of the grains; default: from max_overlap")
    wall_youngs_modulus: Modulus | None = Field(default=None, description="of the walls; default: as the grains")
    poisson_ratio: _Poisson | None = Field(default=None, description="of the grains; default: 0.3")
    wall_poisson_ratio: _Poisson | None = Field(default=None, description="of the walls; default: as the grains")
    shear_modulus: Modulus | None = Field(default=None, description="of the grains; default: E / (2 (1 + nu))")
    wall_shear_modulus: Modulus | None = Field(default=None, description="of the walls; default: E / (2 (1 + nu))")

    @model_validator(mode="after")
    def _has_the_keys_of_its_law(self) -> Self:
        given = {key for key in self.model_fields_set if getattr(self, key) is not None}
        foreign = sorted(given & _OWN_KEYS - set(KEYS_OF_LAWS[self.law]))
        if foreign:
            others = f" (nor {', '.join(foreign[1:])})" if foreign[1:] else ""
            laws = " or ".join(f"'{law}'" for law, keys in KEYS_OF_LAWS.items() if foreign[0] in keys)
            raise refuse(
                f"does not belong to contact.law = '{self.law}'{others}; remove it, or take law = {laws}",
                key=foreign[0],
            )
        for place in ("", "wall_"):
            self._check_unloading(place, given)
        return self

    def _check_unloading(self, place: str, given: set[str]) -> None:
        """An unloading stiffness says what the restitution is, and it is kept as that."""
        unloading, stiffness = (getattr(self, f"{place}{key}") for key in ("unloading_stiffness", "stiffness"))
        if unloading is None:
            return
        key, twin = f"{place}unloading_stiffness", f"{place}restitution"
        loading = self.stiffness if stiffness is None else stiffness
        if loading is None:
            raise refuse("needs stiffness beside it; give it, e.g. '10 kN/m'", key=key)
        if unloading < loading:
            raise refuse(f"is below the stiffness {loading:g} N/m of loading; allowed: that or more", key=key)
        e = math.sqrt(loading / unloading)
        if twin in given and not math.isclose(getattr(self, twin), e, rel_tol=1e-9):
            raise refuse(f"stands beside {twin}, but makes it sqrt(stiffness / it) = {e:.4g}; keep one", key=key)
        object.__setattr__(self, twin, e)  # frozen to all but its own making

    @property
    def friction_at_walls(self) -> float:
        """Coefficient of friction between grain and wall."""
        return self.friction if self.wall_friction is None else self.wall_friction

    @property
    def stiffness_entry(self) -> StiffnessEntry:
        """The entry of this table that gives the stiffness."""
        return STIFFNESS_ENTRIES.get(self.law, StiffnessEntry("stiffness", "N/m", "1000 N/m"))

    @property
    def needs_a_load(self) -> bool:
        """True if the stiffness is left to follow from the largest load."""
        given = {"hertz_mindlin": self.youngs_modulus, "hertz": self.hertz_stiffness}.get(self.law, self.stiffness)
        return given is None

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
        return self._law(False, mass, diameter, force, speed), self._law(True, mass, diameter, force, speed)

    def _law(self, wall: bool, mass: float, diameter: float, force: float, speed: float) -> ContactLaw:
        # local: the schema itself needs no particles
        from particles.dem.time_step import stiffness_for_overlap
        from particles.laws.hertz import HertzContact
        from particles.laws.hertz_mindlin import HertzMindlin
        from particles.laws.linear import LinearContact
        from particles.laws.thesis import ThesisContact
        from particles.laws.walton_braun import WaltonBraun

        friction = self.friction_at_walls if wall else self.friction
        e = self._at("restitution", wall)
        m_eff = mass if wall else 0.5 * mass
        ratio = 2.0 / 7.0 if self.tangential_ratio is None else self.tangential_ratio

        if self.law == "hertz_mindlin":
            grain = self._grain(mass, diameter, force, speed)
            return HertzMindlin.from_restitution(grain, e, friction, partner=self._wall(grain) if wall else grain)
        if self.law == "hertz":
            k = self._at("hertz_stiffness", wall) or self._hertzian(mass, diameter, force, speed)
            return HertzContact.from_restitution(
                k, e, friction, m_eff=m_eff, speed=self._reference(speed), stiffness_t=1.5 * ratio * k
            )
        k_n, rooted = self._at("stiffness", wall), self.law == "thesis" and self.overlap_factor != "one"
        if k_n is None and rooted:
            k_n = self._hertzian(mass, diameter, force, speed) * math.sqrt(diameter)
        elif k_n is None:
            k_n = stiffness_for_overlap(force, diameter, self.max_overlap, mass=mass, speed=speed)
        k_t = ratio * k_n
        if self.law == "thesis":
            return ThesisContact.from_restitution(
                k_n, e, friction, diameter=diameter, exponent=0.5 if rooted else 0.0, m_eff=m_eff,
                speed=self._reference(speed) if rooted else 1.0, stiffness_t=k_t,
            )  # fmt: skip
        if self.law == "linear":
            return LinearContact.from_restitution(k_n, e, friction, stiffness_t=k_t)
        if self.law == "walton_braun":
            return WaltonBraun.from_restitution(k_n, e, friction, stiffness_t=k_t)
        raise AssertionError(f"contact.law = '{self.law}' makes no class")

    def _hertzian(self, mass: float, diameter: float, force: float, speed: float) -> float:
        """k of F = k overlap^1.5 [N/m^1.5] for max_overlap, where an impact is deepest: at a wall."""
        from particles.laws.hertz_impact import stiffness_for_depth

        return stiffness_for_depth(self.max_overlap * diameter, force, mass, speed)

    def _grain(self, mass: float, diameter: float, force: float, speed: float) -> Elastic:
        """The grains' material; without a modulus the softest that keeps max_overlap between grains and at walls."""
        from particles.laws.elastic import Elastic
        from particles.laws.hertz_impact import stiffness_for_depth

        nu, E = 0.3 if self.poisson_ratio is None else self.poisson_ratio, self.youngs_modulus
        if E is None:
            depth = self.max_overlap * diameter
            contacts = ((0.5 * mass, 0.25 * diameter), (mass, 0.5 * diameter))
            E_eff = max(0.75 * stiffness_for_depth(depth, force, m, speed) / math.sqrt(r) for m, r in contacts)
            E = 2.0 * (1.0 - nu * nu) * E_eff
        return Elastic(E, nu, self.shear_modulus)

    def _wall(self, grain: Elastic) -> Elastic:
        from particles.laws.elastic import Elastic

        E, nu, G = self.wall_youngs_modulus, self.wall_poisson_ratio, self.wall_shear_modulus
        if E is None and nu is None and G is None:
            return grain
        return Elastic(grain.youngs_modulus if E is None else E, grain.poisson_ratio if nu is None else nu, G)

    def _at(self, key: str, wall: bool) -> Any:
        """The entry between grains, or its twin at walls where that is given."""
        own = getattr(self, f"wall_{key}") if wall else None
        return getattr(self, key) if own is None else own

    def _reference(self, speed: float) -> float:
        if self.reference_speed is not None:
            return self.reference_speed
        if speed > 0.0:
            return speed
        raise ValueError(
            "nothing moves, so there is no impact at which the restitution could be met; give contact.reference_speed, "
            "e.g. '0.1 m/s'"
        )
