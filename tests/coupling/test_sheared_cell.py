"""Laws of a periodic sheared cell: images, momentum, energy, and the magnetism of an even powder in a given field."""

import dataclasses

import numba
import numpy as np
import pytest

from coupling.grain_law_table import grain_table
from coupling.mutual_moments import MutualMoments
from coupling.neighbour_rows import neighbour_rows
from coupling.sheared_cell import CellTooDense, Shear, ShearParameters
from coupling.sheared_cell import step_kernel as column
from coupling.sheared_cell.cell import SquareBox, cell_pairs
from coupling.sheared_cell.cell_moments import CellMoments
from coupling.sheared_cell.random_cell import random_cell
from field.laws.powder_law import GrainLaw

pytestmark = pytest.mark.physics

D = 1e-4
MU_0 = 4e-7 * np.pi
IRON = GrainLaw(999.0, 1.7e6)
POWDER = ShearParameters(law=IRON, fill=0.30, H=40e3, friction=0.3, count=70, width=2.0)  # edges of 4.96 diameters
DRY = dataclasses.replace(POWDER, law=None, H=0.0)
PAIR = dataclasses.replace(POWDER, count=2, fill=1e-3)


def placed(parameters, position, strain=0.0):
    """A cell whose grains stand where they are put, with settled moments."""
    shear = Shear(parameters)
    shear.strain, shear.position = strain, np.array(position, dtype=float)
    shear.velocity[:, 0] = shear.rate * shear.position[:, 2]
    shear._make_lists()
    if shear.moments is not None:
        shear.moments.settle(shear.position, shear.offset, 1e-13, 3000)
        shear.moments.hold(shear.position, shear.offset)
    return shear


def one_step(shear):
    """Forces on all grains (n, 3) [N], from what a step does to their velocities; the sums of the step."""
    before, sums = shear.velocity.copy(), np.zeros(column.N_SUMS)
    shear.advance(1, sums)
    return (shear.velocity - before) * shear.mass / shear.dt, sums


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("apart", [0.99, 1.03, 1.9])
def test_a_pair_through_a_face_is_a_pair(axis, apart):
    """In contact, near and far: across each face, sheared by 0.37, forces and stress are those inside the box."""
    edge = SquareBox.of_fill(2, D, 1e-3).lengths[0]
    direction = np.array([0.48, 0.6, 0.64])
    found = []
    for middle in (0.5, 0.0):
        centre = np.full(3, 0.5 * edge)
        centre[axis] = middle * edge
        pair = centre + np.array([[-0.5], [0.5]]) * apart * D * direction
        shear = placed(PAIR, pair, strain=0.37)
        force, sums = one_step(shear)
        found.append((force, sums[[column.CONTACT_ZX, column.NEAR_ZX]], shear.moments.stress.copy()))
    for inside, through in zip(*found, strict=True):
        assert through == pytest.approx(inside, rel=1e-9, abs=1e-12 * np.abs(found[0][0]).max())
    assert np.abs(found[0][0]).max() > 0.0


def test_a_wrap_changes_nothing():
    """Lists rebuilt in the middle (grains wrapped through faces) against lists kept: the same flight and springs."""
    ends = []
    for again in (False, True):
        shear = Shear(dataclasses.replace(DRY, fill=0.5, count=110))
        shear.velocity += np.random.default_rng(3).normal(0.0, 2.0, shear.velocity.shape) * shear.rate * D
        sums = np.zeros(column.N_SUMS)
        for turn in range(8):
            shear.advance(50, sums)
            if again and turn == 3:
                shear.position[:, 2] += 0.5 * shear.box.lengths[2]  # nothing but names: half of them change sides
                shear.velocity[:, 0] += 0.5 * shear.box.lengths[2] * shear.rate
                shear._make_lists()
        ends.append((shear.spin.copy(), sums.copy()))
    assert ends[0][1][column.CONTACTS] > 1000
    assert ends[1][0] == pytest.approx(ends[0][0], rel=1e-6, abs=1e-9 * np.abs(ends[0][0]).max())
    assert ends[1][1][:10] == pytest.approx(ends[0][1][:10], rel=1e-7)


