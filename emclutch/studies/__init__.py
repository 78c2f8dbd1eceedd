"""What is done over several runs, or without one: sweeps, accuracy against time, design search, the field or the mesh alone."""
