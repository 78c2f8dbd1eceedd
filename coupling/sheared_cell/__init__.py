"""The clean reference for the shear stress of a magnetised powder: a periodic sheared cell in a macroscopic field."""

from coupling.sheared_cell.random_cell import CellTooDense
from coupling.sheared_cell.shear import Series, Shear, ShearParameters

__all__ = ["CellTooDense", "Series", "Shear", "ShearParameters"]
