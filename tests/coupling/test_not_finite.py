"""A NaN in positions or fields is an error that names the grain, never a converged moment or an index."""

from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit

from coupling.finite_grains import NotFiniteGrains, refuse_not_finite
from coupling.grain_law_table import (
    contrast_of,
    gap_place,
    grain_table,
    mean_neck_pull,
    mmf_place,
    neck_scalar,
    sphere_ratio,
)
from coupling.magnetised_grains import MagnetisedGrains
from coupling.mutual_moments import MutualMoments
from coupling.mutually_magnetised_grains import MutuallyMagnetisedGrains
from coupling.neighbour_rows import neighbour_rows
from field import GrainLaw
from particles.grains import Grains

LAW = GrainLaw(999.0, 1.7e6)
RADIUS = np.full(3, 1e-4)
PLACES = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.01e-4], [5e-4, 0.0, 0.0]])


@pytest.mark.parametrize("near", [True, False])
@pytest.mark.parametrize("what", ["position", "field"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_moments_are_refused(near, what, value):
    solver = MutualMoments(grain_table(LAW, "near_field"), near=near, reach=1e-3)
    rows = neighbour_rows(PLACES, 1e-3)
    position, applied = PLACES.copy(), np.tile([0.0, 0.0, 1e5], (3, 1))
    assert solver.solve(position, RADIUS, applied, rows).residual < 1e-3
    (position if what == "position" else applied)[1, 2] = value
    with pytest.raises(NotFiniteGrains, match=r"1 of 3 grains.*row 1"):
        solver.solve(position, RADIUS, applied, rows)


def grains_of(position):
    return Grains.create(position, 1e-4, 7800.0)


@pytest.mark.parametrize("kind", ["lone", "mutual"])
def test_a_run_names_the_grain(kind):
    """By its id: rows change places when the grains are sorted."""
    grains = grains_of(PLACES)
    grains.particle_id[:] = [7, 11, 13]

    def sample(position):
        H = np.tile([0.0, 0.0, 1e5], (3, 1))
        H[2] = np.nan
        return H, np.zeros((3, 3, 3))

    sampler = SimpleNamespace(sample=sample)
    motion = SimpleNamespace(grains=grains)
    simulation = SimpleNamespace(motion=motion, rows=lambda reach: neighbour_rows(PLACES, reach), source=None)
    if kind == "lone":
        magnetised = MagnetisedGrains(sampler, LAW)
    else:
        solver = MutualMoments(grain_table(LAW, "mutual"), near=False, reach=1e-3)
        magnetised = MutuallyMagnetisedGrains(sampler, LAW, solver=solver)
    with pytest.raises(NotFiniteGrains, match=r"particle_id 13, position \(0.0005, 0, 0\) m, field \(nan, nan, nan\)"):
        magnetised.update(simulation)


def test_large_finite_numbers_are_no_fault():
    refuse_not_finite(np.full((3, 3), 1e308), np.zeros((3, 3)))  # their sum is not finite


@njit
def sphere_of(table, H):
    """What kernels read: these functions have no machine code of their own."""
    return sphere_ratio(table, H)[0], contrast_of(table, H)[0]


@njit
def neck_at(table, gap, neck_mmf):
    x, below = gap_place(table, gap, 3e-3)
    place, fraction = mmf_place(table, neck_mmf, 1.0, 1e-4)
    y, y1, y2, y_i = neck_scalar(table, x, below, place, fraction)
    return y, y1, y2, y_i, mean_neck_pull(table, gap, gap + 1e-3, 3e-3, place, fraction)


def test_tables_have_no_place_for_nan():
    """As an index it would be undefined: of a field it stays NaN, and beyond the last gap there is no neck."""
    table, nan = grain_table(LAW, "near_field"), float("nan")
    assert np.isfinite(sphere_of(table, 1e5)).all() and np.isfinite(neck_at(table, 1e-2, 10.0)).all()
    assert np.isnan(sphere_of(table, nan)[0]) and sphere_of(table, nan)[1] == 0.0
    assert neck_at(table, 1e9, 10.0) == (0.0, 0.0, 0.0, 0.0, 0.0)
    most = max(abs(value) for value in neck_at(table, 3e-3, 1e-3))
    for gap, neck_mmf in ((nan, 10.0), (1e-2, nan), (nan, nan)):
        for value in neck_at(table, gap, neck_mmf):
            assert np.isnan(value) or abs(value) <= most  # a number of the table, or NaN: no memory beside it
    for neck_mmf in (0.0, -0.0, 1e-300, 1e300):
        assert np.isfinite(neck_at(table, 1e-2, neck_mmf)).all()
