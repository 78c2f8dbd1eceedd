"""Interface of every kind of geometry to the rest of the scene.

What is drawn, meshed or estimated in its own way still asks.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from emclutch.scene.section import Section

if TYPE_CHECKING:
    from emclutch.scene.materials import Material

NO_MATERIALS: Mapping[str, Material] = MappingProxyType({})


class GeometrySection(Section):
    """A kind of device. What is said here holds of most; a kind says what is otherwise with it.

    Attributes
    ----------
    has_coil : bool
        Whether it has a winding and parts of materials, so that the field of its coil can be solved.
    has_axis : bool
        Whether its shafts turn about an axis.
    has_regions : bool
        Whether `particles.region` chooses where its powder is.
    is_annulus : bool
        Whether it is the space between two cylinders, across which a field may be prescribed.
    is_from_file : bool
        Whether it is read from a file: of the grains' space only the boxes that are filled are known.
    why_no_sector : str
        What is wrong with a cyclic sector of it, and what to do; empty where there may be one.
    """

    has_coil: ClassVar[bool] = False
    has_axis: ClassVar[bool] = True
    has_regions: ClassVar[bool] = False
    is_annulus: ClassVar[bool] = False
    is_from_file: ClassVar[bool] = False
    why_no_sector: ClassVar[str] = ""

    @property
    def may_have_steel_faces(self) -> bool:
        """True if grains may touch walls of steel, in which they see their images."""
        return self.has_coil

    @property
    def is_solved_in_3d(self) -> bool:
        """True if its coil's field is solved in 3D, and not in the section of a device of revolution."""
        return False

    @property
    def is_meshed(self) -> bool:
        """True if it comes with a finished mesh, which is taken as it is."""
        return False

    @property
    def slotted(self) -> dict[str, Any]:
        """Its slots that the field sees, by their key."""
        return {}

    @property
    def files(self) -> dict[str, Path]:
        """Files that it is read from, by the key that names them."""
        return {}

    def region_materials(self, regions: Iterable[str]) -> dict[str, str]:
        """Name of the material of each of the mesh's `regions` that has one."""
        return {}

    @abstractmethod
    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> Any:
        """Return the shape for walls and volumes, and for meshing; `own`: the scene's own materials by name."""
