"""Magnetostatics: B-H laws, the axisymmetric nonlinear solve, its quantities and transients, and H at grains.

The field in 3D, for devices with slots or teeth, is the sub-package `field.three_d`.
"""

import geometry.kernels.cache  # noqa: F401 (before the first kernel is defined)
from field.coil.coil_circuit import solve_at_flux_linkage
from field.coil.magnetic_circuit import Branch, FilledPowder, FluxTube, MagneticCircuit, clutch_circuit
from field.coil.winding import Winding
from field.laws.brauer import BrauerLaw
from field.laws.conductivity import Conductivity, conductivity
from field.laws.froehlich import FroehlichLaw
from field.laws.h_spline import HSpline
from field.laws.langevin import LangevinLaw
from field.laws.magnetisation_curve import PermeabilityLaw, TableLaw
from field.laws.magnetisation_table import TableFault, read_table, table_law
from field.laws.materials import grain_material, grain_names, material, material_names
from field.laws.powder_law import GrainLaw, ParticleLaw, PowderLaw, ThesisLaw
from field.laws.reluctivity import AIR, MU_0, NU_0, Law, LinearLaw
from field.newton import ConvergenceError
from field.sampling.locate import PointOutside
from field.sampling.sampler import (
    FieldSampler,
    RadialField,
    RecoveredSampler,
    TableSampler,
    UniformField,
    field_sampler,
)
from field.section.adaptive import AdaptiveResult, AdaptiveStep, adapt
from field.section.axisymmetric import AxisymmetricProblem
from field.section.current_sweep import sweep_currents
from field.section.eddy_currents import CurrentDrive, EddyCurrentProblem, TransientState, VoltageDrive
from field.section.error_estimate import ErrorEstimate, FluxLinkage, MeanFluxDensity, estimate_error
from field.section.field_lines import FieldAlongLine, straight_line
from field.section.magnetic_field import MagneticField
from field.section.maxwell_force import AxialForce, axial_force, lorentz_force, pole_pressure
from field.section.open_boundary import OpenBoundary
from field.section.powder_state import PowderState

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
    "FluxTube",
    "FroehlichLaw",
    "GrainLaw",
    "HSpline",
    "LangevinLaw",
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
    "PowderState",
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
    "lorentz_force",
    "material",
    "material_names",
    "pole_pressure",
    "read_table",
    "solve_at_flux_linkage",
    "straight_line",
    "sweep_currents",
    "table_law",
]