def test_momentum_stays():
    """Beside the flow, which a wrap takes along: contacts, held forces and pulls, lists rebuilt."""

    def momentum(shear):
        beside = shear.velocity.copy()
        beside[:, 0] -= shear.rate * shear.position[:, 2]
        return beside.sum(axis=0)

    shear = Shear(POWDER)
    before = momentum(shear)
    shear.window(80)
    assert shear.lists > 2 and shear.series.contacts[0] > 0.1
    assert np.abs(momentum(shear) - before).max() < 1e-11 * np.abs(shear.velocity).sum()


def test_grains_that_do_not_meet_follow_the_flow():
    """The affine state: no stress, not of their motion either, and every grain where the flow takes it."""
    shear = placed(
        dataclasses.replace(DRY, count=8, fill=0.01), (np.indices((2, 2, 2)).reshape(3, 8).T + 0.5) * 3.7 * D
    )
    start = shear.position.copy()
    shear.window(40)
    moved = start + shear.strain * np.column_stack([start[:, 2], np.zeros((8, 2))])
    assert shear.position == pytest.approx(moved, rel=1e-9)
    assert abs(shear.series.tau[0]) < 1e-12 * shear.parameters.density * (shear.rate * D) ** 2


def test_the_work_of_shear_is_dissipated_or_held():
    """Trapezoidal work of tau, contacts' losses, springs and motion: the balance closes to second order in the step."""
    errors = []
    for steps in (20.0, 40.0):
        shear = Shear(dataclasses.replace(DRY, fill=0.55, count=110, steps_per_contact=steps, inertial_number=0.05))
        sums = np.zeros(column.N_SUMS)
        shear.advance(1, sums)
        first = sums.copy()
        begin = first[column.ELASTIC] + first[column.KINETIC]
        n = int(60 * steps)
        shear.advance(n, sums)
        flux = [column.CONTACT_ZX, column.KINETIC_ZX]
        last = np.zeros(column.N_SUMS)
        before = sums.copy()
        shear.advance(1, sums)
        last = sums - before
        works = sums[flux].sum() - 0.5 * (first[flux].sum() + last[flux].sum())
        work = -works * shear.rate * shear.dt
        lost = (sums - first)[column.LOST_NORMAL : column.LOST_SLIDING + 1].sum()
        held = sums[column.ELASTIC] + sums[column.KINETIC] - begin
        errors.append(abs(work - lost - held) / lost)
        assert lost > 0.0
    assert errors[0] < 0.01
    assert errors[1] < 0.4 * errors[0]


def test_forces_are_those_of_the_clutch():
    """A heap in the middle of a large cell: against the moments and forces of the coupled runs, with the same split."""
    x = np.array(
        [[0.0, 0, 0], [1.01, 0, 0.1], [0.5, 0.9, 0.1], [0.45, 0.25, 0.96], [1.6, 0.95, 0.15], [0.5, 0.75, 2.4]]
    )
    shear = placed(dataclasses.replace(PAIR, count=6), x * D + 4.0 * D)
    n, radius = 6, np.full(6, 0.5 * D)
    solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=2.0 * D, smear=True)
    rows = neighbour_rows(shear.position, 2.0 * D)
    applied = np.tile([0.0, 0.0, POWDER.H], (n, 1))
    found = solver.solve(shear.position, radius, applied, rows, tolerance=1e-13, most_sweeps=3000)
    assert shear.moments.moment == pytest.approx(found.moment, rel=1e-10, abs=1e-13 * np.abs(found.moment).max())
    whole, _, _ = solver.forces(shear.position, radius, rows, found)
    held, _, _ = solver.forces(shear.position, radius, rows, found, attraction=False)
    assert shear.moments.held == pytest.approx(held, rel=1e-9, abs=1e-11 * np.abs(held).max())
    force, _ = one_step(shear)
    assert force == pytest.approx(whole, rel=1e-9, abs=1e-11 * np.abs(whole).max())


