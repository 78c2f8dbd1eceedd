"""Discrete element method: the compiled step and the loop around it."""
