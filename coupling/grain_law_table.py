"""Tables of magnetised spheres for kernels: magnetisation of a lone sphere, and the energy of the neck of a near pair.

All grids are even in the logarithms. Fields and magnetisations are in `scale` [A/m] (the saturation of the material;
infinite for a linear one). Of the lone sphere in a field h, over ln h: M/h and its slope, and the coenergy integral of
M dh over h^2. Over M, evenly: the contrast c = (beta_s beta_d)^0.6 with beta = M/(3 h) by secant and by tangent, what
saturation leaves of a near pair's response across its line of centres (1 for a high permeability, 0 in saturation).

The neck of two spheres with the magnetomotive force (mmf) D [A], with a gap of g radii between their surfaces, has the
energy

    w = mu_0 a D^2 y(ln g, ln z),    z = |D|/(s Ms a),

with s the capacity that the magnetisation of both leaves (`coupling.mutual_moments`) and a the radius, of unequal
spheres 2 a_i a_j/(a_i + a_j). ``neck`` holds y and its derivatives at the nodes (`field.spheres.neck_energy`), read as
bicubic Hermite polynomials, so that the flux, the response of the capacity and the force,

    q = -(dw/dD)/mu_0 = -a D (2 y + y'),    (dw/ds)/mu_0 = -a D^2 y'/s,    F = dw/d(g a) = mu_0 D^2 dy/dg,

(' = d/d ln z) are exact derivatives of one function. Below the grid a neck is linear (y constant), beyond it the flux
has reached the capacity (y ~ 1/z). Below the smallest gap g_s of a powder w goes on along its tangent, w(g_s) +
(g - g_s) dw/dg, as far as g = -g_s; the force there is that at g_s. From a gap of 1.2 on there is no neck.

Across the line of centres two near spheres have less than the energy of their dipoles by ``across`` (g): kappa(g) of
`field.spheres.transverse_pair`, read linearly in ln g, see `coupling.mutual_moments`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from coupling.isolated_pair import isolated_pull
from field.laws.powder_law import GrainLaw, ThesisLaw
from field.laws.reluctivity import MU_0, Law
from field.spheres.lone_sphere import bulk_law, saturation, sphere_magnetisation
from field.spheres.neck_energy import NeckEnergy, neck_energy
from field.spheres.pair_table import FADE_TO, fade, fade_slope
from field.spheres.transverse_pair import transverse_fraction, transverse_response
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import from_integers, maximum, select, to_integers
from geometry.kernels.simd_math import log
from geometry.kernels.simd_tables import gather_columns

FARTHEST_GAP = FADE_TO  # radii: beyond it two spheres are mutual dipoles
MODELS = ("mutual", "near_field")
SMALLEST_MMF = 1e-200  # A: of a logarithm
SMALLEST_CAPACITY = 1e-6
RATIO, RATIO_SLOPE, COENERGY, COENERGY_SLOPE, N_SPHERE = range(5)
CONTRASTS = 1024  # intervals of the contrast's grid, over M up to the saturation


class GrainLawTable(NamedTuple):
    """Arrays for the kernels; see the module.

    Attributes
    ----------
    scale : float
        [A/m].
    sphere_start, sphere_step : float
        Grid in ln h of the lone sphere.
    sphere : ndarray, shape (s, N_SPHERE)
        M/h and coenergy over h^2, each with its derivative over the index.
    contrast : ndarray, shape (CONTRASTS + 1, 3)
        c, its derivative over the index, and dM/dh, at even steps of M from 0 to the saturation.
    gap_start, gap_step, mmf_start, mmf_step : float
        Grids of the neck in ln g and ln z.
    mmf_end : float
        The last z.
    n_gap, n_mmf : int
    neck : ndarray, shape (n_gap n_mmf, 4)
        y, dy/di, dy/dj, d2y/didj by the indices i of the gap and j of the mmf.
    drive, pull, work : ndarray, shape (n_gap, n_mmf)
        Of an isolated pair, see `coupling.isolated_pair`.
    across : ndarray, shape (n_gap, 2)
        kappa and its derivative over the index.
    """

    scale: float
    sphere_start: float
    sphere_step: float
    sphere: np.ndarray
    contrast: np.ndarray
    gap_start: float
    gap_step: float
    mmf_start: float
    mmf_step: float
    mmf_end: float
    n_gap: int
    n_mmf: int
    neck: np.ndarray
    drive: np.ndarray
    pull: np.ndarray
    work: np.ndarray
    across: np.ndarray


def _tabulate(law: Law | GrainLaw, Ms: float | None, necks: NeckEnergy | None) -> GrainLawTable:
    """Put a grain's law on the grids; ``Ms`` [A/m] None: linear, ``necks`` None: mutual dipoles only."""
    scale = np.inf if Ms is None else float(Ms)  # every field is weak to a linear one
    log_h = np.linspace(np.log(1e-6), np.log(1e3), 801)
    step = log_h[1] - log_h[0]
    H = np.exp(log_h) if Ms is None else scale * np.exp(log_h)
    M = sphere_magnetisation(law, H)
    ratio = M / H
    ratio_slope = _slopes(ratio)
    coenergy = _coenergy(H, ratio, ratio_slope, step)
    sphere = np.stack((ratio, ratio_slope, coenergy, step * (ratio - 2.0 * coenergy)), axis=1)
    contrast = _contrast(law, Ms)
    start = float(log_h[0]), float(step)
    if necks is None:
        none = np.zeros((2, 2))
        return GrainLawTable(
            scale, *start, sphere, contrast, 0.0, 1.0, 0.0, 1.0, 1.0, 2, 2, np.zeros((4, 4)), none, none, none, none
        )
    x, z = necks.log_gap, necks.log_mmf
    gap, per_index = np.exp(x), float(x[1] - x[0]) * np.exp(x)
    kappa, slope = transverse_fraction(gap)
    patch = _faded(necks.patch, fade(gap), fade_slope(gap) * per_index)
    y, rise, slope_z = patch[:, :, 0], patch[:, :, 1] / per_index[:, None], patch[:, :, 2] / (z[1] - z[0])
    pair = isolated_pull(np.exp(log_h), np.exp(log_h) * ratio, x, z, y, slope_z, rise)
    return GrainLawTable(
        scale, *start, sphere, contrast, float(x[0]), float(x[1] - x[0]), float(z[0]), float(z[1] - z[0]),
        float(np.exp(z[-1])), len(x), len(z),
        np.ascontiguousarray(patch.reshape(-1, 4)), *pair,
        np.stack((kappa, slope * per_index), axis=1),
    )  # fmt: skip


