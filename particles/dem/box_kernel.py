"""Compiled parts of a step in a sheared box (`particles.sheared_box`): its flow, its images, its stress and work.

Everything here vanishes from the compiled step of grains in no such box, whose ``flow`` and ``virial`` are None.

Stress is measured by sums of r_a F_b over contacts and pulls, with F on the grain at r from its partner, and of
m p_a p_b over the grains, p = v - rate z e_x the velocity less the flow's, at the time of the positions. The work of
the shear is that of its three parts: -rate times the sums of r_z F_x and m p_x p_z, by the trapezoidal rule over drifts
like all works of the step (`particles.step_totals`). Each chunk adds to eight lanes of its own, added up in the order
of the chunks.
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, select, splat
from geometry.kernels.simd_tables import gather, gather_column, gather_columns, load, store
from particles.periodicity import DU, DX
from particles.sheared_box import MOST, MOST_X, MOST_Y, ShearedBox

# columns of `flow`: offset [m], strain, rate [1/s] and edges along x and z [m] of the box; the strain when the list was
# made, and by how much the box was stretched since; skin, and how far a pair that may come to act reaches [m]
OFFSET, STRAIN, RATE, LENGTH, HEIGHT, LIST_STRAIN, STRETCHED, SKIN, REACH, N_FLOW = range(10)
# rows of the virial: r_a F_b of contacts in row 3 a + b; of pulls, which are central, and of the motion xx, yy, zz, xy,
# xz, yz; time times the flux of momentum along x across z, by the velocities before and after a kick
CONTACT, PULL, MOTION, FLUX, FLUX_LATER, N_VIRIAL = 0, 9, 15, 21, 22, 23
ZX_OF_CONTACT, XZ_OF_CENTRAL = 6, 4
# sums over steps: those of the rows up to FLUX, works [J], and the parts of these that wait for the next drift
CONTACT_WORK, PULL_WORK, MOTION_WORK, LAST_CONTACT, LAST_PULL, LAST_FLUX, N_BOX_SUMS = range(FLUX, FLUX + 7)
_LAYER, _ROW = (2 * MOST_X + 1) * (2 * MOST_Y + 1), 2 * MOST_X + 1


def flow_of(box: ShearedBox, skin: float, interaction: float) -> np.ndarray:
    """The argument ``flow`` of a step: of a list with a ``skin`` [m] beyond the largest ``interaction`` [m]."""
    flow = np.zeros(N_FLOW)
    flow[OFFSET], flow[STRAIN], flow[RATE] = box.offset, box.strain, box.rate
    flow[LENGTH], flow[HEIGHT] = box.lengths[0], box.lengths[2]
    flow[LIST_STRAIN], flow[STRETCHED] = box.list_strain, box.stretched
    flow[SKIN], flow[REACH] = skin, interaction + 0.5 * skin
    return flow


def virial_scratch(n_chunks: int) -> np.ndarray:
    """Return sums of so many chunks: ``virial`` of `particles.dem.kernel_state.GrainState`."""
    return np.zeros((n_chunks, N_VIRIAL, LANES))


# -- images of the partners


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def _rows(shift, slot):
    s = gather(shift, slot)
    return (
        s[0] + MOST, s[1] + MOST, s[2] + MOST, s[3] + MOST, s[4] + MOST, s[5] + MOST, s[6] + MOST, s[7] + MOST
    )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def moved_to_images(images, shift, slot, x, y, z):
    """Positions [m] of eight partners in the slots ``slot``, where their images stand."""
    if images is not None:
        dx, dy, dz, _ = gather_columns(images, _rows(shift, slot), DX)
        x, y, z = x + dx, y + dy, z + dz
    return x, y, z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def swept_to_images(images, shift, slot, x):
    """Velocities along x [m/s] of eight partners in the slots ``slot``, as their images have them."""
    if images is not None:
        x = x + gather_column(images, _rows(shift, slot), DU)
    return x


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def moved_to_image(images, shift, k, x, y, z):
    """As `moved_to_images`, of the partner in slot k alone."""
    if images is not None:
        row = np.int64(shift[k]) + MOST
        x, y, z = x + images[row, DX], y + images[row, DX + 1], z + images[row, DX + 2]
    return x, y, z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def swept_to_image(images, shift, k, x):
    """As `swept_to_images`, of the partner in slot k alone."""
    if images is not None:
        x = x + images[np.int64(shift[k]) + MOST, DU]
    return x


# -- velocities and displacements less the flow's


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def peculiar_velocity(flow, along_x, along_z, z, time):
    """Velocities along x [m/s] less the flow's, at the places ``time`` [s] from the heights z [m]."""
    if flow is not None:
        along_x = along_x - flow[RATE] * (z + time * along_z)
    return along_x


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def peculiar_displacement(flow, dt, dx, dz, from_z):
    """Displacements along x [m] since the list was made, less the flow's, at the end of a step of ``dt`` [s]."""
    if flow is not None:
        dx = dx - (flow[STRAIN] - flow[LIST_STRAIN] + flow[RATE] * dt) * (from_z + 0.5 * dz)
    return dx


