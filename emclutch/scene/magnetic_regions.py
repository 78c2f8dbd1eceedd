"""Magnetic regions of a device, by the laws of their materials: their faces mirror the grains' dipoles."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from emclutch.scene.materials import Material
    from field import Law

# Of an image, (mu_r - 1)/(mu_r + 1) of that in a perfect mirror: 0.82 here. What is below mirrors no more than in part,
# and images are computed as in a perfect mirror or not at all.
MIRRORS_FROM = 10.0
# Where the permeability of a wall is read [T]. Some fits begin with a low one at B = 0 and rise to thousands by 0.5 T.
_LOW_B = np.linspace(0.0, 0.5, 51)


def magnetic_regions(materials: Mapping[str, str], own: Mapping[str, Material]) -> frozenset[str]:
    """Regions whose material is magnetic.

    Parameters
    ----------
    materials : mapping
        Name of the material of each region.
    own : mapping
        The scene's own materials by name; all others are built in. A name that is neither counts as magnetic: it is a
        fault that is reported elsewhere.
    """
    return frozenset(region for region, name in materials.items() if _is_magnetic(name, own))


def low_field_permeability(law: Law) -> float:
    """Largest relative permeability [-] of a law up to 0.5 T."""
    from field import MU_0  # local: the schema itself needs no field

    H, slope = law.H_of_B(_LOW_B)
    return float(max(1.0 / (MU_0 * slope[0]), np.max(_LOW_B[1:] / (MU_0 * H[1:]))))


def _is_magnetic(name: str, own: Mapping[str, Material]) -> bool:
    if name in own:
        return low_field_permeability(own[name].magnetic_law(name)) >= MIRRORS_FROM
    return _built_in_is_magnetic(name)


@cache
def _built_in_is_magnetic(name: str) -> bool:
    from field.laws.materials import canonical_name, material  # local: as above

    return canonical_name(name) is None or low_field_permeability(material(name)) >= MIRRORS_FROM
