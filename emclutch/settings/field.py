"""Settings of the solved field: mesh, or the tolerance that refines it, and order of the elements."""

from __future__ import annotations

from emclutch.scene.units import number
from emclutch.settings.setting import FROZEN, Setting


class FieldMesh(Setting):
    """Element size, as a factor of the program's own choice."""

    name = "field_mesh"
    key = "field.size_factor"
    entry = number("1", 0.1, 4.0)
    theory = (
        "elements of order p: error h^(2p) in smooth fields, h^(4/3) where corners of iron dominate (their field has "
        "the exponent 2/3); a solution costs n log n in the n unknowns"
    )
    order = None
    measured_on = FROZEN
    tried = (2.0, 1.4, 1.0, 0.7, 0.5)

    @classmethod
    def applies(cls, scene):
        return scene.coil_field is not None and scene.coil_field.tolerance is None

    @classmethod
    def own(cls, scene, plan):
        return scene.coil_field.size_factor


class FieldTolerance(Setting):
    """Estimated error of flux linkage and gap field at which refinement of the mesh ends."""

    name = "field_tolerance"
    key = "field.tolerance"
    entry = number("1e-3", 1e-6, 0.1)
    theory = "the error of the field is in proportion to the estimate that ends the refinement"
    order = 1.0
    measured_on = FROZEN
    tried = (1e-2, 3e-3, 1e-3, 3e-4)

    @classmethod
    def applies(cls, scene):
        return scene.coil_field is not None and scene.coil_field.tolerance is not None

    @classmethod
    def own(cls, scene, plan):
        return scene.coil_field.tolerance


class ElementOrder(Setting):
    """Polynomial order of the field's elements."""

    name = "element_order"
    key = "field.order"
    entry = number("2", 1.0, 3.0)
    theory = "the error of smooth fields falls by a factor with each order; with corners of iron by less"
    order = None
    measured_on = FROZEN
    finer_is_larger = True
    is_whole = True
    tried = (2, 3)

    @classmethod
    def applies(cls, scene):
        return scene.coil_field is not None

    @classmethod
    def own(cls, scene, plan):
        return scene.coil_field.order
