"""Laws of a sheared cell of magnetised powder: images, momentum, torques, an even powder in a given field.

Those of the box itself, without magnetism, are in `tests/dem/test_sheared_box.py`.
"""

import dataclasses

import numba
import numpy as np
import pytest
from powder_cell import PowderCell, ShearParameters, magnetise, min_count

from coupling.grain_law_table import grain_table
from coupling.mutual_moments import MutualMoments
from coupling.neighbour_rows import neighbour_rows
from coupling.staggered import Simulation, lagged_forces
from coupling.window_budget import WindowBudget
from field.laws.powder_law import GrainLaw
from particles import DEM, DVI, DviContact, Grains, LinearContact, ShearedBox

pytestmark = pytest.mark.physics

D = 1e-4
MU_0 = 4e-7 * np.pi
IRON = GrainLaw(999.0, 1.7e6)
POWDER = ShearParameters(law=IRON, fill=0.30, H=40e3, friction=0.3, count=70, width=2.0)  # edges of 4.96 diameters
DRY = dataclasses.replace(POWDER, law=None, H=0.0)
RATE = 300.0
CONTACT = LinearContact.from_restitution(2e4, 0.5, 0.3)
EXACT = 1e-13, 3000  # tolerance, sweeps


def magnetised(x, box, reach=2.0 * D, near=True, H=POWDER.H):
    """Grains at ``x`` in a box, their moments settled and their forces frozen."""
    grains = Grains.create(x, 0.5 * D, 7800.0, velocity=box.flow(x[:, 2]))
    dem = DEM(grains, [], [], CONTACT, dt=1e-8, periodicity=box, skin=0.3 * D)
    solver = MutualMoments(grain_table(IRON, "near_field" if near else "mutual"), near=near, reach=reach, smear=True)
    simulation = Simulation(dem, [], None, None, 8, 1)
    magnetism = magnetise(simulation, solver, (0.0, 0.0, H), IRON)
    look(simulation)
    return dem, magnetism


def look(simulation):
    """Moments and forces at the present places, to round-off."""
    magnetism = simulation.magnetised
    magnetism.tolerance, magnetism.max_sweeps = EXACT
    simulation.motion.external_force = force = lagged_forces(simulation, WindowBudget(simulation))
    magnetism.freeze(simulation, force)


def one_step(dem):
    """Forces on all grains (n, 3) [N], from what a step does to their velocities less the flow's; the totals."""
    order, before = dem.grains.particle_id.copy(), dem.grains.velocity.copy()
    totals = dem.run(1)
    assert (dem.grains.particle_id == order).all()
    return ((dem.grains.velocity - before) * dem.grains.mass[:, None] / dem.dt)[np.argsort(order)], totals


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("apart", [0.99, 1.03, 1.5, 1.9])
def test_a_pair_through_a_face_is_a_pair(axis, apart):
    """In contact, near and far: across each face, sheared by 0.37, forces and stress are those inside the box."""
    direction, result = np.array([0.48, 0.6, 0.64]), []
    for middle in (0.5, 0.0):
        box = ShearedBox([9.0 * D, 8.0 * D, 8.5 * D], RATE)
        box.offset = 0.37 * box.lengths[2]
        centre = 0.5 * box.lengths
        centre[axis] = middle * box.lengths[axis]
        dem, magnetism = magnetised(centre + np.array([[-0.5], [0.5]]) * apart * D * direction, box)
        dem.renew_list()
        force, totals = one_step(dem)
        result.append((force, totals.stress.contacts, totals.stress.attraction, magnetism.lagged_stress.copy()))
    size = np.abs(result[0][0]).max()
    assert size > 0.0
    for inside, through, unit in zip(*result, (size, *3 * [size * D / 6e2 / D**3]), strict=True):
        assert through == pytest.approx(inside, rel=1e-8, abs=1e-10 * unit)


