"""Geometry of devices: parametric cross-sections, meshes with named regions, walls of grains."""

import geometry.kernels.threads  # noqa: F401 (before gmsh or numba load the OpenMP library)
from geometry.annular_cell import ShearCell
from geometry.box import Box
from geometry.centrifugal import CentrifugalClutch, Chamber
from geometry.clutch import Clutch
from geometry.drawing import draw_section
from geometry.fault import GeometryError, GeometryFault
from geometry.mesh_3d import Mesh3D
from geometry.meshing import mesh_clutch
from geometry.section import SectionMesh
from geometry.slots import Slots
from geometry.slotted import mesh_slotted
from geometry.surface_import import triangle_wall_from_file
from geometry.triangle_wall import TriangleWall, box_surface, extruded, joined
from geometry.walls import AnnularBox, Plane, RevolvedWall, Wall, annulus, cone, cylinder, outline

__all__ = [
    "AnnularBox",
    "Box",
    "CentrifugalClutch",
    "Chamber",
    "Clutch",
    "GeometryError",
    "GeometryFault",
    "Mesh3D",
    "Plane",
    "RevolvedWall",
    "SectionMesh",
    "ShearCell",
    "Slots",
    "TriangleWall",
    "Wall",
    "annulus",
    "box_surface",
    "cone",
    "cylinder",
    "draw_section",
    "extruded",
    "joined",
    "mesh_clutch",
    "mesh_slotted",
    "outline",
    "triangle_wall_from_file",
]
