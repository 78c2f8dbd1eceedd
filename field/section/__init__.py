"""The axisymmetric field of a cross-section: elements, solve, error and refinement, quantities, diffusion."""
