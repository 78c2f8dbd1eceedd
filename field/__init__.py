"""Magnetostatics: B-H laws, the axisymmetric nonlinear solve, its quantities and transients, and H at grains.

The field in space, for devices with slots or teeth, is the sub-package `field.solid`.
"""

from .adaptive import AdaptiveResult, AdaptiveStep, adapt
from .axisymmetric import AxisymmetricProblem
from .brauer import BrauerLaw
from .coil_circuit import solve_at_flux_linkage
from .conductivity import Conductivity, conductivity
from .current_sweep import sweep_currents
from .eddy_currents import CurrentDrive, EddyCurrentProblem, TransientState, VoltageDrive
from .error_estimate import ErrorEstimate, FluxLinkage, LargestFluxDensity, MeanFluxDensity, estimate_error
from .field_lines import FieldAlongLine, straight_line
from .froehlich import FroehlichLaw
from .inductance import FluxLinkageCurve
from .langevin import LangevinLaw
from .locate import PointOutside
from .loop import loop_field, rectangular_coil_field, solenoid_axis_field
from .magnetic_circuit import Branch, FilledPowder, FluxTube, MagneticCircuit, clutch_circuit
from .magnetic_field import MagneticField
from .magnetisation_curve import HSpline, PermeabilityLaw, TableLaw, spline_of
from .magnetisation_table import TableFault, read_table, table_law
from .materials import grain_material, grain_names, material, material_names
from .maxwell_force import AxialForce, axial_force, lorentz_force, pole_pressure
from .newton import ConvergenceError
from .open_boundary import OpenBoundary
from .powder_law import GrainLaw, ParticleLaw, PowderLaw, ThesisLaw
from .reluctivity import AIR, MU_0, NU_0, Law, LinearLaw
from .sampler import FieldSampler, RadialField, RecoveredSampler, TableSampler, UniformField, field_sampler
from .winding import Winding

__all__ = [
    "AIR",
    "MU_0",
    "NU_0",
    "AdaptiveResult",
    "AdaptiveStep",
    "AxialForce",
    "AxisymmetricProblem",
    "Branch",
    "BrauerLaw",
    "Conductivity",
    "ConvergenceError",
    "CurrentDrive",
    "EddyCurrentProblem",
    "ErrorEstimate",
    "FieldAlongLine",
    "FieldSampler",
    "FilledPowder",
    "FluxLinkage",
    "FluxLinkageCurve",
    "FluxTube",
    "FroehlichLaw",
    "GrainLaw",
    "HSpline",
    "LangevinLaw",
    "LargestFluxDensity",
    "Law",
    "LinearLaw",
    "MagneticCircuit",
    "MagneticField",
    "MeanFluxDensity",
    "OpenBoundary",
    "ParticleLaw",
    "PermeabilityLaw",
    "PointOutside",
    "PowderLaw",
    "RadialField",
    "RecoveredSampler",
    "TableFault",
    "TableLaw",
    "TableSampler",
    "ThesisLaw",
    "TransientState",
    "UniformField",
    "VoltageDrive",
    "Winding",
    "adapt",
    "axial_force",
    "clutch_circuit",
    "conductivity",
    "estimate_error",
    "field_sampler",
    "grain_material",
    "grain_names",
    "loop_field",
    "lorentz_force",
    "material",
    "material_names",
    "pole_pressure",
    "read_table",
    "rectangular_coil_field",
    "solenoid_axis_field",
    "solve_at_flux_linkage",
    "spline_of",
    "straight_line",
    "sweep_currents",
    "table_law",
]
