"""What is measured in a sheared box does not depend on where its faces are."""

import numpy as np
import pytest
from loaded_grains import R, contact_points, near

from particles.diagnostics.fabric import fabric
from particles.diagnostics.force_chains import force_chains
from particles.diagnostics.stress import grain_stress
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.sheared_box import MOST, ShearedBox, whole_numbers

EDGE = 10.0 * R
CODES = {tuple(whole_numbers(code)): code for code in range(-MOST, MOST + 1)}


@pytest.mark.parametrize("seed", range(3))
def test_grains_that_are_moved_across_the_faces_are_measured_alike(seed):
    rng = np.random.default_rng(seed)
    box = ShearedBox((EDGE, EDGE, EDGE), 100.0)
    box.offset = 0.3 * EDGE
    x = rng.uniform(R, EDGE - R, (200, 3))
    inside = Grains.create(x, rng.choice([0.6 * R, R], len(x)), 2000.0)
    contacts = contact_points(inside, near(inside))
    i, j = contacts.i, contacts.j
    push = rng.exponential(size=(len(i), 1)) * (x[j] - x[i]) / R
    contacts.force[:] = -push + 0.1 * rng.normal(size=push.shape)

    away = x + np.array([0.55, 0.45, 0.5]) * EDGE
    numbers = box.wraps(away)
    moved = Grains.create(box.place(away, numbers), inside.radius, 2000.0)
    across = numbers[i] - numbers[j]
    shift = np.array([CODES[tuple(one)] for one in across.tolist()])
    assert np.all(np.count_nonzero(across, axis=0) > 5)
    point = box.place(contacts.point + (away - x)[i], numbers[i])
    there = ContactTable(i, j, contacts.wall, shift, point, contacts.force, contacts.overlap)

    stress = grain_stress(inside, contacts)
    np.testing.assert_allclose(grain_stress(moved, there, box), stress, rtol=1e-9, atol=1e-9 * np.abs(stress).max())
    for weighs in (False, True):
        one, other = fabric(inside, contacts, force_weighted=weighs), fabric(moved, there, box, force_weighted=weighs)
        np.testing.assert_allclose(other.cartesian, one.cartesian, atol=1e-12)
    one, other = force_chains(inside, contacts), force_chains(moved, there, box)
    assert len(one.lengths) > 0
    np.testing.assert_array_equal(one.chain, other.chain)