@device_function(without_refcounts=True, error_model="numpy")
def allowed_travel(flow, squared_travel):
    """Square of the displacement at which a list must be made again [m^2], less than 0 where it must in any case."""
    if flow is not None:
        room = flow[SKIN] - (abs(flow[STRAIN] - flow[LIST_STRAIN]) + flow[STRETCHED]) * flow[REACH]
        squared_travel = 0.25 * room * room if room > 0.0 else -1.0
    return squared_travel


# -- stress


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def clear_virial(virial, chunk):
    """Begin the sums of a chunk in a step."""
    if virial is not None:
        for row in range(N_VIRIAL):
            store(virial[chunk], row, 0, splat(0.0))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _add(rows, row, x):
    store(rows, row, 0, load(rows, row, 0) + x)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def add_contact_virial(virial, chunk, away, force):
    """Add eight contacts: centres of the partners from the grains' [m] (3), forces on the grains [N] (3)."""
    if virial is not None:
        rows = virial[chunk]
        x, y, z = -away[0], -away[1], -away[2]
        fx, fy, fz = force
        _add(rows, CONTACT, x * fx)
        _add(rows, CONTACT + 1, x * fy)
        _add(rows, CONTACT + 2, x * fz)
        _add(rows, CONTACT + 3, y * fx)
        _add(rows, CONTACT + 4, y * fy)
        _add(rows, CONTACT + 5, y * fz)
        _add(rows, CONTACT + 6, z * fx)
        _add(rows, CONTACT + 7, z * fy)
        _add(rows, CONTACT + 8, z * fz)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def add_pull_virial(virial, chunk, away, force):
    """Add eight pulls, as `add_contact_virial`."""
    if virial is not None:
        rows = virial[chunk]
        x, y, z = -away[0], -away[1], -away[2]
        fx, fy, fz = force
        _add(rows, PULL, x * fx)
        _add(rows, PULL + 1, y * fy)
        _add(rows, PULL + 2, z * fz)
        _add(rows, PULL + 3, x * fy)
        _add(rows, PULL + 4, x * fz)
        _add(rows, PULL + 5, y * fz)


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def no_motion():
    """Sums of `add_motion` over no grain."""
    none = splat(0.0)
    return none, none, none, none, none, none, none, none


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def add_motion(flow, sums, active, dt, m, before, after):
    """Add what eight grains carry, by their velocities before and after the kick, less the flow's [m/s] (3)."""
    if flow is not None:
        m = select(active, m, 0.0)
        x, y, z = 0.5 * (before[0] + after[0]), 0.5 * (before[1] + after[1]), 0.5 * (before[2] + after[2])
        half = 0.5 * dt * m * z
        sums = (
            sums[0] + m * x * x, sums[1] + m * y * y, sums[2] + m * z * z, sums[3] + m * x * y, sums[4] + m * x * z,
            sums[5] + m * y * z, sums[6] + half * before[0], sums[7] + half * after[0],
        )  # fmt: skip
    return sums


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def store_motion(virial, chunk, sums):
    """Add the sums of `add_motion` to those of the chunk."""
    if virial is not None:
        rows = virial[chunk]
        _add(rows, MOTION, sums[0])
        _add(rows, MOTION + 1, sums[1])
        _add(rows, MOTION + 2, sums[2])
        _add(rows, MOTION + 3, sums[3])
        _add(rows, MOTION + 4, sums[4])
        _add(rows, MOTION + 5, sums[5])
        _add(rows, FLUX, sums[6])
        _add(rows, FLUX_LATER, sums[7])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _total(virial, row):
    total = 0.0
    for c in range(virial.shape[0]):
        for lane in range(LANES):
            total += virial[c, row, lane]
    return total


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def move_box(dt, flow, images, virial, sums):
    """End a step: its stress and work come to the ``sums``, the layer above moves on, and the images with it."""
    if flow is not None:
        rate = flow[RATE]
        for row in range(FLUX):
            total = _total(virial, row)
            sums[row] += total
            # works of the drift that has just ended, by the mean of the last and the present forces
            if row == CONTACT + ZX_OF_CONTACT:
                sums[CONTACT_WORK] -= 0.5 * dt * rate * (sums[LAST_CONTACT] + total)
                sums[LAST_CONTACT] = total
            elif row == PULL + XZ_OF_CENTRAL:
                sums[PULL_WORK] -= 0.5 * dt * rate * (sums[LAST_PULL] + total)
                sums[LAST_PULL] = total
        sums[MOTION_WORK] -= rate * (sums[LAST_FLUX] + _total(virial, FLUX))
        sums[LAST_FLUX] = _total(virial, FLUX_LATER)
        flow[OFFSET] += rate * flow[HEIGHT] * dt
        flow[STRAIN] += rate * dt
        for row in range(images.shape[0]):
            layer = (row - MOST + _LAYER // 2) // _LAYER
            line = row - MOST - _LAYER * layer
            images[row, DX] = (line - _ROW * ((line + _ROW // 2) // _ROW)) * flow[LENGTH] + layer * flow[OFFSET]
