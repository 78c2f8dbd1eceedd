"""Columns of `particles.grains.Grains.velocity_force`."""

VELOCITY, SPIN, FORCE, TORQUE = 0, 3, 6, 9
