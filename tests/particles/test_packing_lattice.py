"""Lattices: their known densities and neighbours, closed rings and sectors, noise without overlap, refusal."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from geometry.annular_cell import ShearCell
from geometry.box import Box
from geometry.centrifugal import CentrifugalClutch
from particles import CyclicSector, PackingError
from particles.packing.lattice_packing import KINDS, lattice_packing, lattice_sites
from particles.packing.packing import deepest_overlaps, require_fit
from particles.packing.space import Space

D = 1e-3
DENSITY = {"sc": math.pi / 6.0, "fcc": math.pi / (3.0 * math.sqrt(2.0)), "hcp": math.pi / (3.0 * math.sqrt(2.0))}


def _box(*sides):
    box = Box(tuple(s * D for s in sides))
    return Space.of(box, box.walls())


def _ring(sector=None):
    cell = ShearCell(20 * D, 26 * D, 8 * D)
    return Space.of(list(cell.fill_boxes().values()), cell.walls(), sector)


@pytest.mark.parametrize("kind", KINDS)
def test_density_far_from_walls(kind):
    """0.5236 and 0.7405 (textbook): the loss falls with the surface, so two boxes tell what is left without walls."""
    phi = [len(lattice_sites(_box(n, n, n), kind, D)) * math.pi / 6.0 / n**3 for n in (20, 40)]
    assert phi[1] <= DENSITY[kind] * (1.0 + 1e-12)
    assert 2.0 * phi[1] - phi[0] == pytest.approx(DENSITY[kind], rel=0.02)  # steps of whole rows are left
    assert DENSITY[kind] == pytest.approx({"sc": 0.5236, "fcc": 0.7405, "hcp": 0.7405}[kind], abs=5e-5)


@pytest.mark.parametrize("kind, neighbours, second", [("sc", 6, 2.0), ("fcc", 12, 2.0), ("hcp", 12, 2.0)])
def test_neighbours(kind, neighbours, second):
    """6 or 12 nearest at a, the next not before sqrt(2) a; fcc and hcp differ in the next but one: sqrt(8/3) a."""
    x = lattice_sites(_box(8, 8, 8), kind, D) / D
    k = int(np.argmin(np.sum((x - [0.0, 0.0, 4.0]) ** 2, axis=1)))
    r = np.sort(np.linalg.norm(x - x[k], axis=1))[1:]
    assert r[:neighbours] == pytest.approx(np.ones(neighbours), rel=1e-12)
    assert r[neighbours] == pytest.approx(math.sqrt(second), rel=1e-12)
    assert np.isclose(r, math.sqrt(8.0 / 3.0), rtol=1e-9).any() == (kind == "hcp")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sector", [None, CyclicSector(math.radians(45.0))])
def test_rings_and_sectors_close(kind, sector):
    space = _ring(sector)
    n = len(lattice_sites(space, kind, D))
    packing = lattice_packing(space, np.full(n, 0.5 * D), kind=kind)
    require_fit(packing, space, 1e-9)
    if sector is not None:  # the full ring made of its sectors has no overlap either, and as many grains as fit
        ring = np.concatenate([packing.position @ sector.rotation(k).T for k in range(sector.n_sectors)])
        assert not cKDTree(ring).query_pairs(D * (1.0 - 1e-9))
        assert sector.n_sectors * n >= 0.9 * len(lattice_sites(_ring(), kind, D))


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(KINDS), st.floats(0.0, 1.0), st.floats(0.05, 0.95), st.integers(0, 1000), st.booleans())
def test_noise_never_makes_grains_overlap(kind, noise, share, seed, ring):
    space = _ring(CyclicSector(math.radians(45.0))) if ring else _box(7.3, 6.1, 5.2)
    count = max(1, int(share * len(lattice_sites(space, kind, D))))
    radius = 0.5 * D * np.random.default_rng(seed).uniform(0.6, 1.0, count)
    packing = lattice_packing(space, radius, kind=kind, noise=noise, seed=seed)
    require_fit(packing, space, 1e-9)
    assert np.array_equal(np.sort(packing.radius), np.sort(radius))


def test_noise_and_seed():
    space, radius = _box(10, 10, 10), np.full(300, 0.5 * D)
    still, noisy, again, other = (
        lattice_packing(space, radius, kind="sc", noise=a, seed=s).position for a, s in ((0, 1), (1, 1), (1, 1), (1, 2))
    )
    assert np.array_equal(noisy, again) and not np.array_equal(noisy, other)
    assert len(np.unique(np.round(still[:, 0] / D, 9))) <= 10 and len(np.unique(noisy[:, 0])) == 300
    assert deepest_overlaps(lattice_packing(space, radius, kind="sc", noise=1.0), space).max() == 0.0


def test_more_grains_than_sites_are_refused():
    with pytest.raises(PackingError, match=r"the sc lattice has 1000 sites 1 mm apart .* 1001 grains are wanted"):
        lattice_packing(_box(10, 10, 10), np.full(1001, 0.5 * D), kind="sc")
    with pytest.raises(ValueError, match="available: sc, fcc, hcp"):
        lattice_packing(_box(10, 10, 10), np.full(10, 0.5 * D), kind="bcc")


def test_vanes_and_ribs_stay_clear():
    clutch = CentrifugalClutch()
    space = Space.of(list(clutch.fill_boxes().values()), clutch.walls())
    packing = lattice_packing(space, np.full(400, 5e-3), kind="hcp", noise=0.5)
    require_fit(packing, space, 1e-9)
