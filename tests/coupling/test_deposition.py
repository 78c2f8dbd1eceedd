"""The fill keeps the volume of every grain of the region, on any mesh, and finds a uniform powder uniform."""

import numpy as np
import pytest

from coupling import FillDeposition
from geometry import Clutch, mesh_clutch

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def mesh():
    return mesh_clutch(Clutch(), size_factor=4.0)


@pytest.mark.parametrize("diameter", [0.1e-3, 0.2e-3, 0.5e-3])
def test_volume_is_conserved(mesh, diameter):
    clutch = Clutch()
    rng = np.random.default_rng(1)
    angle = 0.1
    theta, r = rng.uniform(0, angle, 500), rng.uniform(clutch.disc_radius, clutch.bore_radius, 500)
    position = np.column_stack([r * np.cos(theta), r * np.sin(theta), rng.uniform(-16e-3, 16e-3, 500)])
    volume = rng.uniform(0.5, 1.5, 500) * np.pi / 6 * diameter**3
    deposition = FillDeposition(mesh, diameter, angle)
    fill = deposition.fill(position, volume)
    assert fill.min() >= 0.0
    assert (fill * deposition.volume).sum() == pytest.approx(volume.sum(), rel=1e-12)


def test_an_even_powder_has_an_even_fill(mesh):
    """400 000 points spread evenly over the rim gap: the fill is that of the box away from its open ends."""
    clutch = Clutch()
    rng = np.random.default_rng(2)
    n, angle, d = 400_000, 0.2, 0.2e-3
    box = clutch.fill_boxes()["rim"]
    r = np.sqrt(rng.uniform(box.r0**2, box.r1**2, n))
    theta = rng.uniform(0, angle, n)
    position = np.column_stack([r * np.cos(theta), r * np.sin(theta), rng.uniform(box.z0, box.z1, n)])
    volume = np.full(n, 0.3 * box.volume(angle) / n)
    deposition = FillDeposition(mesh, d, angle)
    fill = deposition.fill(position, volume)
    centroid = mesh.centroid()[mesh.regions["powder"]]
    middle = (centroid[:, 0] > box.r0) & (np.abs(centroid[:, 1]) < 12e-3)
    assert np.average(fill[middle], weights=deposition.volume[middle]) == pytest.approx(0.3, rel=0.01)
    assert fill[middle].std() < 0.05
    at = deposition.at(position[:1000], fill)
    assert np.median(at) == pytest.approx(0.3, rel=0.03)


def test_a_grain_outside_the_region_raises_no_element_s_fill(mesh):
    """Beyond the bore, inside the disc, beyond a cover: left out and named; at the very walls they are kept."""
    clutch = Clutch()
    radius, half = clutch.bore_radius, 0.5 * clutch.cavity_length
    kept = [(radius, 0.0), (clutch.disc_radius, 0.0), (clutch.mean_gap_radius, half), (clutch.seal_radius, half)]
    lost = [(radius + 2e-3, 0.0), (clutch.disc_radius - 2e-3, 0.0), (clutch.mean_gap_radius, half + 1e-3), (1e-3, 0.0)]
    position = np.array([(r, 0.0, z) for r, z in kept + lost])
    deposition = FillDeposition(mesh, 0.2e-3, 0.1)
    assert deposition.outside(position).tolist() == [False] * len(kept) + [True] * len(lost)
    fill = deposition.fill(position, np.full(len(position), 1e-12))
    assert (fill * deposition.volume).sum() == pytest.approx(len(kept) * 1e-12, rel=1e-12)
    assert np.all(deposition.at(position[len(kept) :], fill) == 0.0) and deposition.at(position[:1], fill)[0] > 0.0