def _faded(patch: np.ndarray, faded: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Values and derivatives (g, z, 4) times a function of the gap (g,), with its derivative over the index."""
    f, f_i = faded[:, None], slope[:, None]
    y, y_i, y_j, y_ij = (patch[:, :, k] for k in range(4))
    return np.stack((f * y, f * y_i + f_i * y, f * y_j, f * y_ij + f_i * y_j), axis=-1)


def _slopes(values: np.ndarray) -> np.ndarray:
    """Derivatives over the index, of fourth order inside."""
    slope = np.gradient(values, edge_order=2)
    slope[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / 12.0
    return slope


def _contrast(law: Law | GrainLaw, Ms: float | None) -> np.ndarray:
    """Contrast, its derivative and dM/dh (CONTRASTS + 1, 3) over M; of a linear sphere those of every field.

    Along the flux density B inside the sphere, h = (2 H(B) + B/mu_0)/3 and M = 3/2 (B/mu_0 - h)
    (`field.spheres.lone_sphere`), and dM/dh = 3/2 (dB/dh/mu_0 - 1).
    """
    bulk = bulk_law(law)
    b = np.geomspace(1e-6, 1e4, 4001) * (1.0 if Ms is None else MU_0 * Ms)
    H, H_b = bulk.H_of_B(b)
    h = (2.0 * H + b / MU_0) / 3.0
    M = 1.5 * (b / MU_0 - h)
    tangent = 1.5 * (3.0 / (2.0 * MU_0 * H_b + 1.0) - 1.0)
    c = transverse_response(M / h, np.maximum(tangent, 0.0))
    table = np.zeros((CONTRASTS + 1, 3))
    if Ms is None:
        table[:, 0], table[:, 2] = c[0], tangent[0]
        return table
    rising = np.concatenate(([True], M[1:] > np.maximum.accumulate(M)[:-1])) & (M < Ms)
    even = np.linspace(0.0, 1.0, CONTRASTS + 1)
    table[:, 0] = np.interp(even, M[rising] / Ms, c[rising])
    table[:, 2] = np.interp(even, M[rising] / Ms, tangent[rising])
    table[-1, 0] = 0.0
    table[:, 1] = PchipInterpolator(np.arange(CONTRASTS + 1.0), table[:, 0])(np.arange(CONTRASTS + 1.0), 1)
    return table


def _coenergy(H: np.ndarray, ratio: np.ndarray, slope: np.ndarray, step: float) -> np.ndarray:
    """Integral of M dH from 0 over H^2, of the cubics that `sphere_ratio` reads, by four points of Gauss an interval.
    """
    points, weights = np.polynomial.legendre.leggauss(4)
    total = np.empty(len(H))
    total[0] = 0.5 * ratio[0] * H[0] ** 2
    part = np.zeros(len(H) - 1)
    for point, weight in zip(0.5 + 0.5 * points, 0.5 * weights, strict=True):
        rise = ratio[1:] - ratio[:-1]
        second, third = 3.0 * rise - 2.0 * slope[:-1] - slope[1:], slope[:-1] + slope[1:] - 2.0 * rise
        here = ratio[:-1] + point * (slope[:-1] + point * (second + point * third))
        part += weight * step * here * (H[:-1] * np.exp(point * step)) ** 2  # M dH = (M/H) H^2 dlnH
    total[1:] = total[0] + np.cumsum(part)
    return total / H**2


def grain_table(law: Law | GrainLaw, model: str) -> GrainLawTable:
    """The table that the kernels read for a grain's law: bulk law, or `GrainLaw`; with necks for near_field.

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
    try:
        Ms = saturation(law)
    except ValueError:
        if model == "near_field":
            raise
        return _tabulate(law, None, None)
    return _tabulate(law, Ms, neck_energy(law) if model == "near_field" else None)


_kept_table = lru_cache(maxsize=8)(_make_table)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _cubic(table, k, t, column):
    """Value and derivative over the index of a column of ``sphere``, between nodes k and k + 1 at t in [0, 1]."""
    a, b = table.sphere[k, column], table.sphere[k + 1, column]
    p, q = table.sphere[k, column + 1], table.sphere[k + 1, column + 1]
    rise = b - a
    second, third = 3.0 * rise - 2.0 * p - q, p + q - 2.0 * rise
    return a + t * (p + t * (second + t * third)), p + t * (2.0 * second + 3.0 * t * third)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _sphere_place(table, H):
    """Node below and remainder of a field H > 0 [A/m] on the sphere's grid; the node is the last one beyond it."""
    last = table.sphere.shape[0] - 1
    t = (np.log(H / table.scale) - table.sphere_start) / table.sphere_step
    if t <= 0.0:
        return np.int64(0), 0.0
    if not t < last:  # also of NaN, which stays one and is no index
        return np.int64(last), t - last
    k = np.int64(t)
    return k, t - k


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def sphere_ratio(table, H):
    """M/H and dM/dH of a lone sphere in H [A/m]; their limit at 0; beyond the grid M is what it was at its end."""
    if H <= 0.0:
        return table.sphere[0, RATIO], table.sphere[0, RATIO]
    k, t = _sphere_place(table, H)
    if k == table.sphere.shape[0] - 1:
        return table.sphere[k, RATIO] * np.exp(-t * table.sphere_step), 0.0
    ratio, slope = _cubic(table, k, t, RATIO)
    return ratio, ratio + slope / table.sphere_step


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def sphere_coenergy(table, H):
    """Integral of M dH from 0 to H [A^2/m^2] of a lone sphere; M constant beyond the grid."""
    if H <= 0.0:
        return 0.0
    k, t = _sphere_place(table, H)
    if k == table.sphere.shape[0] - 1:
        end = H * np.exp(-t * table.sphere_step)
        return table.sphere[k, COENERGY] * end * end + table.sphere[k, RATIO] * end * (H - end)
    value, _ = _cubic(table, k, t, COENERGY)
    return value * H * H


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def contrast_of(table, M):
    """Contrast c [-] of a grain of magnetisation M >= 0 [A/m], dc/dM [m/A] and dM/dh [-]; 0 from the saturation on."""
    u = CONTRASTS * (M / table.scale)
    if not u < CONTRASTS:  # also of NaN, which is no index
        return 0.0, 0.0, 0.0
    k = np.int64(u)
    low, high = table.contrast[k], table.contrast[k + 1]
    c, slope = cubic_between(low[0], high[0], low[1], high[1], u - k)
    tangent = low[2] + (u - k) * (high[2] - low[2])
    return c, slope * (CONTRASTS / table.scale), tangent


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def gap_place(table, gap, smallest_gap):
    """Place of a gap [radii] on the grid, not below the smallest gap or the grid; and how far the gap is below that.

    The second number is (g - g_s)/(g_s step), g not below -g_s: by it times dy/di the energy goes on below.
    """
    low = maximum(gap, smallest_gap)
    below = (maximum(gap, -smallest_gap) - low) * (1.0 / (smallest_gap * table.gap_step))
    return maximum((log(low) - table.gap_start) * (1.0 / table.gap_step), 0.0), below


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def mmf_place(table, mmf, capacity, radius):
    """Place of z on the grid of an mmf [A], a capacity [-] and a radius [m]; and the last z over z, 1 within the grid.

    Scalars or SIMD vectors.
    """
    z = maximum(abs(mmf), SMALLEST_MMF) / (maximum(capacity, SMALLEST_CAPACITY) * radius * table.scale)
    last = table.n_mmf - 1.0
    place = maximum((log(z) - table.mmf_start) * (1.0 / table.mmf_step), 0.0)
    beyond = place > last
    return select(beyond, last, place), select(beyond, table.mmf_end / z, 1.0)


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _hermite(x):
    """Hermite's cubics at x in [0, 1], of both values and both slopes, and their derivatives."""
    x2, left = x * x, 1.0 - x
    h1, d1 = x2 * (3.0 - 2.0 * x), 6.0 * x * left
    return 1.0 - h1, h1, x * left * left, -x2 * left, -d1, d1, left * (1.0 - 3.0 * x), x * (3.0 * x - 2.0)


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def cubic_between(low, high, slope, slope_high, x):
    """Hermite's cubic between two values with slopes at x in [0, 1], and its derivative."""
    h0, h1, g0, g1, d0, d1, e0, e1 = _hermite(x)
    return h0 * low + h1 * high + g0 * slope + g1 * slope_high, d0 * low + d1 * high + e0 * slope + e1 * slope_high


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _between_gaps(low, high, x, below):
    """Of two nodes in a column, each (y, dy/di, dy/dj, d2y/didj): y and dy/dj at x, and both derivatives over i.

    y and dy/dj are continued along their tangent by ``below`` steps.
    """
    h0, h1, g0, g1, d0, d1, e0, e1 = _hermite(x)
    y_i = d0 * low[0] + d1 * high[0] + e0 * low[1] + e1 * high[1]
    y_ij = d0 * low[2] + d1 * high[2] + e0 * low[3] + e1 * high[3]
    y = h0 * low[0] + h1 * high[0] + g0 * low[1] + g1 * high[1] + below * y_i
    y_j = h0 * low[2] + h1 * high[2] + g0 * low[3] + g1 * high[3] + below * y_ij
    return y, y_j, y_i, y_ij


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _between_mmfs(table, low, high, t, fraction, within):
    """y, dy/dln z, d2y/d(ln z)2 and dy/di of what `_between_gaps` gives at two columns, at t between them.

    ``fraction``: the last z over z beyond the grid, 1.0 within it; ``within``: 0.0 from the farthest gap on.
    """
    h0, h1, g0, g1, d0, d1, e0, e1 = _hermite(t)
    per_step = 1.0 / table.mmf_step
    y = h0 * low[0] + h1 * high[0] + g0 * low[1] + g1 * high[1]
    y_i = h0 * low[2] + h1 * high[2] + g0 * low[3] + g1 * high[3]
    first = (d0 * low[0] + d1 * high[0] + e0 * low[1] + e1 * high[1]) * per_step
    c = 6.0 - 12.0 * t
    second = (c * (high[0] - low[0]) + (6.0 * t - 4.0) * low[1] + (6.0 * t - 2.0) * high[1]) * (per_step * per_step)
    beyond = fraction < 1.0
    y, y_i = within * fraction * y, within * fraction * y_i
    return y, select(beyond, -y, within * first), select(beyond, y, within * second), y_i


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def neck_simd(table, x, below, place, fraction):
    """y, its first and second derivative over ln z, and dy/di, of eight necks at their `gap_place` and `mmf_place`."""
    last_row, last_column = table.n_gap - 2.0, table.n_mmf - 2.0
    row = from_integers(to_integers(select(x < last_row, x, last_row)))
    column = from_integers(to_integers(select(place < last_column, place, last_column)))
    at = row * float(table.n_mmf) + column
    here, above = to_integers(at), to_integers(at + float(table.n_mmf))
    after, beyond = to_integers(at + 1.0), to_integers(at + (table.n_mmf + 1.0))
    x, t, within = x - row, place - column, select(x < last_row + 1.0, 1.0, 0.0)
    x = select(x < 1.0, x, 1.0)
    neck = table.neck
    low = _between_gaps(gather_columns(neck, here, 0), gather_columns(neck, above, 0), x, below)
    high = _between_gaps(gather_columns(neck, after, 0), gather_columns(neck, beyond, 0), x, below)
    return _between_mmfs(table, low, high, t, fraction, within)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _node(table, i, j):
    k = i * table.n_mmf + j
    return table.neck[k, 0], table.neck[k, 1], table.neck[k, 2], table.neck[k, 3]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def neck_scalar(table, x, below, place, fraction):
    """As `neck_simd`, of one neck."""
    if not x < table.n_gap - 1.0:  # also of NaN, which is no index
        return 0.0 * x, 0.0 * x, 0.0 * x, 0.0 * x
    if not place >= 0.0:
        return place, place, place, place
    i, j = np.int64(x), min(np.int64(place), np.int64(table.n_mmf - 2))
    x, t = x - i, place - j
    low = _between_gaps(_node(table, i, j), _node(table, i + 1, j), x, below)
    high = _between_gaps(_node(table, i, j + 1), _node(table, i + 1, j + 1), x, below)
    return _between_mmfs(table, low, high, t, fraction, 1.0)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def bilinear(values, i, x, j, y):
    """Interpolate a table between nodes i, i + 1 and j, j + 1."""
    low = values[i, j] + y * (values[i, j + 1] - values[i, j])
    high = values[i + 1, j] + y * (values[i + 1, j + 1] - values[i + 1, j])
    return low + x * (high - low)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def mean_neck_pull(table, gap, end, smallest_gap, place, fraction):
    """Mean of the pull D^2 dy/dg over a step that takes the gap to ``end`` [radii], over D^2 at its start.

    The drive is constant meanwhile (`coupling.isolated_pair`).
    """
    x, below = gap_place(table, gap, smallest_gap)
    rise = neck_scalar(table, x, below, place, fraction)[3] / (table.gap_step * max(gap, smallest_gap))
    way = max(end, -smallest_gap) - max(gap, -smallest_gap)
    if not (abs(way) > 1e-6 * max(gap, smallest_gap) and rise > 0.0):  # also of NaN, which is no index
        return rise
    column = drive_column(table, x, place)
    before, pull = work_and_pull(table, gap, smallest_gap, column)
    after, _ = work_and_pull(table, end, smallest_gap, column)
    return rise * (after - before) / (way * pull) if pull > 0.0 else 0.0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def drive_column(table, x, place):
    """Column of ``pull`` for a neck at the place of its gap and of its mmf."""
    place = place if place >= 0.0 else 0.0  # NaN is no index
    i, j = min(np.int64(x), table.n_gap - 2), min(np.int64(place), table.n_mmf - 2)
    return min(max(bilinear(table.drive, i, x - i, j, place - j), 0.0), table.n_mmf - 1.0)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def work_and_pull(table, gap, smallest_gap, column):
    """Work and pull of an isolated pair, see `coupling.isolated_pair`, at a gap [radii]."""
    x, _ = gap_place(table, gap, smallest_gap)
    last = table.n_gap - 1
    j = min(np.int64(column), table.n_mmf - 2)
    y = column - j
    if not x < last:
        return table.work[last, j] + y * (table.work[last, j + 1] - table.work[last, j]), 0.0
    i = np.int64(x)
    work, low, high = (
        table.work[i, j] + y * (table.work[i, j + 1] - table.work[i, j]),
        table.pull[i, j] + y * (table.pull[i, j + 1] - table.pull[i, j]),
        table.pull[i + 1, j] + y * (table.pull[i + 1, j + 1] - table.pull[i + 1, j]),
    )
    t = (x - i) * table.gap_step
    pull = low + (x - i) * (high - low)
    rise, factor = (high - low) / table.gap_step, np.exp(t)
    work += np.exp(table.gap_start + i * table.gap_step) * (low * (factor - 1.0) + rise * (factor * (t - 1.0) + 1.0))
    return work + pull * (max(gap, -smallest_gap) - max(gap, smallest_gap)), pull
