"""contact.law = "hertz_mindlin": elastic spheres with Tsuji's damping (`particles.laws.hertz_mindlin`)."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from emclutch.contact_laws.law_kind import LawKind, StiffnessEntry
from emclutch.scene.units import Modulus, number

_Poisson = Annotated[float, number("0.3", 0.0, 0.5)]


class HertzMindlinKind(LawKind):
    """Elastic spheres, Tsuji's damping."""

    name = "hertz_mindlin"
    summary = "elastic spheres, Tsuji's damping"
    KEYS = {
        "youngs_modulus": (
            Modulus | None,
            Field(default=None, description="of the grains; default: from max_overlap"),
        ),
        "wall_youngs_modulus": (
            Modulus | None,
            Field(default=None, description="of the walls; default: as the grains"),
        ),
        "poisson_ratio": (_Poisson | None, Field(default=None, description="of the grains; default: 0.3")),
        "wall_poisson_ratio": (
            _Poisson | None,
            Field(default=None, description="of the walls; default: as the grains"),
        ),
        "shear_modulus": (
            Modulus | None,
            Field(default=None, description="of the grains; default: E / (2 (1 + nu))"),
        ),
        "wall_shear_modulus": (
            Modulus | None,
            Field(default=None, description="of the walls; default: E / (2 (1 + nu))"),
        ),
    }
    STIFFNESS = StiffnessEntry("youngs_modulus", "Pa", "10 MPa")

    @classmethod
    def build(cls, section, at, *, wall):
        """See `LawKind.build`."""
        from particles.laws.hertz_mindlin import HertzMindlin

        grain = _grain(section, at)
        partner = _wall(section, grain) if wall else grain
        return HertzMindlin.from_restitution(
            grain, section.at("restitution", wall), section.at("friction", wall), partner=partner
        )


def _grain(section, at):
    """The grains' material; without a modulus the softest that keeps max_overlap between grains and at walls."""
    from particles.laws.elastic import Elastic
    from particles.laws.hertz_impact import stiffness_for_depth

    nu, E = 0.3 if section.poisson_ratio is None else section.poisson_ratio, section.youngs_modulus
    if E is None:
        depth = section.max_overlap * at.diameter
        contacts = ((0.5 * at.mass, 0.25 * at.diameter), (at.mass, 0.5 * at.diameter))
        E_eff = max(0.75 * stiffness_for_depth(depth, at.force, m, at.speed) / math.sqrt(r) for m, r in contacts)
        E = 2.0 * (1.0 - nu * nu) * E_eff
    return Elastic(E, nu, section.shear_modulus)


def _wall(section, grain):
    from particles.laws.elastic import Elastic

    E, nu, G = section.wall_youngs_modulus, section.wall_poisson_ratio, section.wall_shear_modulus
    if E is None and nu is None and G is None:
        return grain
    return Elastic(grain.youngs_modulus if E is None else E, grain.poisson_ratio if nu is None else nu, G)
