"""contact.law = "linear": spring and dashpot (`particles.laws.linear`)."""

from __future__ import annotations

from emclutch.contact_laws.law_kind import (
    STIFFNESS,
    TANGENTIAL_RATIO,
    WALL_STIFFNESS,
    LawKind,
    linear_stiffness,
    tangential_ratio,
)


class Linear(LawKind):
    """Linear spring and dashpot."""

    name = "linear"
    summary = "spring and dashpot"
    KEYS = {"stiffness": STIFFNESS, "wall_stiffness": WALL_STIFFNESS, "tangential_ratio": TANGENTIAL_RATIO}

    @classmethod
    def build(cls, section, at, *, wall):
        """See `LawKind.build`."""
        from particles.laws.linear import LinearContact  # local: the schema itself needs no particles

        k = linear_stiffness(section, at, wall=wall)
        return LinearContact.from_restitution(
            k, section.at("restitution", wall), section.at("friction", wall), stiffness_t=tangential_ratio(section) * k
        )
