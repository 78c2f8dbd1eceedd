"""Units of the arrays in the record and in the files for ParaView, by name."""

from __future__ import annotations

ARRAY_UNITS: dict[str, str] = {
    # grains
    "id": "1",
    "particle_id": "1",
    "position": "m",
    "radius": "m",
    "diameter": "m",
    "mass": "kg",
    "velocity": "m/s",
    "angular_velocity": "rad/s",
    "magnetic_moment": "A m2",
    "force_contact": "N",
    "force_magnetic": "N",
    "force_lagged": "N",
    "torque_magnetic": "N m",
    "n_contacts": "1",
    # field
    "flux_density": "T",
    "flux_density_magnitude": "T",
    "field_strength": "A/m",
    "vector_potential": "Wb/m",
    "flux_function": "Wb",
    "current_density": "A/m2",
    "relative_permeability": "1",
    "solid_fraction": "1",
    "magnetisation": "A/m",
    "region": "1",
    "error_estimate": "1",
    # contacts and walls
    "force": "N",
    "force_normal": "N",
    "force_tangential": "N",
    "kind": "1",
    "body": "1",
    "wall": "1",
    "angular_speed": "rad/s",
    "material_angle": "rad",
    "stripe": "1",
    "pressure": "Pa",
    "shear_stress": "Pa",
    "largest_shear_stress": "Pa",
}
