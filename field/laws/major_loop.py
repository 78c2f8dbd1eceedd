"""Pinned cells and magnetisation curve of a steel from its measured major loop.

The falling branch from B_m of the law of `field.laws.pinning` is, with the anhysteretic curve a(B) = H_0(B) - P(B),

    H(B) = a(B) + P(B_m) - 2 P((B_m - B)/2),      -B_m <= B <= B_m,      a odd,

and the rising one is the same with both signs changed. With a piecewise linear on points of B, and P the sum of cells
K_k min(B, r_k) with reaches at the same points up to B_m/2, H is linear in the slopes of a and in the stiffnesses K_k,
none of which may be negative: least squares with bounds (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems,
1974) have one optimum. Errors of H count over H_c + |H|, points evenly in B, coercivity and remanence ten times as much
as a branch. Slopes of a are at least a ninth of those of P, so that every step of the law stays convex. The curve of
first magnetisation is a + P: that of this law, and not a measured one.

What the law cannot have: loops that are wider at the remanence than at B = 0, as those of many electrical steels; the
width of its loops falls from B = 0 on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import PchipInterpolator, PPoly
from scipy.optimize import nnls

from field.laws.h_spline import HSpline, SplineLaw
from field.laws.pinning import Pinning
from field.laws.reluctivity import NU_0

_NODES = 60  # of curve and cells between 0 and B_m, denser towards 0
_SAMPLES = 801  # of each branch, evenly in B
_EMPHASIS = 10.0 * _SAMPLES**0.5  # of coercivity and remanence over a sample
_FLATTEST = 1e-6 * NU_0  # slope of the anhysteretic curve, at least
_SHARE = 1.0 / 9.0  # and over that of P
_MIN_POINTS = 6  # of a branch


@dataclass(frozen=True, slots=True)
class LoopNumbers:
    """Characteristics of a major loop.

    Attributes
    ----------
    coercivity : float
        Half the width at B = 0 [A/m].
    remanence : float
        B at H = 0 on the falling branch [T].
    loss : float
        Area of the loop [J/m^3].
    """

    coercivity: float
    remanence: float
    loss: float


@dataclass(frozen=True, slots=True, eq=False)
class MajorLoopLaw(SplineLaw):
    """Steel whose hysteresis is fitted to a measured major loop; as a law, its curve of first magnetisation.

    Parameters
    ----------
    H : ndarray (n,)
        Field strength [A/m] along the falling branch from the largest value to the smallest, or along the falling and
        then the rising branch of a closed loop.
    B : ndarray (n,)
        Flux density [T].
    name, source : str
        For messages and tables.

    Attributes
    ----------
    curve : HSpline
        Of first magnetisation; beyond the largest measured B with the slope of vacuum.
    pinning : Pinning
        The cells.
    measured, fitted : LoopNumbers
        Of the table and of the law.
    misfit : float
        Root mean square of the errors of H, over the coercivity, between both knees (|H| below five coercivities).

    Raises
    ------
    ValueError
        Fewer than six points of a branch, one along which H or B do not fall or rise, or one that does not pass both
        B = 0 and H = 0 in the second quadrant; a loop whose ends differ in size by more than a tenth.
    """

    H: np.ndarray
    B: np.ndarray
    name: str = "loop"
    source: str = "a loop of the user"
    curve: HSpline = field(init=False, repr=False)
    pinning: Pinning = field(init=False, repr=False)
    measured: LoopNumbers = field(init=False)
    fitted: LoopNumbers = field(init=False)
    misfit: float = field(init=False)

    def __post_init__(self) -> None:
        branches = _falling_branches(np.asarray(self.H, dtype=float), np.asarray(self.B, dtype=float), self.name)
        B_m = min(float(min(B[0], -B[-1])) for _, B in branches)
        at = np.linspace(-B_m, B_m, _SAMPLES)
        H = np.mean([np.interp(at, B[::-1], H[::-1]) for H, B in branches], axis=0)
        measured = _numbers(at, H)
        nodes = B_m * (np.arange(_NODES + 1) / _NODES) ** 1.5
        slopes, stiffness = _fitted(at, H, measured, nodes)
        cells = stiffness > 1e-9 * stiffness.max(initial=0.0)
        pinning = Pinning(stiffness[cells], nodes[1:][cells])
        curve = _curve(nodes, slopes, pinning)
        law = _branch(at, curve, pinning, B_m)
        near = np.abs(H) < 5.0 * measured.coercivity
        for name, value in (
            ("curve", curve),
            ("pinning", pinning),
            ("measured", measured),
            ("fitted", _numbers(at, law)),
            ("misfit", float(np.sqrt(np.mean((law - H)[near] ** 2)) / measured.coercivity)),
        ):
            object.__setattr__(self, name, value)

    def in_words(self) -> str:
        """Coercivity, remanence and loss of the fit against those of the table."""
        table, law = self.measured, self.fitted
        return (
            f"fitted to the loop: coercivity {law.coercivity:.4g} A/m (table {table.coercivity:.4g}), remanence "
            f"{law.remanence:.3g} T (table {table.remanence:.3g}), loss {law.loss:.4g} J/m^3 a cycle (table "
            f"{table.loss:.4g}); H is off by {100.0 * self.misfit:.2g} % of the coercivity (root mean square)"
        )


def _falling_branches(H: np.ndarray, B: np.ndarray, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """The falling branch, and the rising one with both signs changed; H and B fall along each."""
    if H.ndim != 1 or H.shape != B.shape or not (np.isfinite(H).all() and np.isfinite(B).all()):
        raise ValueError(f"the loop of {name!r} must have one finite B [T] for each H [A/m]")
    turn = int(np.argmin(H)) if H.size else 0
    parts = [(H[: turn + 1], B[: turn + 1]), (-H[turn:], -B[turn:])]
    branches = []
    for number, (h, b) in enumerate(parts):
        which = "rising" if number else "falling"
        if number and h.size == 1:
            continue
        if h.size < _MIN_POINTS:
            raise ValueError(
                f"the {which} branch of {name!r} has {h.size} points; at least {_MIN_POINTS}, better 40, from the "
                "largest H to the smallest (and back)"
            )
        for values, symbol, unit in ((h, "H", "A/m"), (b, "B", "T")):
            if np.any(np.diff(values) >= 0.0):
                i = int(np.argmax(np.diff(values) >= 0.0))
                sign = -1.0 if number else 1.0
                raise ValueError(
                    f"along the {which} branch of {name!r} {symbol} goes from {sign * values[i]:g} to "
                    f"{sign * values[i + 1]:g} {unit} (its points {i + 1} and {i + 2}); the rows follow the loop, from "
                    "the largest H down to the smallest and, if both branches are given, back up"
                )
        if not (b[0] > 0.0 > b[-1] and h[0] > 0.0 > h[-1]) or np.interp(0.0, b[::-1], h[::-1]) >= 0.0:
            raise ValueError(
                f"the {which} branch of {name!r} is none of a loop: falling, B must pass 0 at an H below 0, rising at "
                "one above; give the whole branch between both ends"
            )
        if not 0.9 < -b[-1] / b[0] < 1.1:
            raise ValueError(
                f"the {which} branch of {name!r} goes from B = {b[0]:g} to {b[-1]:g} T; a major loop is symmetric: its "
                "ends may differ by a tenth"
            )
        branches.append((h, b))
    return branches


def _fitted(
    at: np.ndarray, H: np.ndarray, measured: LoopNumbers, nodes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of a between the nodes (n,) and stiffnesses of cells that reach to nodes[1:] (n,), [m/H]."""
    B_m, reach = nodes[-1], nodes[1:][nodes[1:] <= 0.5 * nodes[-1]]

    def rows(B: np.ndarray) -> np.ndarray:
        size, sign = np.abs(B)[:, None], np.sign(B)[:, None]
        of_curve = sign * np.clip(size - nodes[:-1], 0.0, np.diff(nodes))
        of_cells = reach - 2.0 * np.minimum(0.5 * (B_m - B)[:, None], reach)
        return np.hstack((of_curve, of_cells + _SHARE * sign * np.minimum(size, reach)))

    key = np.array([0.0, measured.remanence])
    matrix, right = np.vstack((rows(at), rows(key))), np.append(H, [-measured.coercivity, 0.0])
    right = right - _FLATTEST * np.append(at, key)
    weight = 1.0 / (measured.coercivity + np.abs(np.append(H, [0.0, 0.0])))
    weight[-2:] *= _EMPHASIS
    unknowns, _ = nnls(weight[:, None] * matrix, weight * right)
    slopes, stiffness = unknowns[: nodes.size - 1], np.zeros(nodes.size - 1)
    stiffness[: reach.size] = unknowns[nodes.size - 1 :]
    of_P = np.cumsum(stiffness[::-1])[::-1]  # slope of P between the nodes
    return _FLATTEST + slopes + _SHARE * of_P, stiffness


