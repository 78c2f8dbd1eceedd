"""Tables of two magnetised spheres for kernels: magnetisation of a lone sphere, and the excess of a near pair over it.

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
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from field.laws.powder_law import GrainLaw, ThesisLaw
from field.laws.reluctivity import Law
from field.spheres.lone_sphere import saturation, sphere_magnetisation
from field.spheres.pair_table import FADE_TO, fade, pair_table
from field.spheres.transverse_pair import transverse_excess
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import from_integers, maximum, select, to_integers
from geometry.kernels.simd_math import log

GAUSS_PLACES = (0.2386191860831969, 0.6612093864662645, 0.9324695142031521)  # of six points on -1 .. 1
GAUSS_WEIGHTS = (0.46791393457269104, 0.3607615730481386, 0.17132449237917036)
FARTHEST_GAP = FADE_TO  # radii: beyond it two spheres are mutual dipoles
# first, last and number of the excess' grid: gaps in radii, fields in the saturation
GAPS, FIELDS = (3e-4, FARTHEST_GAP, 97), (3e-4, 3.0, 201)
MODELS = ("mutual", "near_field")


class GrainLawTable(NamedTuple):
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
    across: np.ndarray  # (g,) weakening of the repulsion across, over h_t^2, for spheres of high permeability


def _tabulate(
    magnetisation: Callable[[np.ndarray], np.ndarray],
    Ms: float | None,
    excess: tuple[Callable, Callable] | None = None,
) -> GrainLawTable:
    """Put a grain's law on the grids.

    Parameters
    ----------
    magnetisation : callable h [A/m] -> M [A/m]
        Of a lone sphere in a uniform field.
    Ms : float or None
        Saturation [A/m]; None: linear.
    excess : (force, moment), optional
        Functions of (g, h), g in radii and h in ``Ms``, of `PairTable`; None: mutual dipoles only.
    """
    if Ms is None and excess is not None:
        raise ValueError("a linear material has no table of pairs; give the grains a saturation, or model 'mutual'")
    scale = np.inf if Ms is None else float(Ms)  # every field is weak to a linear one
    h = np.exp(np.linspace(np.log(1e-6), np.log(1e3), 801))
    H = h if Ms is None else scale * h
    ratio = magnetisation(H) / H
    slope = np.gradient(ratio, edge_order=2)
    slope[2:-2] = (8.0 * (ratio[3:-1] - ratio[1:-3]) - (ratio[4:] - ratio[:-4])) / 12.0
    x, y = (np.linspace(np.log(first), np.log(last), number) for first, last, number in (GAPS, FIELDS))
    force = moment = np.zeros((2, 2))
    across = np.zeros(2)
    if excess is not None:
        across = np.array([transverse_excess(np.inf, gap) for gap in np.exp(x)]) * fade(np.exp(x))
        g, k = np.meshgrid(np.exp(x), np.exp(y), indexing="ij")
        force, moment = excess[0](g, k) / k**2, excess[1](g, k) / k
    return GrainLawTable(
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
        across,
    )


def grain_table(law: Law | GrainLaw, model: str) -> GrainLawTable:
    """The table that the kernels read for a grain's law: bulk law, or `GrainLaw`; the near pairs' with near_field.

    Raises
    ------
    ValueError
        An unknown model, the law of the thesis, near_field with a law that does not saturate.
    """
    try:
        return _kept_table(law, model)  # type: ignore[arg-type]
    except TypeError:  # a law of points cannot be hashed
        return _make_table(law, model)


def _make_table(law: Law | GrainLaw, model: str) -> GrainLawTable:
    if model not in MODELS:
        raise ValueError(f"model = {model!r}; allowed: {', '.join(MODELS)}")
    if isinstance(law, ThesisLaw):
        raise ValueError(
            "the law of the thesis, M = chi H, has no material behind it: it goes with effects.magnetic_force alone"
        )

    def sphere(h):
        return sphere_magnetisation(law, h)

    try:
        Ms = saturation(law)
    except ValueError:
        if model == "near_field":
            raise
        return _tabulate(sphere, None)
    excess = None
    if model == "near_field":
        pair = pair_table(law)
        excess = (pair.excess_force, pair.excess_moment)
    return _tabulate(sphere, Ms, excess)


_kept_table = lru_cache(maxsize=8)(_make_table)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def sphere_ratio(table, H):
    """M/H and dM/dH of a lone sphere in H [A/m]; their limit at 0; beyond the grid M is what it was at its end."""
    last = table.sphere_ratio.shape[0] - 1
    if H <= 0.0:
        return table.sphere_ratio[0], table.sphere_ratio[0]
    t = (np.log(H / table.scale) - table.sphere_start) / table.sphere_step
    if t <= 0.0:
        return table.sphere_ratio[0], table.sphere_ratio[0]
    if not t < last:  # also of NaN, which stays one and is no index
        return table.sphere_ratio[last] * np.exp((last - t) * table.sphere_step), 0.0
    k = np.int64(t)
    t -= k
    a, b = table.sphere_ratio[k], table.sphere_ratio[k + 1]
    p, q = table.sphere_slope[k], table.sphere_slope[k + 1]
    rise = b - a
    second, third = 3.0 * rise - 2.0 * p - q, p + q - 2.0 * rise
    ratio = a + t * (p + t * (second + t * third))
    return ratio, ratio + (p + t * (2.0 * second + 3.0 * t * third)) / table.sphere_step


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def gap_index(table, gap):
    """Fractional row of the tables at a gap in radii; at least 0, not limited above."""
    return maximum((log(gap) - table.gap_start) * (1.0 / table.gap_step), 0.0)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def field_index(table, H):
    """Fractional column of the tables at a field H [A/m] of either sign; at least 0, not limited above."""
    h = abs(H) * (1.0 / table.scale)
    return maximum((log(h) - table.field_start) * (1.0 / table.field_step), 0.0)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def clamp_field(table, y, H):
    """Column j, remainder y, |H| limited to the last field, and the factor 1/h beyond it, of a `field_index`."""
    h, fraction = abs(H), 1.0
    last = table.force.shape[1] - 1
    if not y <= last:  # also of NaN, which stays one and is no index
        end = table.scale * np.exp(table.field_start + last * table.field_step)
        y, h, fraction = float(last), end, end / h
    j = min(np.int64(y), last - 1)
    return j, y - j, h, fraction


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def locate(table, gap, H):
    """Row i and its remainder x at a gap in radii, and `clamp_field` at a field H [A/m].

    i < 0 beyond the farthest gap, where there is no excess.
    """
    x = gap_index(table, gap)
    if not x < table.across.shape[0] - 1:
        return np.int64(-1), 0.0, np.int64(0), 0.0, 0.0, 0.0
    i = np.int64(x)
    j, y, h, fraction = clamp_field(table, field_index(table, H), H)
    return i, x - i, j, y, h, fraction


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def bilinear(values, i, x, j, y):
    """Interpolate a table at a place of `locate`."""
    low = values[i, j] + y * (values[i, j + 1] - values[i, j])
    high = values[i + 1, j] + y * (values[i + 1, j + 1] - values[i + 1, j])
    return low + x * (high - low)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def moment_at(table, x, y, H):
    """dM [A/m] at places of `gap_index` and `field_index`, of the field H [A/m]; odd in H."""
    if not x < table.across.shape[0] - 1:
        return 0.0
    i = np.int64(x)
    j, y, h, fraction = clamp_field(table, y, H)
    return np.copysign(h, H) * fraction * bilinear(table.moment, i, x - i, j, y)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def locate_eight(table, x, H):
    """Of eight near pairs at places ``x`` of `gap_index` in fields H [A/m], as `near_excess`: rows of the tables and
    how far behind them, the same of columns; |H| limited to the last field, the factor beyond it, 1.0 (0.0 beyond the
    last gap)."""
    last_row, last_column = table.across.shape[0] - 1.0, table.force.shape[1] - 1.0
    y, h = field_index(table, H), abs(H)
    end = table.scale * np.exp(table.field_start + last_column * table.field_step)
    beyond = y > last_column
    y, size, fraction = select(beyond, last_column, y), select(beyond, end, h), select(beyond, end / h, 1.0)
    row = to_integers(select(x < last_row - 1.0, x, last_row - 1.0))
    column = to_integers(select(y < last_column - 1.0, y, last_column - 1.0))
    within = select(x < last_row, 1.0, 0.0)
    return row, x - from_integers(row), column, y - from_integers(column), size, fraction, within


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def excess_moment(table, gap, H):
    """dM [A/m] at a gap in radii and a field H [A/m]; odd in H."""
    return moment_at(table, gap_index(table, gap), field_index(table, H), H)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def excess_force(table, gap, H):
    """dF [mu_0 A^2/m^2 a^2] >= 0 at a gap in radii and a field H [A/m] of either sign."""
    i, x, j, y, h, fraction = locate(table, gap, H)
    return 0.0 if i < 0 else bilinear(table.force, i, x, j, y) * h * h * fraction


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def near_excess(table, x, y, H):
    """dF [mu_0 A^2/m^2 a^2], dM [A/m] and `across` [-] at places of `gap_index` and `field_index`, of the field H."""
    if not x < table.across.shape[0] - 1:
        return 0.0, 0.0, 0.0
    i = np.int64(x)
    x -= i
    j, y, h, fraction = clamp_field(table, y, H)
    force = bilinear(table.force, i, x, j, y) * h * h * fraction
    moment = bilinear(table.moment, i, x, j, y) * h * fraction
    across = table.across[i] + x * (table.across[i + 1] - table.across[i])
    return force, moment if H > 0.0 else -moment, across


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def mean_force(table, gap, end, y, H):
    """dF as `near_excess`, its mean over a step that takes the gap to ``end``: by six points of Gauss in ln g."""
    force = 0.0
    middle, half = 0.5 * np.log(gap * end), 0.5 * np.log(end / gap)
    for k in range(3):
        for sign in (-1.0, 1.0):
            at = np.exp(middle + sign * GAUSS_PLACES[k] * half)
            dF, _, _ = near_excess(table, gap_index(table, at), y, H)
            force += GAUSS_WEIGHTS[k] * half * at * dF
    return force / (end - gap)
