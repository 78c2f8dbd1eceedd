"""Band of the brake's predicted torque, from runs over the joint range of friction, fill and grain size.

    python tests/benchmarks/brake_band.py POINTS.csv docs/brake_band.png [--fill LOW HIGH] [--size A LOW HIGH P] ...

POINTS.csv has a run of cases/powder_clutch.toml a line, with the columns friction, rolling_friction, fill (mass of the
powder or its solid fraction), across (grains per gap), current [A], torque, standard_error [N m]; others are for
readers (strain averaged, inertial_number, grains). Lines that begin with # are comments. It prints the surface, the
band at each current, and one sentence; it draws the band and writes it next to the picture as CSV, which
`emclutch plot --torque-current --band` takes.

1. Torques are brought to the size of the real grains by the law of emclutch/device_model/grain_size.py.
2. A response surface is fitted to ln T by least squares (R. H. Myers, D. C. Montgomery, C. M. Anderson-Cook, Response
   Surface Methodology, 4th ed. 2016): of friction, rolling friction, the bulk friction that both give, ln fill, ln
   current and what is left of the grain size, with squares and products. Terms enter one by one, that which makes the
   error of prediction by leaving one out (PRESS) smallest, while this falls by a tenth or more.
3. Its inputs are drawn: the angle of repose uniform in its range, sliding friction uniform on the line of pairs that
   give it (particles/bulk_friction), which says the rolling friction; fill uniform in its range; the coefficient of
   the grain size and the surface normal with their errors. 5, 50 and 95 % of T are low, middle and high.
4. First-order Sobol' indices of T say which share of its variance each input makes (A. Saltelli et al., Comput. Phys.
   Commun. 181 (2010) 259; scipy.stats.sobol_indices).

Between and beyond the currents of the points the band is the torque curve of the table of record, scaled to each
percentile by what lies between, linearly in ln I.
"""

from __future__ import annotations

import argparse
import csv
import io
import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dry_brakes import RATED, recorded_curves
from scipy.special import ndtri
from scipy.stats import sobol_indices, uniform

from emclutch.device_model.grain_size import COEFFICIENT, EXPONENT
from emclutch.results.fits import NORMAL
from emclutch.results.pictures import torque_against_current_picture
from emclutch.results.torque_curves import TorqueCurve
from particles.bulk_friction.friction_table import FrictionTable, measured_table

PERCENTILES = 5.0, 50.0, 95.0
GAIN = 0.10  # of the error of prediction, for which a term is taken
SAMPLES = 2**13  # of each of the matrices of Saltelli's scheme
NUMBERS = ("friction", "rolling_friction", "fill", "across", "current", "torque", "standard_error")
INPUTS = ("angle of repose", "place on its line of friction", "fill", "size of the grains", "response surface")
VARIABLES = ("friction", "rolling friction", "bulk friction", "ln fill", "size left", "ln current")


@dataclass(frozen=True, slots=True)
class Ranges:
    """What is known of the inputs.

    Attributes
    ----------
    repose : range of the angle of repose [deg].
    friction : range of the sliding friction.
    fill : its range, in the unit of the points.
    across : real grains per gap.
    coefficient, exponent : a with the ends of its 95 % interval, and p, of T(n) = T_inf (1 + a/n^p).
    """

    fill: tuple[float, float]
    repose: tuple[float, float] = (28.0, 38.0)
    friction: tuple[float, float] = (0.3, 0.8)
    across: float = 50.0 / 3.0
    coefficient: tuple[float, float, float] = COEFFICIENT
    exponent: float = EXPONENT

    def size_factor(self, across: np.ndarray | float, a: np.ndarray | float) -> np.ndarray:
        """Return ln of the torque of the real grains over that of others."""
        return np.log1p(a * self.across**-self.exponent) - np.log1p(a * np.asarray(across) ** -self.exponent)