@pytest.mark.parametrize("axis", [0, 2])
def test_the_mean_pull_of_a_step_is_that_of_the_image_that_moves_on(axis):
    """By DVI, whose necks pull with the mean over the step: across a face, and across the sheared one, as inside."""
    direction, result = np.array([0.48, 0.6, 0.64]), []
    for middle in (0.5, 0.0):
        box = ShearedBox([9.0 * D, 8.0 * D, 8.5 * D], 100.0 * RATE)
        box.offset = 0.37 * box.lengths[2]
        centre = 0.5 * box.lengths
        centre[axis] = middle * box.lengths[axis]
        x = centre + np.array([[-0.5], [0.5]]) * 1.03 * D * direction
        grains = Grains.create(x, 0.5 * D, 7800.0, velocity=box.flow(x[:, 2]))
        dvi = DVI(grains, [], [], DviContact(0.3, 0.5), dt=1e-6, periodicity=box)
        simulation = Simulation(dvi, [], None, None, 1, 1)
        solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=2.0 * D, smear=True)
        magnetism = magnetise(simulation, solver, (0.0, 0.0, POWDER.H), IRON)
        magnetism.near = None
        look(simulation)
        force, stress = np.array(dvi.external_force), np.array(magnetism.lagged_stress)
        x, (i, j) = np.array(grains.position), np.argsort(grains.particle_id)
        result.append((force[[i, j]], stress))
    assert np.abs(result[0][0]).max() > 0.0
    for inside, through in zip(*result, strict=True):
        assert through == pytest.approx(inside, rel=1e-8, abs=1e-9 * np.abs(inside).max())
    still = solver.forces(x, np.full(2, 0.5 * D), simulation.rows(solver.reach), magnetism.magnetisation).force
    assert np.abs(still[[i, j]] - result[1][0]).max() > 0.01 * np.abs(still).max()


def test_momentum_stays():
    """Peculiar velocities, as a wrap takes the flow along: contacts, lagged forces and pulls, lists rebuilt."""
    cell = PowderCell(POWDER)
    grains = cell.dem.grains

    def momentum():
        return (grains.velocity - cell.box.flow(grains.position[:, 2])).sum(axis=0)

    before = momentum()
    cell.window(200)
    assert cell.dem.list_version > 3 and cell.series.contacts[0] > 0.1
    assert np.abs(momentum() - before).max() < 1e-11 * np.abs(grains.velocity).sum()


def test_an_open_cluster_in_a_large_box_is_the_clusters():
    """A heap in the middle: moments and forces of rows without images, with the same split."""
    x = np.array(
        [[0.0, 0, 0], [1.01, 0, 0.1], [0.5, 0.9, 0.1], [0.45, 0.25, 0.96], [1.6, 0.95, 0.15], [0.5, 0.75, 2.4]]
    )
    box = ShearedBox(np.full(3, 12.0 * D), RATE)
    dem, magnetism = magnetised(x * D + 4.0 * D, box)
    order = np.argsort(dem.grains.particle_id)
    n, radius, x = 6, np.full(6, 0.5 * D), np.array(dem.grains.position)[order]
    solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=2.0 * D, smear=True)
    rows = neighbour_rows(x, 2.0 * D)
    result = solver.solve(
        x, radius, np.tile([0.0, 0.0, POWDER.H], (n, 1)), rows, tolerance=EXACT[0], max_sweeps=EXACT[1]
    )  # fmt: skip
    moment = magnetism.magnetisation.moment[order]
    assert moment == pytest.approx(result.moment, rel=1e-9, abs=1e-12 * np.abs(result.moment).max())
    whole = solver.forces(x, radius, rows, result).force
    dem.renew_list()
    force, totals = one_step(dem)
    assert totals.n_contacts == 0
    assert force == pytest.approx(whole, rel=1e-7, abs=1e-9 * np.abs(whole).max())


def test_the_stresses_differ_by_the_torque_of_the_field():
    """sum (r_z F_x - r_x F_z) = sum (r x F)_y = sum mu_0 (m x H)_y, of lagged forces: near pulls are central."""
    cell = PowderCell(POWDER)
    cell.window(5)
    magnetism = cell.magnetism
    look(cell.simulation)
    virial = magnetism.lagged_stress.T * cell.box.volume
    torque = MU_0 * np.cross(magnetism.magnetisation.moment, [0.0, 0.0, POWDER.H]).sum(axis=0)
    turned = [virial[1, 2] - virial[2, 1], virial[2, 0] - virial[0, 2], virial[0, 1] - virial[1, 0]]
    assert magnetism.magnetisation.residual < 1e-12
    assert np.abs(torque).max() > 1e-6 * np.abs(virial).max()
    assert np.abs(turned - torque).max() < 1e-9 * np.abs(virial).max()


