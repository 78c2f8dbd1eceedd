"""The physics of a scene as a list of small objects; what is not in the list does not exist.

An effect has a `name`, may act at the start of a coupling window (`begin_window`) and may add to the lagged forces
of a sub-cycle (`add_forces`, which returns its torques for the balances). To add one: a new file here, and its table
in `emclutch.effects`, see docs/how_to/extend.md.
"""

from coupling.effects.dipoles import Dipoles
from coupling.effects.effect import Effect
from coupling.effects.fluid_drag import CouetteFlow, FluidDrag
from coupling.effects.magnetic_force import MagneticForce, body_torque, gradient_force

__all__ = [
    "CouetteFlow",
    "Dipoles",
    "Effect",
    "FluidDrag",
    "MagneticForce",
    "body_torque",
    "gradient_force",
]
