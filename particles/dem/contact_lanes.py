"""Forces of contacts side by side: eight lanes of a processor's wide registers hold eight contacts.

The arithmetic of a contact is long and has hardly a memory access, so it is done for LANES contacts at once. Those of
neighbouring rows are gathered into a batch until it is full (`particles.dem.pair_kernel`), their forces are found
here, and scattered to the grains in the order of the pairs. What a batch holds and where follows from the list and the
state alone, and lanes that hold no contact are computed and not read.

A block is LANES contacts, field by field, so that a field is one wide load. `by_lane` shows it as an array (lane,
field) whose strides the compiler knows: only then does it see that lanes do not touch each other, and takes all at
once. The functions of a contact (`particles.dem.contact_kernel`) do not know about it: they are given such arrays as
the contact's history and as the law's rows, a row a lane.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array, populate_array

from geometry.inner_functions import inner
from geometry.lane_functions import square_root
from particles.dem import lane_fields as at
from particles.dem.attraction_kernel import place_of_gap
from particles.dem.contact_kernel import Touch, contact_force, rolling_torque, twisting_torque
from particles.laws.springs import INTO_CALLER, equal, with_rows


def make_batch(n_chunks: int) -> tuple[np.ndarray, np.ndarray]:
    """Scratch of so many chunks: ``blocks`` (c, BLOCKS, N_FIELDS, LANES) and ``noted`` (c, 2, ROOM) int32."""
    return np.zeros((n_chunks, at.BLOCKS, at.N_FIELDS, at.LANES)), np.zeros((n_chunks, 2, at.ROOM), dtype=np.int32)


def _by_lane(typing_context, blocks, chunk, block, first):
    """Fields from ``first`` on of a block of a chunk: an array (LANES, fields) with strides known to the compiler."""
    of_lanes = types.Array(types.float64, 2, "F")

    def code(context, builder, signature, arguments):
        blocks, chunk, block, first = arguments
        source = make_array(signature.args[0])(context, builder, blocks)
        word = context.get_value_type(types.intp)

        def constant(value):
            return ir.Constant(word, value)

        block = builder.add(builder.mul(chunk, constant(at.BLOCKS)), block)
        offset = builder.mul(builder.add(builder.mul(block, constant(at.N_FIELDS)), first), constant(at.LANES))
        made = make_array(of_lanes)(context, builder)
        populate_array(
            made,
            data=builder.gep(source.data, [offset]),
            shape=[constant(at.LANES), constant(at.N_FIELDS)],
            strides=[constant(8), constant(8 * at.LANES)],
            itemsize=constant(8),
            meminfo=None,
        )
        return made._getvalue()

    integers = types.intp, types.intp, types.intp
    return of_lanes(blocks, *integers), code


by_lane: Any = intrinsic(_by_lane)


def lane_column(energy_column):
    """First column of the last forces in a block's history, or None without an energy budget."""
    return None if energy_column is None else at.ENERGY_COLUMN


