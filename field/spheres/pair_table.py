"""Force and moment of two equal magnetised spheres over gap and field.

Two spheres of radius a on the axis of a uniform field h attract each other with F_2(g, h) and have the mean
magnetisation M_2(g, h); lengths in a, F in mu_0 Ms^2 a^2, M and h in Ms.  A table of both is made by finite elements
(`pair_solver`) for one law and serves every radius; scaled by Ms, every law of the same shape.  Between its nodes

    log(F_2/h^2) and log(M_2/h) are cubic splines of log g and log h,

within 0.1 % of a direct solve for iron (27 gaps, 81 fields; straight lines between the nodes would be off by 1.5 %,
and by 6 % with half as many).
Below the lowest field F goes as h^2 and M as h; beyond the highest both go to their saturated values,
F -> (pi/6) (2/R)^4 and M -> 1 with R = 2 + g, like 1/h, as Froehlich's law does.  Below the smallest gap the gap is
held; beyond the largest two dipoles that magnetise each other stand for the spheres.

What spheres have beyond dipoles (`neck_energy`) goes smoothly (a cubic, C1) to zero between g = 1 and g = 1.2.

Tables ship for Froehlich's law at several susceptibilities; `python -m field.spheres.pair_table` makes them again.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

from field.laws.froehlich import FroehlichLaw
from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import Law
from field.spheres.lone_sphere import bulk_law, saturation, sphere_magnetisation
from field.spheres.table_files import SHIPPED, cache_folder, law_digest, read_table, write_table

GAPS = np.geomspace(3e-4, 1.2, 27)
"""Gaps of a table [radii]."""
FIELDS = np.geomspace(3e-4, 3.0, 81)
"""Fields of a table [Ms]."""
RESOLUTION = 1.25
"""Of the meshes: forces within 2e-4 of those on the finest."""

FADE_FROM, FADE_TO = 1.0, 1.2
"""Gaps between which the excess goes to zero [radii]."""

_SHIPPED_NAME = "froehlich_{:g}.npz"
# A cubic through four of them in chi^(-1/4) is within 0.7 % of force and 0.05 % of moment for every chi between
# (the worst is 14, with 0.1 % from 240 on; measured at 15 susceptibilities, 6 gaps and 28 fields).
_SHIPPED_CHI = (10.0, 20.0, 50.0, 100.0, 300.0, 999.0, 5000.0)
_CHI_POWER = -0.25
_SAME_CHI = 1e-9


@dataclass(frozen=True, eq=False)
class PairTable:
    """Force and moment of a pair of spheres of one law.

    Parameters
    ----------
    gap : ndarray (ng,)
        [radii], in geometric steps.
    field : ndarray (nh,)
        Uniform field without the spheres [Ms], in geometric steps.
    force : ndarray (ng, nh)
        On one sphere, attraction > 0 [mu_0 Ms^2 a^2].
    moment : ndarray (ng, nh)
        Mean magnetisation of a sphere [Ms].
    law : Law
        Bulk law of the spheres.
    source, digest : str
        Where the numbers come from; the hash of law, grid and generator.

    Raises
    ------
    ValueError
        Shapes that do not fit, values that are not finite and above 0, steps that are not geometric.
    """

    gap: np.ndarray
    field: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    law: Law
    source: str = ""
    digest: str = ""

    def __post_init__(self) -> None:
        shape = (self.gap.size, self.field.size)
        if self.force.shape != shape or self.moment.shape != shape or min(shape) < 4:
            raise ValueError(
                f"a table of {shape[0]} gaps and {shape[1]} fields with forces {self.force.shape} and moments "
                f"{self.moment.shape}: give one of each for every gap and field, at least 4 of both"
            )
        for name, values in (("gap", self.gap), ("field", self.field), ("force", self.force), ("moment", self.moment)):
            if not np.all(np.isfinite(values) & (values > 0.0)):
                raise ValueError(f"the table's `{name}` holds a value that is not a finite number above 0")
        for name, values in (("gap", self.gap), ("field", self.field)):
            step = np.diff(np.log(values))
            if step[0] <= 0.0 or np.any(np.abs(step - step[0]) > 1e-6 * step[0]):
                raise ValueError(f"the table's `{name}` does not grow in geometric steps")

    @cached_property
    def Ms(self) -> float:
        """Saturation magnetisation of the law [A/m]."""
        return saturation(self.law)

    @cached_property
    def _log_force(self) -> RectBivariateSpline:
        return RectBivariateSpline(np.log(self.gap), np.log(self.field), np.log(self.force / self.field**2))

    @cached_property
    def _log_moment(self) -> RectBivariateSpline:
        return RectBivariateSpline(np.log(self.gap), np.log(self.field), np.log(self.moment / self.field))

    def lone_sphere(self, h: np.ndarray | float) -> np.ndarray:
        """M_sph [Ms] of a lone sphere in the field h >= 0 [Ms]."""
        return sphere_magnetisation(self.law, np.asarray(h, dtype=float) * self.Ms) / self.Ms

    def force_of(self, g: np.ndarray | float, h: np.ndarray | float) -> np.ndarray:
        """F_2 [mu_0 Ms^2 a^2] at gaps g >= 0 [radii] and fields h >= 0 [Ms], of any shapes that broadcast."""
        g, h = self._check_arguments(g, h)
        return self._of(g, h)[0]

    def moment_of(self, g: np.ndarray | float, h: np.ndarray | float) -> np.ndarray:
        """M_2 [Ms], see `force_of`."""
        g, h = self._check_arguments(g, h)
        return self._of(g, h)[1]

    def force_log_slope(self, g: np.ndarray | float, h: np.ndarray | float) -> np.ndarray:
        """d ln F_2/d ln h [-] of the spline, at gaps and fields of the table; see `force_of`."""
        g, h = self._check_arguments(g, h)
        return 2.0 + self._log_force.ev(np.log(self._gap_in_table(g)), np.log(h), dy=1)

    def _check_arguments(self, g: np.ndarray | float, h: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        g, h = np.broadcast_arrays(np.asarray(g, dtype=float), np.asarray(h, dtype=float))
        if not (np.all(np.isfinite(g)) and np.all(np.isfinite(h) & (h >= 0.0))):
            raise ValueError("gaps [radii] must be finite and fields [Ms] finite magnitudes of at least 0")
        return g, h

    def _gap_in_table(self, g: np.ndarray) -> np.ndarray:
        return np.maximum(g, self.gap[0])

    def _of(self, g: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F_2 and M_2 inside the table and outside."""
        g = self._gap_in_table(g)
        low, high = self.field[0], self.field[-1]
        h_in, g_in = np.clip(h, low, high), np.minimum(g, self.gap[-1])
        at = np.log(g_in), np.log(h_in)
        linear = np.minimum(h, high)
        F, M = np.exp(self._log_force.ev(*at)) * linear**2, np.exp(self._log_moment.ev(*at)) * linear
        # saturated: the rest of M falls as 1/h, that of F with it
        beyond = high / np.maximum(h, high)
        F_s = _dipole_force(np.ones_like(g_in), g_in)
        F, M = F_s + (F - F_s) * np.where(h > high, beyond, 1.0), 1.0 + (M - 1.0) * np.where(h > high, beyond, 1.0)
        apart = g > self.gap[-1]
        if np.any(apart):
            mutual = self.lone_sphere(h)
            # contracts by less than 2/R^3 < 0.07 a turn
            for _ in range(12):
                mutual = self.lone_sphere(h + 2.0 / 3.0 * mutual / (2.0 + g) ** 3)
            F, M = np.where(apart, _dipole_force(mutual, g), F), np.where(apart, mutual, M)
        return F, M


