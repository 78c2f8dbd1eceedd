"""contact.law = "hertz": k delta^1.5 and a linear dashpot (`particles.laws.hertz`)."""

from __future__ import annotations

from pydantic import Field

from emclutch.contact_laws.law_kind import (
    REFERENCE_SPEED,
    TANGENTIAL_RATIO,
    LawKind,
    StiffnessEntry,
    hertzian_stiffness,
    reference_speed,
    tangential_ratio,
)
from emclutch.scene.units import HertzStiffness


class Hertz(LawKind):
    """Hertzian spring and linear dashpot."""

    name = "hertz"
    summary = "k delta^1.5 and a linear dashpot"
    KEYS = {
        "hertz_stiffness": (
            HertzStiffness | None,
            Field(default=None, description="k of F = k overlap^1.5; default: from max_overlap"),
        ),
        "wall_hertz_stiffness": (
            HertzStiffness | None,
            Field(default=None, description="at walls; default: between grains"),
        ),
        "tangential_ratio": TANGENTIAL_RATIO,
        "reference_speed": REFERENCE_SPEED,
    }
    STIFFNESS = StiffnessEntry("hertz_stiffness", "N/m^1.5", "1e7 N/m^1.5")

    @classmethod
    def build(cls, section, at, *, wall):
        """See `LawKind.build`."""
        from particles.laws.hertz import HertzContact

        k = section.at("hertz_stiffness", wall) or hertzian_stiffness(section, at)
        return HertzContact.from_restitution(
            k,
            section.at("restitution", wall),
            section.at("friction", wall),
            m_eff=at.mass if wall else 0.5 * at.mass,
            speed=reference_speed(section, at),
            stiffness_t=1.5 * tangential_ratio(section) * k,
        )
