"""The attraction of a near pair beyond its dipoles, from the gap of every step and a drive that is held.

dF(g, h) a^2 + (mu_0 a^2 h_t^2) across(g), see `coupling.grain_law_table`. All that depends on the drive is found once
for many steps: its place in the table, and beyond `FOLLOWED` radii, where the range of the force is many steps long,
value and slope at the gap itself.
"""

from __future__ import annotations

import numpy as np

from coupling.moment_kernels import MU_0
from geometry.kernels.device_functions import device_function

FOLLOWED = 0.1  # radii: nearer ones read the table at every step
PLACE, FACTOR, ACROSS, GAP, PULL, SLOPE, N_GRIP = range(7)
"""Columns of what is held of a pair: place among the fields, mu_0 a^2 h^2 [N] (times what is left beyond the table's
end), across [N], and beyond FOLLOWED the gap [radii], the pull there [N] and its slope [N]; nearer, GAP is -1."""
_BESIDE = 1.02


@device_function(error_model="numpy", fastmath={"contract"})
def table_pull(table, gap, place, factor, across):
    """Pull [N] at a gap [radii]."""
    x = (np.log(gap) - table.gap_start) / table.gap_step
    if x >= table.force.shape[0] - 1:
        return 0.0
    x = max(x, 0.0)
    i, j = np.int64(x), np.int64(place)
    x -= i
    y = place - j
    low = table.force[i, j] + y * (table.force[i, j + 1] - table.force[i, j])
    high = table.force[i + 1, j] + y * (table.force[i + 1, j + 1] - table.force[i + 1, j])
    aside = table.across[i] + x * (table.across[i + 1] - table.across[i])
    return factor * (low + x * (high - low)) + across * aside


@device_function(error_model="numpy", fastmath={"contract"})
def take_grip(table, gap, H, h_t2, radius, grip, q):
    """Fill ``grip[q]`` from the gap [radii], the drive H [A/m] and the square of the field across [A^2/m^2]."""
    unit = MU_0 * radius * radius
    place, factor = 0.0, 0.0
    if H != 0.0:
        h, share = abs(H) / table.scale, 1.0
        last = table.force.shape[1] - 1
        place = max((np.log(h) - table.field_start) / table.field_step, 0.0)
        if place >= last:  # beyond the table the excess falls as 1/h
            end = np.exp(table.field_start + last * table.field_step)
            h, share, place = end, end / h, last - 1e-9
        factor = unit * share * (h * table.scale) ** 2
    across = unit * h_t2
    grip[q, PLACE], grip[q, FACTOR], grip[q, ACROSS], grip[q, GAP] = place, factor, across, -1.0
    if gap > FOLLOWED:
        pull = table_pull(table, gap, place, factor, across)
        beside = table_pull(table, _BESIDE * gap, place, factor, across)
        grip[q, GAP], grip[q, PULL], grip[q, SLOPE] = gap, pull, (beside - pull) / ((_BESIDE - 1.0) * gap)


@device_function(error_model="numpy", fastmath={"contract"})
def held_pull(table, gap, grip, q):
    """Pull [N] at the present gap [radii]."""
    if grip[q, GAP] > 0.0:
        return grip[q, PULL] + grip[q, SLOPE] * (gap - grip[q, GAP])
    if grip[q, FACTOR] == 0.0 and grip[q, ACROSS] == 0.0:
        return 0.0
    return table_pull(table, gap, grip[q, PLACE], grip[q, FACTOR], grip[q, ACROSS])