def _dipole_force(M: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(pi/6) M^2 (2/R)^4: two point dipoles of moment (4/3) pi M, R = 2 + g apart [mu_0 Ms^2 a^2]."""
    return math.pi / 6.0 * M**2 * (2.0 / (2.0 + g)) ** 4


def fade(g: np.ndarray) -> np.ndarray:
    """1 up to `FADE_FROM`, 0 from `FADE_TO`, a cubic with level ends between."""
    t = np.clip((g - FADE_FROM) / (FADE_TO - FADE_FROM), 0.0, 1.0)
    return 1.0 - t**2 * (3.0 - 2.0 * t)


def fade_slope(g: np.ndarray) -> np.ndarray:
    """d fade/dg."""
    t = np.clip((g - FADE_FROM) / (FADE_TO - FADE_FROM), 0.0, 1.0)
    return -6.0 * t * (1.0 - t) / (FADE_TO - FADE_FROM)


def build_table(
    law: Law | GrainLaw,
    *,
    gap: np.ndarray = GAPS,
    field: np.ndarray = FIELDS,
    resolution: float = RESOLUTION,
    progress: Callable[[int, int], None] | None = None,
) -> PairTable:
    """Solve for every gap and field: one to two minutes for the default grid.

    Parameters
    ----------
    law : Law or GrainLaw
    gap, field : ndarray (ng,), (nh,)
        In geometric steps.
    resolution : float
        See `pair_solver.SpherePair`.
    progress : callable or None
        Called with the number of solves done and of all.

    Raises
    ------
    ValueError
        A law that does not saturate.
    ConvergenceError
        A solve failed.
    """
    from field.spheres.pair_solver import solve_pair

    digest = law_digest(law, gap, field)
    force, moment = np.empty((2, gap.size, field.size))
    count = 0

    def done() -> None:
        nonlocal count
        count += 1
        if progress is not None:
            progress(count, force.size)

    for i, one in enumerate(gap):
        pair = solve_pair(law, float(one), field, resolution=resolution, done=done)
        force[i], moment[i] = pair.force, pair.moment
    # as they are kept: a run that builds its table and the next one, which reads it, must not differ
    force, moment = (one.astype(np.float32).astype(float) for one in (force, moment))
    return PairTable(gap, field, force, moment, bulk_law(law), "finite elements of this machine", digest)


def pair_table(
    law: Law | GrainLaw,
    *,
    progress: Callable[[int, int], None] | None = None,
    cache: str | Path | None = None,
) -> PairTable:
    """The table of a law: shipped, from the user's cache, or built there.

    Parameters
    ----------
    law : Law or GrainLaw
        Bulk law of the spheres, or that of grains.
    progress : callable or None
        Called with the number of solves done and of all, where a table has to be built.
    cache : str, Path or None
        Folder of tables; None: `table_files.cache_folder()`.

    Raises
    ------
    ValueError
        A law that does not saturate: there is no Ms to scale by, see `pair_solver.linear_pair`.
    ConvergenceError
        A solve failed.

    Warns
    -----
    RuntimeWarning
        The table that was built could not be kept.
    """
    bulk = bulk_law(law)
    digest = law_digest(bulk, GAPS, FIELDS)
    shipped = _shipped_table(bulk, digest)
    if shipped is not None:
        return shipped
    path = (cache_folder() if cache is None else Path(cache)) / f"pair_{digest[:32]}.npz"
    columns = read_table(path, digest)
    if columns is not None:
        return PairTable(**columns, law=bulk, source=f"finite elements, kept in {path}", digest=digest)
    table = build_table(bulk, gap=GAPS, field=FIELDS, resolution=RESOLUTION, progress=progress)
    try:
        write_table(path, _columns(table), digest)
    except OSError as error:
        warnings.warn(
            f"the table of two spheres could not be kept in {path.parent} ({error.strerror or error}): it is built "
            "again each time; name a folder that can be written to in EMCLUTCH_CACHE",
            RuntimeWarning,
            stacklevel=2,
        )
    return table


def _columns(table: PairTable) -> dict[str, np.ndarray]:
    return {"gap": table.gap, "field": table.field, "force": table.force, "moment": table.moment}


def shipped_neighbours(law: Law | GrainLaw) -> list[tuple[FroehlichLaw, float]] | None:
    """Froehlich laws with shipped tables between which one is interpolated, with their factors; None: nothing is.

    The shares, of the logarithm of a quantity, are those of a cubic in chi^(-1/4).

    Raises
    ------
    ValueError
        The law of the thesis.
    """
    law = bulk_law(law)
    if not isinstance(law, FroehlichLaw) or not _SHIPPED_CHI[0] <= law.chi <= _SHIPPED_CHI[-1]:
        return None
    nodes = np.array(_SHIPPED_CHI)
    if np.any(np.abs(law.chi / nodes - 1.0) < _SAME_CHI):
        return None
    first = min(max(int(np.searchsorted(nodes, law.chi)) - 2, 0), nodes.size - 4)
    nodes = nodes[first : first + 4]
    x, at = nodes**_CHI_POWER, law.chi**_CHI_POWER
    factor = [float(np.prod([(at - x[k]) / (x[i] - x[k]) for k in range(4) if k != i])) for i in range(4)]
    return [(FroehlichLaw(float(chi), law.Ms), part) for chi, part in zip(nodes, factor, strict=True)]


def _shipped_table(law: Law, digest: str) -> PairTable | None:
    """The table of a Froehlich law from those that ship; None for another law, a chi beyond theirs, or without them."""
    if not isinstance(law, FroehlichLaw):
        return None
    neighbours = shipped_neighbours(law)
    if neighbours is None:
        near = [chi for chi in _SHIPPED_CHI if abs(law.chi / chi - 1.0) < _SAME_CHI]
        columns = _read_shipped_table(near[0]) if near else None
        source = f"finite elements, shipped for Froehlich's law at chi = {law.chi:g}"
        return None if columns is None else PairTable(**columns, law=law, source=source, digest=digest)
    shipped = [_read_shipped_table(node.chi) for node, _ in neighbours]
    tables = [columns for columns in shipped if columns is not None]
    if len(tables) < len(shipped):
        return None
    force, moment = (
        np.exp(sum(part * np.log(table[name]) for (_, part), table in zip(neighbours, tables, strict=True)))
        for name in ("force", "moment")
    )
    between = ", ".join(f"{node.chi:g}" for node, _ in neighbours)
    source = f"finite elements, interpolated to chi = {law.chi:g} between those shipped at {between}"
    return PairTable(tables[0]["gap"], tables[0]["field"], force, moment, law, source, digest)


def _read_shipped_table(chi: float) -> dict[str, np.ndarray] | None:
    return read_table(SHIPPED / _SHIPPED_NAME.format(chi), law_digest(FroehlichLaw(chi, 1.0), GAPS, FIELDS))


def main(arguments: Sequence[str] | None = None) -> None:
    """Build the shipped tables again: `python -m field.spheres.pair_table [CHI ...]`."""
    chosen = [float(text) for text in (sys.argv[1:] if arguments is None else arguments)] or _SHIPPED_CHI
    for chi in chosen:
        table = build_table(FroehlichLaw(chi, 1.0e6))
        path = SHIPPED / _SHIPPED_NAME.format(chi)
        write_table(path, _columns(table), table.digest)
        print(path)


if __name__ == "__main__":
    main()
