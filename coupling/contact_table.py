"""What kernels read of two magnetised spheres: the lone sphere's magnetisation, and the excess of a near pair over it.

Both on grids that are even in the logarithms, fine enough to be read linearly (the pair) and by cubics (the sphere).
Lengths in grain radii, fields and magnetisations in `scale` [A/m] (the saturation of the material; infinite for a
linear one), forces in mu_0 scale^2 radius^2. The excess is what two equal spheres in a field h along their axis do
beyond mutual dipoles (`field.spheres.pair_table`): dF of their attraction, dM of each one's magnetisation; both end at
a gap of 1.2. Across their axis only the force is corrected (`field.spheres.transverse_pair`), by what linear spheres of
high permeability have and, for others, (beta_s beta_d)^1.2 of that, with beta = M/(3 h) of the lone sphere by secant
and by tangent: within 6 % of the multipoles from a permeability of 4 on, and nothing far in saturation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from field.spheres.pair_table import fade
from field.spheres.transverse_pair import transverse_excess
from geometry.inner_functions import inner

FARTHEST_GAP = 1.2  # radii: beyond it two spheres are mutual dipoles


class ContactTable(NamedTuple):
    """Arrays for the kernels; see the module. `sphere_*` over ln h, `pair_*` over (ln g, ln h)."""

    scale: float  # A/m
    sphere_start: float
    sphere_step: float
    sphere_ratio: np.ndarray  # (s,) M/h
    sphere_slope: np.ndarray  # (s,) its derivative over the index
    gap_start: float
    gap_step: float
    field_start: float
    field_step: float
    force: np.ndarray  # (g, h) dF/h^2
    moment: np.ndarray  # (g, h) dM/h
    work: np.ndarray  # (g, h) integral of dF/h^2 over the gap, from g to where it ends
    across: np.ndarray  # (g,) weakening of the repulsion across, over h_t^2, for spheres of high permeability


def contact_table(
    magnetisation: Callable[[np.ndarray], np.ndarray],
    saturation: float | None,
    excess: tuple[Callable, Callable, Callable] | None = None,
    *,
    gaps: tuple[float, float, int] = (3e-4, FARTHEST_GAP, 97),
    fields: tuple[float, float, int] = (3e-4, 3.0, 201),
) -> ContactTable:
    """Tabulate a grain's law.

    Parameters
    ----------
    magnetisation : callable h [A/m] -> M [A/m]
        Of a lone sphere in a uniform field.
    saturation : float or None
        [A/m]; None: linear.
    excess : (force, moment, work), optional
        Functions of (g, h), g in radii and h in `saturation`, of `PairTable`; None: mutual dipoles only.
    gaps, fields : (first, last, number)
        Grid of the excess.
    """
    if saturation is None and excess is not None:
        raise ValueError("a linear material has no table of pairs; give the grains a saturation, or model 'mutual'")
    scale = np.inf if saturation is None else float(saturation)  # every field is weak to a linear one
    h = np.exp(np.linspace(np.log(1e-6), np.log(1e3), 801))
    H = h if saturation is None else scale * h
    ratio = magnetisation(H) / H
    slope = np.gradient(ratio, edge_order=2)
    slope[2:-2] = (8.0 * (ratio[3:-1] - ratio[1:-3]) - (ratio[4:] - ratio[:-4])) / 12.0
    x, y = (np.linspace(np.log(first), np.log(last), number) for first, last, number in (gaps, fields))
    force = moment = work = np.zeros((2, 2))
    across = np.zeros(2)
    if excess is not None:
        across = np.array([transverse_excess(np.inf, gap) for gap in np.exp(x)]) * fade(np.exp(x))
        g, k = np.meshgrid(np.exp(x), np.exp(y), indexing="ij")
        force, moment, work = excess[0](g, k) / k**2, excess[1](g, k) / k, excess[2](g, k) / k**2
    return ContactTable(
        scale,
        float(np.log(h[0])),
        float(np.log(h[1] / h[0])),
        ratio,
        slope,
        float(x[0]),
        float(x[1] - x[0]),
        float(y[0]),
        float(y[1] - y[0]),
        np.ascontiguousarray(force),
        np.ascontiguousarray(moment),
        np.ascontiguousarray(work),
        across,
    )


@inner(error_model="numpy", fastmath={"contract"})
def sphere_ratio(table, H):
    """M/H and dM/dH of a lone sphere in H [A/m]; their limit at 0; beyond the grid M is what it was at its end."""
    last = table.sphere_ratio.shape[0] - 1
    if H <= 0.0:
        return table.sphere_ratio[0], table.sphere_ratio[0]
    t = (np.log(H / table.scale) - table.sphere_start) / table.sphere_step
    if t <= 0.0:
        return table.sphere_ratio[0], table.sphere_ratio[0]
    if t >= last:
        return table.sphere_ratio[last] * np.exp((last - t) * table.sphere_step), 0.0
    k = np.int64(t)
    t -= k
    a, b = table.sphere_ratio[k], table.sphere_ratio[k + 1]
    p, q = table.sphere_slope[k], table.sphere_slope[k + 1]
    rise = b - a
    second, third = 3.0 * rise - 2.0 * p - q, p + q - 2.0 * rise
    ratio = a + t * (p + t * (second + t * third))
    return ratio, ratio + (p + t * (2.0 * second + 3.0 * t * third)) / table.sphere_step


@inner(error_model="numpy", fastmath={"contract"})
def across_at(table, gap):
    """`across` at a gap in radii; 0 beyond the farthest gap."""
    x = (np.log(gap) - table.gap_start) / table.gap_step
    if x >= table.across.shape[0] - 1:
        return 0.0
    x = max(x, 0.0)
    i = np.int64(x)
    return table.across[i] + (x - i) * (table.across[i + 1] - table.across[i])


@inner(error_model="numpy", fastmath={"contract"})
def excess_at(table, values, gap, h):
    """`values` (``force`` or ``moment``) at a gap in radii and a field h > 0 in `scale`; its field, and a share of it.

    0 beyond the farthest gap. Beyond the last field the excess falls as 1/h: its share of what it was there.
    """
    share = 1.0
    x = (np.log(gap) - table.gap_start) / table.gap_step
    if x >= values.shape[0] - 1:
        return 0.0, h, share
    x = max(x, 0.0)
    i = np.int64(x)
    x -= i
    y = max((np.log(h) - table.field_start) / table.field_step, 0.0)
    last = values.shape[1] - 1
    if y >= last:
        y = float(last)
        end = np.exp(table.field_start + last * table.field_step)
        h, share = end, end / h
    j = min(np.int64(y), last - 1)
    y -= j
    low = values[i, j] + y * (values[i, j + 1] - values[i, j])
    high = values[i + 1, j] + y * (values[i + 1, j + 1] - values[i + 1, j])
    return low + x * (high - low), h, share


@inner(error_model="numpy", fastmath={"contract"})
def excess_force(table, gap, H):
    """dF [mu_0 A^2/m^2 a^2] >= 0 at a gap in radii and a field H [A/m] of either sign."""
    if H == 0.0:
        return 0.0
    ratio, h, share = excess_at(table, table.force, gap, abs(H) / table.scale)
    return ratio * share * (h * table.scale) ** 2


@inner(error_model="numpy", fastmath={"contract"})
def mean_excess_force(table, gap, end, H):
    """Mean of dF over a step that takes the gap to ``end``, (W(gap) - W(end))/(end - gap); see `excess_force`."""
    if H == 0.0:
        return 0.0
    if abs(end - gap) < 1e-3 * gap:
        return excess_force(table, gap, H)
    first, h, share = excess_at(table, table.work, gap, abs(H) / table.scale)
    if first == 0.0:
        h, share = abs(H) / table.scale, 1.0
    last, _, _ = excess_at(table, table.work, end, abs(H) / table.scale)
    return (first - last) / (end - gap) * share * (h * table.scale) ** 2


@inner(error_model="numpy", fastmath={"contract"})
def excess_moment(table, gap, H):
    """dM [A/m] at a gap in radii and a field H [A/m]; odd in H."""
    if H == 0.0:
        return 0.0
    ratio, h, share = excess_at(table, table.moment, gap, abs(H) / table.scale)
    M = ratio * share * h * table.scale
    return M if H > 0.0 else -M