def test_the_stresses_differ_by_the_torque_of_the_field():
    """sum (r_z F_x - r_x F_z) = sum (r x F)_y = sum mu_0 (m x H)_y, torques of near pairs included."""
    position = Shear(POWDER).position
    shear = placed(POWDER, position, strain=0.3)
    stress = shear.moments.stress
    torque = MU_0 * np.cross(shear.moments.moment, [0.0, 0.0, POWDER.H]).sum(axis=0)
    assert shear.moments.residual < 1e-12
    turned = [stress[1, 2] - stress[2, 1], stress[2, 0] - stress[0, 2], stress[0, 1] - stress[1, 0]]
    assert np.abs(turned - torque).max() < 1e-9 * np.abs(stress).max()


def test_lorentz_field_of_a_cubic_lattice():
    """Correction and own part of an even lattice are phi M/3; the wider the split, the smaller the error.

    The error is the smear's at the lattice's wave numbers, of alternating sign: 2.1, -1.6, 0.8, -0.3 % here.
    """
    n, spacing = 7, 1.2 * D
    box = SquareBox((n * spacing,) * 3)
    x = (np.indices((n, n, n)).reshape(3, -1).T + 0.5) * spacing
    M = np.array([3e5, 2e5, 1e6])
    errors = []
    for width in (2.5, 3.0, 3.5, 4.0):
        moments = CellMoments(
            box,
            grain_table(IRON, "mutual"),
            near=False,
            reach=width * D,
            smallest_gap=3e-3,
            field=np.zeros(3),
            radius=0.5 * D,
            count=n**3,
        )
        moments.follow(cell_pairs(box, x, 4.1 * D, 0.0))
        moments.moment[:] = moments.volume * M
        moments.sweep(x, 0.0)
        lorentz = np.pi / 6.0 / 1.2**3 / 3.0 * M
        errors.append(np.abs(moments._field[: n**3] / lorentz - 1.0).max())
    assert errors == pytest.approx([0.0214, 0.0159, 0.0076, 0.0028], rel=0.05)


def test_bits_do_not_depend_on_threads():
    ends = []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        shear = Shear(POWDER)
        shear.window(5)
        ends.append((shear.position.tobytes(), shear.moments.moment.tobytes(), shear.series.tau[0]))
    assert ends[0] == ends[1]


def test_every_pair_once():
    """Against all pairs of all images, in a cell sheared by an odd number."""
    box, x = random_cell(70, D, 0.3, seed=4)
    pairs = cell_pairs(box, x, 2.3 * D, 0.83)
    offset = 0.83 * box.lengths[2] % box.lengths[0]
    shift = box.image_shift(np.array(np.meshgrid(*[[-2, -1, 0, 1, 2]] * 3)).reshape(3, -1).T.astype(float), offset)
    apart = np.linalg.norm(x[:, None, None] - x[None, :, None] - shift, axis=-1)
    wanted = np.count_nonzero((apart < 2.3 * D) & (apart > 0.0))
    assert 2 * len(pairs.first) == len(pairs.rows.other) == wanted
    r = x[pairs.first] - x[pairs.second] - box.image_shift(pairs.image.astype(float), offset)
    assert np.linalg.norm(r, axis=1).max() < 2.3 * D


def test_packing_has_no_overlap_and_says_what_it_cannot():
    box, x = random_cell(100, D, 0.5, seed=2)
    pairs = cell_pairs(box, x, D, 0.0)
    r = x[pairs.first] - x[pairs.second] - box.image_shift(pairs.image.astype(float), 0.0)
    assert np.linalg.norm(r, axis=1).min(initial=D) > 0.995 * D
    with pytest.raises(ValueError, match="at most"):
        random_cell(10, D, 0.7, seed=1)
    with pytest.raises(ValueError, match="twice"):
        cell_pairs(box, x, 4.0 * D, 0.0)
    assert issubclass(CellTooDense, RuntimeError)