def test_the_shear_stress_is_the_strain_derivative_of_the_energy():
    """dW/dgamma = -sum r_z F_x in an oblique field, charges' mu_0 q H included; grains that do not touch."""
    cell, a = PowderCell(POWDER), np.full(70, 0.485 * D)
    cell.window(5)
    box, x, offset = cell.box, np.array(cell.dem.grains.position), cell.box.offset
    applied = np.tile([0.7 * POWDER.H, 0.2 * POWDER.H, POWDER.H], (70, 1))

    def solved(strain):
        box.offset, moved = offset + strain * box.lengths[2], x + strain * np.outer(x[:, 2], [1.0, 0.0, 0.0])
        solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=2.0 * D, smear=True)
        rows = neighbour_rows(moved, 2.1 * D, box)
        result = solver.solve(moved, a, applied, rows, tolerance=EXACT[0], max_sweeps=EXACT[1])
        return solver.energy(moved, a, result), solver.forces(moved, a, rows, result, virial=True).virial

    virial = solved(0.0)[1]
    slope = (solved(1e-6)[0] - solved(-1e-6)[0]) / 2e-6
    assert slope == pytest.approx(-virial[2, 0], abs=1e-6 * np.abs(virial).max())
    assert abs(virial[2, 0] - virial[0, 2]) > 1e-3 * np.abs(virial).max()  # the field's torque is between the two


def test_lorentz_field_of_a_cubic_lattice():
    """Correction and own part of an even lattice are phi M/3; the wider the split, the smaller the error.

    The error is the smear's at the lattice's wave numbers, of alternating sign: 2.1, -1.6, 0.8, -0.3 % here.
    """
    n, spacing, applied = 7, 1.2 * D, np.full((343, 3), 4e5)
    box = ShearedBox(np.full(3, n * spacing))
    x = (np.indices((n, n, n)).reshape(3, -1).T + 0.5) * spacing
    M = np.array([3e5, 2e5, 1e6])
    volume, errors = np.pi / 6.0 * D**3, []
    for width in (2.5, 3.0, 3.5, 4.0):
        solver = MutualMoments(grain_table(IRON, "mutual"), near=False, reach=width * D, smear=True)
        rows = neighbour_rows(x, 4.1 * D, box)
        start = np.tile(volume * M, (n**3, 1))
        result = solver.solve(x, np.full(n**3, 0.5 * D), applied, rows, start=start, max_sweeps=1)
        lorentz = np.pi / 6.0 / 1.2**3 / 3.0 * M
        errors.append(np.abs((result.field - applied) / lorentz - 1.0).max())
    assert errors == pytest.approx([0.0214, 0.0159, 0.0076, 0.0028], rel=0.05)


def test_the_cells_stress_is_the_whole_one():
    """What the grains' own motion carries is in the pressure too."""
    cells = [PowderCell(DRY) for _ in range(2)]
    stir = np.random.default_rng(1).normal(0.0, 20.0 * cells[0].rate * D, (DRY.count, 3))
    for cell in cells:
        cell.dem.grains.velocity += stir
    cells[0].window(1)
    series, stress = cells[0].series, cells[1].dem.run(DRY.steps_per_look).stress
    assert np.trace(stress.motion) > 0.1 * abs(np.trace(stress.total))
    assert series.pressure[0] == pytest.approx(stress.pressure, rel=1e-12)
    assert series.tau[0] == pytest.approx(stress.shear, rel=1e-12)
    assert series.tau_across[0] == pytest.approx(-stress.total[2, 0], rel=1e-12)


