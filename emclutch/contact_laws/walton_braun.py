"""contact.law = "walton_braun": a spring that is stiffer when it unloads (`particles.laws.walton_braun`)."""

from __future__ import annotations

import math

from pydantic import Field

from emclutch.contact_laws.law_kind import (
    STIFFNESS,
    TANGENTIAL_RATIO,
    WALL_STIFFNESS,
    LawKind,
    linear_stiffness,
    tangential_ratio,
)
from emclutch.scene.section import refuse
from emclutch.scene.units import Stiffness


class WaltonBraunKind(LawKind):
    """Hysteretic spring: stiffer when it unloads."""

    name = "walton_braun"
    summary = "stiffer when it unloads"
    KEYS = {
        "stiffness": STIFFNESS,
        "wall_stiffness": WALL_STIFFNESS,
        "unloading_stiffness": (
            Stiffness | None,
            Field(
                default=None,
                description="walton_braun: its ratio to stiffness is 1 / restitution^2; instead of restitution",
            ),
        ),
        "wall_unloading_stiffness": (
            Stiffness | None,
            Field(default=None, description="at walls; default: as between grains"),
        ),
        "tangential_ratio": TANGENTIAL_RATIO,
    }

    @classmethod
    def check(cls, section, given):
        """Take the restitution from an unloading stiffness, and refuse one that contradicts it."""
        for place in ("", "wall_"):
            unloading, stiffness = (getattr(section, f"{place}{key}") for key in ("unloading_stiffness", "stiffness"))
            if unloading is None:
                continue
            key, twin = f"{place}unloading_stiffness", f"{place}restitution"
            loading = section.stiffness if stiffness is None else stiffness
            if loading is None:
                raise refuse("needs stiffness as well; give it, e.g. '10 kN/m'", key=key)
            if unloading < loading:
                raise refuse(f"is below the stiffness {loading:g} N/m of loading; allowed: that or more", key=key)
            e = math.sqrt(loading / unloading)
            if twin in given and not math.isclose(getattr(section, twin), e, rel_tol=1e-9):
                raise refuse(f"conflicts with {twin}: it makes it sqrt(stiffness / it) = {e:.4g}; keep one", key=key)
            object.__setattr__(section, twin, e)  # frozen to all but its own making

    @classmethod
    def build(cls, section, at, *, wall):
        """See `LawKind.build`."""
        from particles.laws.walton_braun import WaltonBraun

        k = linear_stiffness(section, at, wall=wall)
        return WaltonBraun.from_restitution(
            k, section.at("restitution", wall), section.at("friction", wall), stiffness_t=tangential_ratio(section) * k
        )
