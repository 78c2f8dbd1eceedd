"""geometry.kind = "drum": a clutch whose flux crosses the rim gap twice."""

from __future__ import annotations

from typing import Literal

from emclutch.devices.clutch import ClutchGeometry, ClutchMaterials


class DrumMaterials(ClutchMaterials):
    """As in the clutch, e.g. rotor = "steel_1010", but covers carry no flux: it crosses the rim gap twice instead."""

    cover: str = "aluminium"


class DrumGeometry(ClutchGeometry):
    """The same family with a thick disc and non-magnetic covers: the flux crosses the rim gap twice."""

    kind: Literal["drum"]  # type: ignore[assignment]
    materials: DrumMaterials = DrumMaterials()
