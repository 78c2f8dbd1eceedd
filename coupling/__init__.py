"""The staggered loop between field and grains, and the effects that live in it."""

from coupling.circuit_coil_field import CircuitCoilField
from coupling.cluster import Cell, Cluster, magnetised_cell, magnetised_cluster
from coupling.coil_field import CoilField, ImposedField, SolvedCoilField
from coupling.eddy_coil_field import EddyCoilField
from coupling.effects import Dipoles, Effect, MagneticForce
from coupling.expected_load import (
    chain_magnetisation,
    magnetic_load,
    neck_load,
    neck_pull,
    neck_stiffness,
    pair_attraction,
    pair_work,
    snap_in_overlap,
    weight_load,
)
from coupling.grain_law_table import grain_table
from coupling.hysteresis_coil_field import HysteresisCoilField
from coupling.layered_field import LayeredField
from coupling.magnetised_grains import MagnetisedGrains, moments
from coupling.mutual_moments import MutualMoments
from coupling.mutually_magnetised_grains import MutuallyMagnetisedGrains
from coupling.near_attraction import NearAttraction
from coupling.powder_feedback import FeedbackError, PowderFeedback
from coupling.powder_feedback_3d import PowderFeedback3D
from coupling.staggered import Simulation, run_staggered
from coupling.window_row import WindowRow

__all__ = [
    "Cell",
    "CircuitCoilField",
    "Cluster",
    "CoilField",
    "Dipoles",
    "EddyCoilField",
    "Effect",
    "FeedbackError",
    "HysteresisCoilField",
    "ImposedField",
    "LayeredField",
    "MagneticForce",
    "MagnetisedGrains",
    "MutualMoments",
    "MutuallyMagnetisedGrains",
    "NearAttraction",
    "PowderFeedback",
    "PowderFeedback3D",
    "Simulation",
    "SolvedCoilField",
    "WindowRow",
    "chain_magnetisation",
    "grain_table",
    "magnetic_load",
    "magnetised_cell",
    "magnetised_cluster",
    "moments",
    "neck_load",
    "neck_pull",
    "neck_stiffness",
    "pair_attraction",
    "pair_work",
    "run_staggered",
    "snap_in_overlap",
    "weight_load",
]
