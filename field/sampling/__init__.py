"""H and grad H at points: recovery of the derivatives, element kernels, conservative tables."""
