"""Settings of the solved field: mesh, or the tolerance that refines it, and order of the elements."""

from __future__ import annotations

from emclutch.scene.units import number
from emclutch.settings.setting import FROZEN, Setting

FIELD_MESH = Setting(
    name="field_mesh",
    key="field.size_factor",
    summary="Element size, as a factor of the program's own choice.",
    theory="elements of order p: error h^(2p) in smooth fields, h^(4/3) where corners of iron dominate (their field "
    "has the exponent 2/3); a solution costs n log n in the n unknowns",
    entry=number("1", 0.1, 4.0),
    order=None,
    applies=lambda scene: scene.coil_field is not None and scene.coil_field.tolerance is None,
    own=lambda scene, plan: scene.coil_field.size_factor,
    tried=(2.0, 1.4, 1.0, 0.7, 0.5),
    measured_on=FROZEN,
)
FIELD_TOLERANCE = Setting(
    name="field_tolerance",
    key="field.tolerance",
    summary="Estimated error of flux linkage and gap field at which refinement of the mesh ends.",
    theory="the error of the field is in proportion to the estimate that ends the refinement",
    entry=number("1e-3", 1e-6, 0.1),
    order=1.0,
    applies=lambda scene: scene.coil_field is not None and scene.coil_field.tolerance is not None,
    own=lambda scene, plan: scene.coil_field.tolerance,
    tried=(1e-2, 3e-3, 1e-3, 3e-4),
    measured_on=FROZEN,
)
ELEMENT_ORDER = Setting(
    name="element_order",
    key="field.order",
    summary="Polynomial order of the field's elements.",
    theory="the error of smooth fields falls by a factor with each order; with corners of iron by less",
    entry=number("2", 1.0, 3.0),
    order=None,
    applies=lambda scene: scene.coil_field is not None,
    own=lambda scene, plan: scene.coil_field.order,
    tried=(2, 3),
    measured_on=FROZEN,
    finer_is_larger=True,
    is_whole=True,
)
