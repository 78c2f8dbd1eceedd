"""Walls in the form of the kernels."""
