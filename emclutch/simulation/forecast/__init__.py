"""Predictions before the first step of a run: field, torque, cost, and the importance of effects that are off."""