def _curve(nodes: np.ndarray, slopes: np.ndarray, pinning: Pinning) -> HSpline:
    """H_0 = a + P: a monotone cubic through its nodes, and the cells' sum as it is."""
    a = PchipInterpolator(nodes, np.append(0.0, np.cumsum(slopes * np.diff(nodes))))
    P = (pinning.stiffness * np.minimum(nodes[:, None], pinning.reach)).sum(axis=1)
    coefficients = a.c.copy()
    # PCHIP may begin flat: mu_r would be infinite; the cubic keeps value and slope at its end, and rises throughout
    steeper, first = max(0.0, 0.1 * slopes[0] - coefficients[2, 0]), nodes[1] - nodes[0]
    coefficients[:3, 0] += steeper * np.array([1.0 / first**2, -2.0 / first, 1.0])
    coefficients[2] += np.diff(P) / np.diff(nodes)
    coefficients[3] += P[:-1]
    return HSpline.through(PPoly(coefficients, nodes))


def _branch(at: np.ndarray, curve: HSpline, pinning: Pinning, B_m: float) -> np.ndarray:
    """H [A/m] of the law on its falling branch from B_m, at `at` (n,) [T]."""

    def P(B: np.ndarray) -> np.ndarray:
        return np.asarray((pinning.stiffness * np.minimum(np.abs(B)[..., None], pinning.reach)).sum(axis=-1))

    H_0 = curve.H_of_B(np.abs(at))[0]
    return np.sign(at) * (H_0 - P(at)) + P(np.array(B_m)) - 2.0 * P(0.5 * (B_m - at))


def _numbers(at: np.ndarray, H: np.ndarray) -> LoopNumbers:
    """Of a falling branch H (n,) at growing B (n,)."""
    rising = -H[::-1]
    return LoopNumbers(
        float(-np.interp(0.0, at, H)), float(np.interp(0.0, H, at)), float(np.trapezoid(rising - H, at))
    )