@overload(lane_column, jit_options=INTO_CALLER)
def _lane_column(energy_column):
    if isinstance(energy_column, types.NoneType):
        return lambda energy_column: None
    return lambda energy_column: at.ENERGY_COLUMN


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def forces_by_lane(chunk, count, dt, law, resistance, energy_column, alike, blocks):
    """Forces and torques of the first ``count`` contacts of a batch; what they remember is renewed in the block.

    ``energy_column`` is that of the list; ``alike`` are radius [m] and mass [kg] of equal grains.
    """
    column = lane_column(energy_column)  # here, where the compiler sees what it is: otherwise lanes stay single
    for b in range((count + at.LANES - 1) // at.LANES):
        lane = by_lane(blocks, chunk, b, 0)
        table = with_rows(law, by_lane(blocks, chunk, b, at.LAW))
        history = by_lane(blocks, chunk, b, at.HISTORY)
        for q in range(at.LANES):
            dx, dy, dz = lane[q, at.CENTRE], lane[q, at.CENTRE + 1], lane[q, at.CENTRE + 2]
            ux, uy, uz = lane[q, at.VELOCITY], lane[q, at.VELOCITY + 1], lane[q, at.VELOCITY + 2]
            sx, sy, sz = lane[q, at.SPINS], lane[q, at.SPINS + 1], lane[q, at.SPINS + 2]
            d2 = dx * dx + dy * dy + dz * dz
            d = square_root(d2)
            inverse = d * (1.0 / d2) if d2 > 0.0 else 0.0  # beside the root, not after it
            nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
            if equal(law):
                ri, mi = alike
                reach = 2.0 * ri
                li, r_eff, m_eff = 0.5 * d, 0.5 * ri, 0.5 * mi
                lj = li
                ax, ay, az = li * sx, li * sy, li * sz
            else:
                ri, rj, mi, mj = lane[q, at.RADIUS_I], lane[q, at.RADIUS_J], lane[q, at.MASS_I], lane[q, at.MASS_J]
                reach = ri + rj
                m_eff = mi * mj / (mi + mj)
                share = ri / reach
                li, r_eff = d * share, rj * share
                lj = d - li
                half, rest = 0.5 * d, 0.5 * (li - lj)
                ax = half * sx + rest * lane[q, at.TURNING]
                ay = half * sy + rest * lane[q, at.TURNING + 1]
                az = half * sz + rest * lane[q, at.TURNING + 2]
            # by how much n has turned in the drift that has just ended
            hx, hy, hz = -ux * dt * inverse, -uy * dt * inverse, -uz * dt * inverse
            along = hx * nx + hy * ny + hz * nz
            inverse_last = 1.0 + along  # d/d_last
            touch = Touch(
                max(reach - d, 0.0),  # not less by round-off
                (nx, ny, nz),
                (ux + ay * nz - az * ny, uy + az * nx - ax * nz, uz + ax * ny - ay * nx),
                ((hx - along * nx) * inverse_last, (hy - along * ny) * inverse_last, (hz - along * nz) * inverse_last),
                0.5 * (sx * nx + sy * ny + sz * nz),
            )
            force = contact_force(table, q, column, m_eff, r_eff, dt, touch, history, q)
            stored = force.stored
            gx, gy, gz = force.x, force.y, force.z
            mx, my, mz = ny * gz - nz * gy, nz * gx - nx * gz, nx * gy - ny * gx
            tx, ty, tz = li * mx, li * my, li * mz
            lane[q, at.OVERLAP] = touch.delta
            lane[q, at.FORCE], lane[q, at.FORCE + 1], lane[q, at.FORCE + 2] = gx, gy, gz
            if resistance is None and equal(law):  # both torques are the same
                lane[q, at.TORQUE_I], lane[q, at.TORQUE_I + 1], lane[q, at.TORQUE_I + 2] = tx, ty, tz
            else:
                mx, my, mz = lj * mx, lj * my, lj * mz
                if resistance is not None:
                    px, py, pz = lane[q, at.TURNING], lane[q, at.TURNING + 1], lane[q, at.TURNING + 2]
                    if equal(law):
                        inertia = 0.2 * mi * ri * ri
                    else:
                        own, others = mi * ri * ri, mj * rj * rj
                        inertia = 0.4 * own * others / (own + others)
                    lost_r = lost_w = 0.0
                    if resistance.rolling >= 0:
                        (hx, hy, hz), e, lost_r = rolling_torque(
                            table, q, column, r_eff, inertia, dt, force, touch, (px, py, pz), history, q,
                            at.ROLLING_COLUMN,
                        )  # fmt: skip
                        stored += e
                        tx, ty, tz = tx + hx, ty + hy, tz + hz
                        mx, my, mz = mx - hx, my - hy, mz - hz
                    if resistance.twisting >= 0:
                        spin = px * nx + py * ny + pz * nz
                        torque, e, lost_w = twisting_torque(
                            table, q, column, r_eff, inertia, dt, force, spin, history, q, at.TWISTING_COLUMN
                        )
                        stored += e
                        tx, ty, tz = tx + torque * nx, ty + torque * ny, tz + torque * nz
                        mx, my, mz = mx - torque * nx, my - torque * ny, mz - torque * nz
                    if energy_column is not None:
                        lane[q, at.LOST_R], lane[q, at.LOST_W] = lost_r, lost_w
                lane[q, at.TORQUE_I], lane[q, at.TORQUE_I + 1], lane[q, at.TORQUE_I + 2] = tx, ty, tz
                lane[q, at.TORQUE_J], lane[q, at.TORQUE_J + 1], lane[q, at.TORQUE_J + 2] = mx, my, mz
            if energy_column is not None:
                lane[q, at.STORED] = stored
                lane[q, at.LOST_N], lane[q, at.LOST_T], lane[q, at.LOST_S] = force.lost_n, force.lost_t, force.lost_s


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def gaps_by_lane(chunk, count, law, radius, held, blocks):
    """Gaps of the first ``count`` pairs of a batch, and where they lie in the table of the attraction.

    ``radius`` [m] is that of grains that are all equal.
    """
    for b in range((count + at.LANES - 1) // at.LANES):
        lane = by_lane(blocks, chunk, b, 0)
        for q in range(at.LANES):
            dx, dy, dz = lane[q, at.CENTRE], lane[q, at.CENTRE + 1], lane[q, at.CENTRE + 2]
            d2 = dx * dx + dy * dy + dz * dz
            d, inverse = square_root(d2), 1.0 / d2 if d2 > 0.0 else 0.0
            if equal(law):
                gap = (d - 2.0 * radius) / radius
            else:
                ri, rj = lane[q, at.RADIUS_I], lane[q, at.RADIUS_J]
                gap = (d - (ri + rj)) * (ri + rj) / (2.0 * ri * rj)
            lane[q, at.INVERSE], lane[q, at.GAP] = d * inverse, gap
            lane[q, at.GAP_PLACE] = place_of_gap(held, gap)
