"""Smearing of grains into the field that magnetises them, solved or layered, and its width."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emclutch.scene.model import Scene

MIN_WIDTH = 2.0
"""Grain diameters: below it the field would follow single grains."""

TRUE_WIDTH = 2.5
"""Grain diameters: from it on a ring of grains that touch is as good as even, and its forces are right to 1 %."""

ELEMENTS_A_WIDTH = 4.0
"""Rows of elements across the width: in sheared powder the sum of moments and the magnetic pull are then within 1 %."""


def moments_are_fed_back(scene: Scene) -> bool:
    """True if the field is solved with the grains' own moments in it."""
    return scene.effects.feedback is not None and scene.effects.attraction is not None


def layers_change_the_field(scene: Scene) -> bool:
    """True if the field is the mean one of even powder between steel faces, across which layers change it."""
    field, geometry = scene.prescribed_field, scene.geometry
    return (
        field is not None
        and field.is_macroscopic
        and geometry.is_periodic
        and geometry.may_have_steel_faces
        and scene.effects.images is not None
    )


def narrowest_gap(scene: Scene) -> float:
    """Width [m] of the narrowest gap that is filled with powder."""
    gap = scene.shape().sheared_gap(scene.grains.region)
    return float(scene.shape().extent()[2]) if gap is None else gap.narrowest  # None: of a sheared box between faces


def smear_width(scene: Scene) -> float:
    """Width a [m]: the cut-off of the attraction, at most the gap, whose two faces would else fold one grain back."""
    assert scene.effects.attraction is not None  # see the two functions above
    return min(scene.effects.attraction.cutoff * scene.grains.largest_diameter, narrowest_gap(scene))


def element_layers(scene: Scene, asked: int) -> int:
    """Element layers across a gap: those asked for, or as many as the width needs."""
    if not moments_are_fed_back(scene):
        return asked
    # the layers are counted in the narrowest gap; 1e-9: a whole number of rows is not one more
    return max(asked, -int(-(ELEMENTS_A_WIDTH * narrowest_gap(scene) / smear_width(scene) - 1e-9) // 1))
