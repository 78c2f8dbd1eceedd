"""A wall of triangles is the plane that it covers: on faces, edges and vertices, for impacts with friction and spin."""

import numpy as np
import pytest

from geometry.triangle_wall import TriangleWall
from geometry.walls import Plane
from particles import DEM, DVI, Body, DviContact, Grains, LinearContact

R, CELL = 1e-3, 1e-3


def _meshed(cells=10):
    line = CELL * (np.arange(cells + 1) - 0.5 * cells)
    vertices = np.array([[x, y, 0.0] for x in line for y in line])
    corner = np.array([i * (cells + 1) + j for i in range(cells) for j in range(cells)])
    halves = [corner, corner + cells + 1, corner + cells + 2], [corner, corner + cells + 2, corner + 1]
    return TriangleWall("floor", "housing", vertices, np.concatenate([np.stack(half, axis=1) for half in halves]))


PLANE = Plane("floor", "housing", np.zeros(3), np.array([0.0, 0.0, 1.0]))


@pytest.mark.parametrize("method", ["dem", "dvi"])
def test_impacts_on_faces_edges_and_vertices_are_those_on_a_plane(method):
    """60 spheres, one after the other; a shared edge counts once (Project Chrono's DEM-Engine #73, phasicFlow #242)."""
    rng = np.random.default_rng(0)
    where = rng.uniform(-4.0 * CELL, 4.0 * CELL, (60, 2))
    where[:20] = CELL * np.round(where[:20] / CELL)  # above vertices
    where[20:40, 0] = CELL * np.round(where[20:40, 0] / CELL)  # above edges
    where[40:50, 1] = where[40:50, 0]  # above the edges between two halves
    velocity = np.column_stack([rng.normal(size=(60, 2)), -0.1 - np.abs(rng.normal(size=60))])
    velocity[:10, :2] = 0.0
    spin = 300.0 * rng.normal(size=(60, 3))
    law = LinearContact.from_restitution(1e5, 0.5, 0.35)

    def after(wall, k):
        state = {"velocity": [velocity[k]], "angular_velocity": [spin[k]]}
        grains = Grains.create([[*where[k], 1.05 * R]], R, 2600.0, **state)
        if method == "dem":
            motion = DEM(grains, [wall], [Body("housing")], law, dt=5e-7)
        else:
            motion = DVI(grains, [wall], [Body("housing")], DviContact(0.35, 0.5), dt=2e-6)
        motion.run(round(2e-4 / motion.dt))
        return np.concatenate([grains.velocity[0], R * grains.angular_velocity[0]])

    meshed = _meshed()
    for k in range(60):
        assert after(meshed, k) == pytest.approx(after(PLANE, k), abs=1e-12)