def test_bits_do_not_depend_on_threads():
    """Of a cell large enough that two threads share its grains and pulls, with lists made again while it is sheared."""
    ends = []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        cell = PowderCell(dataclasses.replace(POWDER, count=520, inertial_number=0.3))
        cell.window(25)
        field = cell.magnetism.magnetisation.moment, cell.magnetism.lagged_stress
        ends.append((cell.dem.state(), *field, cell.series.tau[0]))
    assert cell.dem.list_version > 2 and cell.series.contacts[0] > 1.0 and cell.series.tau_near[0] != 0.0
    assert len(cell.dem._list.chunks.reaction) > 500  # of pairs whose grains are not in one chunk
    (state, *one), (other, *two) = ends
    assert [name for name, array in state.items() if array.tobytes() != other[name].tobytes()] == []
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def test_rows_hold_every_neighbour_while_the_cell_is_sheared():
    """At every look against all images, in a cell whose lists are made again now and then."""
    cell, seen = PowderCell(dataclasses.replace(POWDER, inertial_number=0.3)), set()
    dem, magnetism = cell.dem, cell.magnetism
    for _ in range(60):
        cell.window(4)
        rows = cell.simulation.rows(magnetism.solver.reach)
        x = np.array(dem.grains.position)
        seen.add(dem.list_version)
        fresh = neighbour_rows(x, 2.0 * D, cell.box)
        assert np.array_equal(rows.images, fresh.images)
        listed = {
            (int(i), int(j)) for i, j in zip(np.repeat(np.arange(70), np.diff(rows.start)), rows.other, strict=True)
        }
        wanted = zip(np.repeat(np.arange(70), np.diff(fresh.start)).tolist(), fresh.other.tolist(), strict=True)
        assert set(wanted) <= listed
    assert len(seen) > 3


def test_a_list_made_again_between_two_looks_changes_no_drive_and_no_lagged_force():
    """Both belong to places and images of the look, also of grains that have crossed a face since."""
    cell = PowderCell(dataclasses.replace(POWDER, inertial_number=0.3))
    cell.window(4)
    dem, result = cell.dem, []
    look(cell.simulation)
    looked_at = cell.box.strain

    def driven():
        number, pairs = np.asarray(dem.grains.particle_id), dem.listed_pairs
        i, j = number[pairs.rows()], number[pairs.other]
        order = np.lexsort((np.maximum(i, j), np.minimum(i, j)))
        near = dem.attraction.pair_drive[order, 1] != 0.0
        pair = np.stack([np.minimum(i, j), np.maximum(i, j)], axis=1)[order][near]
        return pair, dem.attraction.pair_drive[order][near], dem.external_force[np.argsort(number)]

    x = np.array(dem.grains.position)[np.argsort(dem.grains.particle_id)]
    for steps in (1, 400):
        dem.run(steps)
        dem.invalidate()
        dem.run(1)
        result.append(driven())
    moved = (np.array(dem.grains.position)[np.argsort(dem.grains.particle_id)] - x) / cell.box.lengths
    assert (np.abs(moved[:, 2]) > 0.5).any() and cell.box.strain - looked_at > 0.1  # wrapped across the flow
    (pair, drive, lagged), (other, same_drive, same_lagged) = result
    assert len(pair) > 100 and np.array_equal(pair, other)
    assert same_drive == pytest.approx(drive, rel=1e-7, abs=1e-9 * np.abs(drive[:, 1]).max())
    assert same_lagged == pytest.approx(lagged, abs=1e-9 * np.abs(drive[:, 1]).max())


def test_rolling_friction_works_on_the_grains():
    """Contacts lose energy to it; a cell without it has none of its springs."""
    lost = []
    for rolling in (0.0, 0.3):
        cell = PowderCell(dataclasses.replace(DRY, rolling=rolling, fill=0.5))
        cell.window(400)
        lost.append(cell.dem.run(100).energy_budget.dissipation)
        assert cell.series.power[0] > 0.0
    assert "rolling" not in lost[0] and lost[1]["rolling"] > 0.0


def test_a_cell_that_is_too_small_is_refused():
    needed = min_count(POWDER)
    assert needed <= 70
    with pytest.raises(ValueError, match="a neighbour twice"):
        PowderCell(dataclasses.replace(POWDER, count=needed - 5))
    assert PowderCell(DRY).mu_r == 1.0