class FrictionLines:
    """Pairs of the measured table of bulk friction: rolling friction against bulk friction and sliding friction."""

    def __init__(self, table: FrictionTable, friction: tuple[float, float], count: int = 401) -> None:
        self.friction = np.linspace(*friction, count)
        self.rolling = np.linspace(0.0, table.rolling[-1], 801)
        self.bulk = np.maximum.accumulate(table.on_grid(self.friction, self.rolling), axis=1)

    def highest(self) -> float:
        """Return the largest bulk friction that a pair gives."""
        return float(self.bulk[:, -1].max())

    def pairs(self, bulk: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return sliding and rolling friction, each (n,), for a place from 0 to 1 along the line of a bulk friction."""
        given = (self.bulk[:, 0] <= bulk[:, None]) & (bulk[:, None] <= self.bulk[:, -1])
        first, last = given.argmax(axis=1), given.shape[1] - 1 - given[:, ::-1].argmax(axis=1)
        number = np.rint(first + place * (last - first)).astype(int)
        rolling = np.empty_like(bulk)
        for one in np.unique(number):
            rolling[number == one] = np.interp(bulk[number == one], self.bulk[one], self.rolling)
        return self.friction[number], rolling


@dataclass(frozen=True, slots=True)
class Surface:
    """Response surface of ln T at the size of the real grains.

    Attributes
    ----------
    terms : each a tuple of numbers of VARIABLES that are multiplied; the empty one is the constant.
    centre : (6,) what each variable is counted from.
    coefficients, covariance : (k,) and (k, k).
    left_out : RMS of ln T by leaving one out.
    noise : RMS of the relative standard errors of the points.
    lowest, highest : (6,) of the points' variables.
    """

    terms: tuple[tuple[int, ...], ...]
    centre: np.ndarray
    coefficients: np.ndarray
    covariance: np.ndarray
    left_out: float
    noise: float
    lowest: np.ndarray
    highest: np.ndarray

    def log_torque(self, variables: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ln T and its standard error, each (n,), at variables (n, 6)."""
        matrix = columns(variables - self.centre, self.terms)
        return matrix @ self.coefficients, np.sqrt(np.einsum("ij,jk,ik->i", matrix, self.covariance, matrix))

    def in_words(self) -> str:
        """Return terms and errors."""
        names = [" x ".join(VARIABLES[one] for one in term) or "constant" for term in self.terms]
        errors = np.sqrt(np.diag(self.covariance))
        lines = [
            f"  {name}: {value:.3g} +- {error:.2g}"
            for name, value, error in zip(names, self.coefficients, errors, strict=True)
        ]
        error = f"error by leaving one out {100.0 * self.left_out:.2g} %, noise {100.0 * self.noise:.2g} %"
        return "\n".join([f"ln T of the real grains, {error}:", *lines])


def read_points(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of the points."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    if not rows or (missing := set(NUMBERS) - set(rows[0])):
        raise SystemExit(f"{path} lacks the columns {', '.join(sorted(missing)) if rows else ', '.join(NUMBERS)}")
    return {name: np.array([float(row[name]) for row in rows]) for name in NUMBERS}


def variables_of(points: dict[str, np.ndarray], ranges: Ranges, bulk: np.ndarray | None = None) -> np.ndarray:
    """Return the surface's variables (n, 6) of points; `bulk` friction where it is known."""
    if bulk is None:
        table = measured_table()
        pairs = zip(points["friction"], points["rolling_friction"], strict=True)
        bulk = np.array([table.bulk_friction(friction, rolling)[0] for friction, rolling in pairs])
    size = points["across"] ** -ranges.exponent - ranges.across**-ranges.exponent
    return np.column_stack(
        [points["friction"], points["rolling_friction"], bulk, np.log(points["fill"]), size,
         np.log(points["current"] / RATED)]
    )  # fmt: skip


def columns(variables: np.ndarray, terms: tuple[tuple[int, ...], ...]) -> np.ndarray:
    """Return the matrix of terms (n, k) at variables (n, 6)."""
    return np.column_stack([np.prod(variables[:, list(term)], axis=1) for term in terms])


def fit_surface(points: dict[str, np.ndarray], ranges: Ranges) -> Surface:
    """Return the surface through points; its terms are chosen by the error of prediction."""
    variables = variables_of(points, ranges)
    y = np.log(points["torque"]) + ranges.size_factor(points["across"], ranges.coefficient[0])
    centre = variables.mean(axis=0)
    centre[-2:] = 0.0  # size of the real grains, rated current
    varied = [one for one in range(len(VARIABLES)) if np.ptp(variables[:, one]) > 1e-9]
    terms: tuple[tuple[int, ...], ...] = ((),)
    error = left_out(columns(variables - centre, terms), y)
    while len(terms) < len(y) // 2:
        mains = [(one,) for one in varied]
        known = [term[0] for term in terms if len(term) == 1]
        products = itertools.combinations_with_replacement(sorted(known), 2)
        more = [term for term in (*mains, *products) if term not in terms]
        tried = [(left_out(columns(variables - centre, (*terms, term)), y), term) for term in more]
        if not tried or min(tried)[0] > (1.0 - GAIN) * error:
            break
        error, term = min(tried)
        terms = (*terms, term)
    matrix = columns(variables - centre, terms)
    coefficients, *_ = np.linalg.lstsq(matrix, y, rcond=None)
    spread = float(np.sum((y - matrix @ coefficients) ** 2)) / max(1, len(y) - len(terms))
    noise = float(np.sqrt(np.mean((points["standard_error"] / points["torque"]) ** 2)))
    return Surface(terms, centre, coefficients, spread * np.linalg.pinv(matrix.T @ matrix), error, noise,
                   variables.min(axis=0), variables.max(axis=0))  # fmt: skip


def left_out(matrix: np.ndarray, y: np.ndarray) -> float:
    """Return the RMS error of each point by the fit through the others (PRESS); infinite where one is needed by it."""
    if matrix.shape[0] <= matrix.shape[1] or np.linalg.matrix_rank(matrix) < matrix.shape[1]:
        return math.inf
    q, _ = np.linalg.qr(matrix)
    leverage = np.sum(q**2, axis=1)
    if leverage.max() > 1.0 - 1e-9:
        return math.inf
    return float(np.sqrt(np.mean(((y - q @ (q.T @ y)) / (1.0 - leverage)) ** 2)))


@dataclass(frozen=True, slots=True)
class Prediction:
    """Torque as a function of the inputs, each by its uniform quantile."""

    surface: Surface
    ranges: Ranges
    lines: FrictionLines
    current: float
    across: np.ndarray  # of the points

    def inputs(self, u: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Return the points' columns and the bulk friction of quantiles u (5, n)."""
        low, high = (math.sin(math.radians(angle)) for angle in self.ranges.repose)
        top = math.degrees(math.asin(min(high, self.lines.highest())))
        angle = self.ranges.repose[0] + u[0] * (top - self.ranges.repose[0])
        bulk = np.clip(np.sin(np.radians(angle)), low, self.lines.highest())
        friction, rolling = self.lines.pairs(bulk, u[1])
        fill = self.ranges.fill[0] + u[2] * (self.ranges.fill[1] - self.ranges.fill[0])
        same = np.ones_like(fill)
        return {"friction": friction, "rolling_friction": rolling, "fill": fill, "across": self.ranges.across * same,
                "current": self.current * same}, bulk  # fmt: skip

    def torque(self, u: np.ndarray) -> np.ndarray:
        """Return torques (n,) [N m] of quantiles u (5, n)."""
        points, bulk = self.inputs(u)
        log_torque, error = self.surface.log_torque(variables_of(points, self.ranges, bulk))
        a, low, high = self.ranges.coefficient
        drawn = np.maximum(a + (high - low) / (2.0 * NORMAL) * ndtri(u[3]), 0.0)
        shift = [np.mean(self.ranges.size_factor(self.across[:, None], one), axis=0) for one in (drawn, np.array([a]))]
        return np.exp(log_torque + error * ndtri(u[4]) + shift[0] - shift[1])

    def band(self) -> np.ndarray:
        """Return low, middle and high torque [N m]."""
        return np.percentile(self.torque(quantiles()), PERCENTILES)

    def shares(self) -> np.ndarray:
        """Return the first-order Sobol' index of each input."""
        dists = [uniform(1e-9, 1.0 - 2e-9)] * len(INPUTS)
        found = sobol_indices(func=self.torque, n=SAMPLES, dists=dists, rng=np.random.default_rng(1))
        return np.asarray(found.first_order).reshape(-1)

    def outside(self) -> list[str]:
        """Return what part of the draws lies beyond the points, a line for each variable of the surface."""
        points, bulk = self.inputs(quantiles())
        variables = variables_of(points, self.ranges, bulk)
        used = sorted({one for term in self.surface.terms for one in term})
        found = []
        for one in used:
            low, high = self.surface.lowest[one], self.surface.highest[one]
            margin = 0.02 * (high - low)
            share = float(np.mean((variables[:, one] < low - margin) | (variables[:, one] > high + margin)))
            if share > 0.0 and VARIABLES[one] != "size left":
                beyond = f"{VARIABLES[one]} beyond {low:.3g} to {high:.3g} of the points"
                found.append(f"{100.0 * share:.2g} % of the draws have a {beyond}")
        return found


def quantiles() -> np.ndarray:
    """Return quantiles of the inputs (5, n), strictly between 0 and 1."""
    return np.random.default_rng(2).uniform(1e-9, 1.0, (len(INPUTS), 4 * SAMPLES))


def band_over_current(bands: dict[float, np.ndarray], curve: TorqueCurve) -> np.ndarray:
    """Return current, low, middle and high (n, 4): a torque curve scaled to the bands at some currents.

    Parameters
    ----------
    bands : current [A] -> low, middle, high [N m].
    curve : over the current [A]; only its shape counts.
    """
    known = np.array(sorted(bands))
    current = np.unique([*curve.x[curve.x > 0.0], *known])
    shape = np.exp(np.interp(np.log(current), np.log(curve.x[curve.x > 0.0]), np.log(curve.torque[curve.x > 0.0])))
    of_known = np.interp(known, current, shape)
    scale = np.array([bands[one] for one in known]) / of_known[:, None]
    between = [np.interp(np.log(current), np.log(known), np.log(one)) for one in scale.T]
    return np.column_stack([current, shape[:, None] * np.exp(between).T])


def sentence(band: np.ndarray, shares: np.ndarray, current: float) -> str:
    """Return what is predicted, and what decides it: all inputs that make a twentieth of the variance or more."""
    order = [one for one in np.argsort(-shares) if shares[one] >= 0.05]
    of = [" of the variance", *[""] * len(order)]
    decides = ", ".join(f"{INPUTS[n]} ({100.0 * shares[n]:.0f} %{text})" for n, text in zip(order, of, strict=False))
    low, middle, high = band
    return f"the torque at {current:g} A is {middle:.3g} N m, between {low:.3g} and {high:.3g}; what decides: {decides}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("points", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--fill", type=float, nargs=2, help="range of the fill; default: that of the points")
    parser.add_argument("--repose", type=float, nargs=2, default=(28.0, 38.0), help="range of the angle [deg]")
    parser.add_argument("--friction", type=float, nargs=2, default=(0.3, 0.8), help="range of sliding friction")
    parser.add_argument("--across", type=float, default=50.0 / 3.0, help="real grains per gap")
    parser.add_argument("--size", type=float, nargs=4, default=(*COEFFICIENT, EXPONENT), help="a, its interval, and p")
    given = parser.parse_args()
    points = read_points(given.points)
    fill = tuple(given.fill or (points["fill"].min(), points["fill"].max()))
    *coefficient, exponent = given.size
    ranges = Ranges(fill, tuple(given.repose), tuple(given.friction), given.across, tuple(coefficient), exponent)
    surface, lines = fit_surface(points, ranges), FrictionLines(measured_table(), ranges.friction)
    print(surface.in_words())
    top = math.degrees(math.asin(lines.highest()))
    if top < ranges.repose[1]:
        print(f"no pair gives an angle of repose above {top:.1f} degrees: drawn from {ranges.repose[0]:g} to there")
    bands, said = {}, {}
    for current in np.unique(points["current"]):
        predicted = Prediction(surface, ranges, lines, float(current), points["across"])
        bands[float(current)], shares = predicted.band(), predicted.shares()
        said[float(current)] = sentence(bands[float(current)], shares, float(current))
        print(said[float(current)])
        print("  first order: " + ", ".join(f"{n} {s:.2f}" for n, s in zip(INPUTS, shares, strict=True)))
        print("".join(f"  {line}\n" for line in predicted.outside()), end="")
    curve = max(recorded_curves(), key=lambda one: len(one.x))
    band = band_over_current(bands, curve)
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows(
        [("current [A]", "low [N m]", "middle [N m]", "high [N m]"), *([f"{one:.4g}" for one in row] for row in band)]
    )
    given.picture.with_suffix(".csv").write_text(table.getvalue(), encoding="utf-8")
    nearest = min(said, key=lambda one: abs(one - RATED))
    rated = {"rating of brakes of this class": np.array([[RATED, 12.0]])}
    torque_against_current_picture(
        given.picture, recorded_curves(), measured=rated, band=band,
        title=f"cases/powder_clutch.toml, 5 to 95 % of what is predicted: {said[nearest]}",
    )  # fmt: skip


if __name__ == "__main__":
    main()
