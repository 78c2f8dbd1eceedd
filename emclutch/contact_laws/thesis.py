"""contact.law = "thesis": f(delta/d) (k delta - gamma m v), of the 2017 thesis (`particles.laws.thesis`)."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from emclutch.contact_laws.law_kind import (
    REFERENCE_SPEED,
    STIFFNESS,
    TANGENTIAL_RATIO,
    WALL_STIFFNESS,
    LawKind,
    hertzian_stiffness,
    linear_stiffness,
    reference_speed,
    tangential_ratio,
)
from emclutch.scene.section import Choice


class Thesis(LawKind):
    """The family f(delta/d) (k delta - gamma m v) of the thesis."""

    name = "thesis"
    summary = "f(delta/d)(k delta - gamma m v)"
    KEYS = {
        "stiffness": STIFFNESS,
        "wall_stiffness": WALL_STIFFNESS,
        "tangential_ratio": TANGENTIAL_RATIO,
        "overlap_factor": (
            Annotated[str, Choice(("sqrt", "one"))] | None,
            Field(default=None, description="thesis: f = sqrt(overlap / diameter), the default, or f = 1"),
        ),
        "reference_speed": REFERENCE_SPEED,
    }

    @classmethod
    def build(cls, section, at, *, wall):
        """See `LawKind.build`."""
        from particles.laws.thesis import ThesisContact

        rooted = section.overlap_factor != "one"
        k = section.at("stiffness", wall)
        if k is None and rooted:
            k = hertzian_stiffness(section, at) * math.sqrt(at.diameter)
        elif k is None:
            k = linear_stiffness(section, at, wall=wall)
        return ThesisContact.from_restitution(
            k,
            section.at("restitution", wall),
            section.at("friction", wall),
            diameter=at.diameter,
            exponent=0.5 if rooted else 0.0,
            m_eff=at.mass if wall else 0.5 * at.mass,
            speed=reference_speed(section, at) if rooted else 1.0,
            stiffness_t=tangential_ratio(section) * k,
        )
