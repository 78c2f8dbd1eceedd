"""Overlaps of grains, over the diameter: from where on they cast doubt on a run, and where a run stops."""

SOFT = 0.03
"""Above it grains are too soft for peaks of the torque to mean much."""
STOPS = 0.10
"""A run ends at it: `overlap_limit` of `particles.DEM` and `particles.DVI`."""
