"""Magnetostatics: B-H laws, the axisymmetric nonlinear solve, and H and grad H at grains."""

from .axisymmetric import AxisymmetricProblem
from .froehlich import FroehlichLaw
from .locate import PointOutside
from .loop import loop_field, rectangular_coil_field, solenoid_axis_field
from .magnetic_field import MagneticField
from .magnetisation_curve import PermeabilityLaw, TableLaw
from .materials import material, material_names
from .newton import ConvergenceError
from .powder_law import GrainLaw, ParticleLaw, PowderLaw, ThesisLaw
from .reluctivity import AIR, MU_0, NU_0, Law, LinearLaw
from .sampler import FieldSampler, RadialField, RecoveredSampler, UniformField

__all__ = [
    "AIR",
    "MU_0",
    "NU_0",
    "AxisymmetricProblem",
    "ConvergenceError",
    "FieldSampler",
    "FroehlichLaw",
    "GrainLaw",
    "Law",
    "LinearLaw",
    "MagneticField",
    "ParticleLaw",
    "PermeabilityLaw",
    "PointOutside",
    "PowderLaw",
    "RadialField",
    "RecoveredSampler",
    "TableLaw",
    "ThesisLaw",
    "UniformField",
    "loop_field",
    "material",
    "material_names",
    "rectangular_coil_field",
    "solenoid_axis_field",
]
