"""Checks of a device from a finished mesh."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from emclutch.scene.draft import Draft
from emclutch.scene.errors import Fault
from emclutch.scene.grain_smear import ELEMENTS_A_WIDTH, moments_are_fed_back, smear_width

# Of the rows that are meshed here across the width: triangles of another mesher are not all equilateral.
_ENOUGH = 0.75
_KEYS = {"open_boundary": "field.open_boundary", "air_factor": "geometry.air_factor"}


def finished_mesh(draft: Draft) -> Iterator[Fault]:
    """Keys that size a mesh, beside one that is taken as it is, and whether its air can be continued."""
    geometry, source = draft.scene.geometry, draft.scene.coil_field
    if not geometry.is_meshed or source is None:
        return
    for key in ("gap_layers", "size_factor"):
        if getattr(source, key) != type(source).model_fields[key].default:
            yield draft.fault(
                f"field.{key}",
                "sizes a mesh that is made here, but geometry.file is a finished one; remove it, mesh the file more "
                "finely, or refine it by field.tolerance",
            )
    if source.open_boundary:
        from field.section.open_boundary import check_reach  # local: the schema itself needs no field
        from geometry.fault import with_keys

        try:
            check_reach(geometry.mesh(source.gap_layers, source.size_factor))
        except ValueError as error:
            reason = with_keys(str(error), lambda name: _KEYS.get(name, f"`{name}`"))
            yield draft.fault("geometry.file", f"has too little air, or air of a wrong outline: {reason}")


def fine_enough_for_moments(draft: Draft) -> Iterator[Fault]:
    """Rows of triangles across the width over which back_reaction spreads a grain."""
    scene = draft.scene
    geometry, source = scene.geometry, scene.coil_field
    if not geometry.is_meshed or source is None:
        return
    if not moments_are_fed_back(scene) or scene.shape().faults(None):
        return
    mesh = geometry.mesh(source.gap_layers, source.size_factor)
    # of an equilateral triangle of the same area: its height is 3^(1/4) sqrt(A)
    row = 3.0**0.25 * float(np.sqrt(np.median(mesh.element_area()[mesh.regions["powder"]])))
    width = smear_width(scene)
    if width < _ENOUGH * ELEMENTS_A_WIDTH * row:
        yield draft.fault(
            "geometry.file",
            f"is too coarse for effects.{scene.effects.feedback.name}, which spreads a grain over {1e3 * width:.3g} "
            f"mm: the powder's triangles are {1e3 * row:.3g} mm high, allowed are "
            f"{1e3 * width / (_ENOUGH * ELEMENTS_A_WIDTH):.3g} mm; "
            "mesh it more finely, or remove the effect's table",
        )
