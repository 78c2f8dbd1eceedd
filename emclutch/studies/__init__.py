"""Several runs, or none: sweeps, accuracy against time, design search, the field or the mesh alone."""
