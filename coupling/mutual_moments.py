"""Moments of grains that magnetise one another and saturate where they touch, and the forces of their contacts.

Two models. **mutual**: every grain is a dipole in the field of all others, M_i = M_sph(|S_i|) S_i/|S_i| with S_i the
applied field and that of the others (and, where the applied field is the mean one of an even powder, the grain's own
contribution; `coupling.pair_fields`). **near_field** adds what finite elements give beyond that for two spheres that
nearly touch (`field.spheres.pair_table`), whose flux gathers in their neck:

- a near pair is driven by the field h_ij along its line of centres n without what each makes at the other: the mean of
  the applied field and the drop of the others' potential P between the centres,
  h_ij = (H_i + H_j).n/2 - [(P_i - p_ij) - (P_j - p_ji)]/r;
- each of the two gains v_ij = sign(h) dM(g, |h|) n; over its pairs a grain gains D_i = (sum v) sqrt(sum |v|^2)/sum |v|,
  because plain adding overshoots by 50 to 100 % in chains; |M| stays below saturation;
- they attract with dF(g, |h|) a^2 (a = 2 a_i a_j/(a_i + a_j)) in addition to the force of their dipoles, and repel each
  other less where the field lies across (`field.spheres.transverse_pair`);
- their near moments, which lie along n and not along S, make the torque r x F = mu_0 (V_i D_ij x S_i + V_j D_ji x S_j).
  So sum r x F = sum V M x B_applied at the fixed point, to round-off.

Gaps are counted between surfaces, in radii, and never below `smallest_gap`: oxide and roughness of the grains, a stated
property of the powder. The overlap of elastic contacts does not enter.

Source: the excess over dipoles and the rule of adding up are this project's; against finite elements from 18 to 500
kA/m (`tests/coupling/test_magnetised_contact.py`): pairs along the field within 0.2 %, oblique ones 2 %, chains 0.97
to 1.16 of the force, triangles 22 to 24 % too strong; six and more contacts of a grain are not verified.

The moments are a fixed point of a map that is neither linear nor symmetric. It is approached by damped sweeps that
start from the last moments, mixed with the sweep before as the secant through both asks (`mix_by_secant`); every sweep
updates all grains from the same state, so no bit depends on the threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coupling.finite_grains import NotFiniteGrains, refuse_not_finite
from coupling.grain_law_table import GrainLawTable
from coupling.image_lanes import MAX_WALLS
from coupling.influence import find_influence, reuse_or_allocate
from coupling.kernel_state import Influence, MagneticGrains, PairModel
from coupling.moment_kernels import contact_forces, gather_fields, magnetise, wall_heights
from coupling.neighbour_rows import NeighbourRows
from coupling.pair_fields import self_field_factor

MIN_GAP = 3e-3
"""Default of the gap between surfaces that touch [radii]."""

# Of an undamped step: where sweeps of this fraction do not shrink the residual it is lowered.
FIRST_DAMPING, MIN_DAMPING = 0.5, 0.05
# Moments so many times those of lone grains are of an earlier field: begin again.
FAR_START = 10.0


@dataclass(slots=True)
class Magnetisation:
    """Moments of grains and what they follow from.

    Attributes
    ----------
    moment : (n, 3) float64
        [A m^2].
    applied, field : (n, 3) float64
        Field without grains and field with the others' [A/m].
    slope : (n, 4) float64
        Of the applied field [A/m^2], see `field_slope`; zeros where none was given.
    potential : (n,) float64
        Scalar potential of the others [A].
    height : (n, w) float64
        Over the walls [m], see `coupling.mirror`.
    own_image : (n, w) float64
        Part of the potential that a grain's own image makes [A].
    fraction, contrast : (n,) float64
        What a grain takes of the sum of its pairs' excess moments, and what saturation leaves of its answer across.
    residual : float
        Root mean square of an undamped step over that of the magnetisation [-].
    sweeps : int
    known : Influence or None
        With which they were found, until the next solve; None: without a field, nothing pulls.
    """

    moment: np.ndarray
    applied: np.ndarray
    slope: np.ndarray
    field: np.ndarray
    potential: np.ndarray
    height: np.ndarray
    own_image: np.ndarray
    fraction: np.ndarray
    contrast: np.ndarray
    residual: float = np.inf
    sweeps: int = 0
    known: Influence | None = None


class MutualMoments:
    """Solver of the moments and the forces that follow from them; see the module.

    Parameters
    ----------
    table : GrainLawTable
        Of `coupling.grain_law_table.grain_table`.
    near : bool
        Model near_field; False: mutual.
    reach : float
        Of the pairs [m].
    smear : bool
        The applied field is the mean one of an even powder and holds every grain spread out over `reach`.
    smallest_gap : float
        [radii].
    walls : (w, 6) float64, optional
        Steel walls, see `coupling.mirror`; default: none.
    """

    def __init__(
        self,
        table: GrainLawTable,
        *,
        near: bool,
        reach: float,
        smear: bool = False,
        smallest_gap: float = MIN_GAP,
        walls: np.ndarray | None = None,
    ) -> None:
        if not (np.isfinite(reach) and reach > 0.0):
            raise ValueError(f"`reach` = {reach} m; allowed: more than 0")
        if not (np.isfinite(smallest_gap) and smallest_gap > 0.0):
            raise ValueError(
                f"`smallest_gap` = {smallest_gap}; allowed: more than 0 (radii of a grain; 0.003 is usual)"
            )
        self.table, self.near, self.reach, self.smear = table, bool(near), float(reach), bool(smear)
        self.smallest_gap = float(smallest_gap)
        self.walls = np.zeros((0, 6)) if walls is None else np.ascontiguousarray(walls, dtype=float).reshape(-1, 6)
        self.model = PairModel(self.reach, self.smear, self.near, self.smallest_gap)
        self._own = self_field_factor(reach, smear)
        self._room: Influence | None = None
        self._extra: np.ndarray | None = None

    def solve(
        self,
        position: np.ndarray,
        radius: np.ndarray,
        applied: np.ndarray,
        rows: NeighbourRows,
        *,
        gradient: np.ndarray | None = None,
        start: np.ndarray | None = None,
        tolerance: float = 1e-3,
        most_sweeps: int = 200,
    ) -> Magnetisation:
        """Find the moments.

        Parameters
        ----------
        position, applied : (n, 3) float64
            Centres [m], field without the grains (or their mean one, with `smear`) [A/m].
        radius : (n,) float64
            [m].
        rows : NeighbourRows
            Every neighbour of every grain within `reach`.
        gradient : (n, 3, 3) float64, optional
            grad H [A/m^2] of an applied field of revolution that was solved with the smear in it: the drives of near
            pairs then know how it bends between their centres. Default: it does not.
        start : (n, 3) float64, optional
            Moments to begin with [A m^2]; default: those of lone spheres.
        tolerance : float
            Residual that is asked for; 0: continue for `most_sweeps`.

        Returns
        -------
        Magnetisation
            Its `residual` says whether the tolerance was reached: nothing is raised for that.

        Raises
        ------
        ValueError
            For more than MAX_WALLS steel walls.
        NotFiniteGrains
            A position, a field or a moment is not a finite number; the first such grain is named.
        """
        if len(self.walls) > MAX_WALLS:
            raise ValueError(f"{len(self.walls)} steel walls; grains are mirrored in {MAX_WALLS} at most")
        n = len(position)
        volume = 4.0 / 3.0 * np.pi * radius**3
        applied = np.ascontiguousarray(applied, dtype=float)
        refuse_not_finite(position, applied)
        moment = np.zeros((n, 3)) if start is None else np.array(start, dtype=float)
        field, potential, fraction, contrast = np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros(n)
        height, own_image = np.empty((n, len(self.walls))), np.zeros((n, len(self.walls)))
        wall_heights(position, self.walls, self.reach, height)
        new, squares = np.empty((n, 3)), np.zeros((n, 2))
        slope = np.zeros((n, 4)) if gradient is None else field_slope(position, gradient)
        result = Magnetisation(moment, applied, slope, field, potential, height, own_image, fraction, contrast, 0.0)
        if n == 0 or not applied.any():  # without a field soft grains have no moment
            moment[:] = 0.0
            return result
        if start is not None and self._is_far(moment, volume, applied):
            moment[:] = 0.0
            start = None
        grains = MagneticGrains(
            position, radius, volume, moment, applied, slope, field, potential, fraction, contrast, height, own_image
        )  # fmt: skip
        near_by = rows.arrays
        known = find_influence(
            self.table, self.model, grains, near_by, self.walls, own=self._own, room=self._room, twin=rows.twin
        )  # fmt: skip
        self._room = result.known = known
        many = len(known.near_entry) + len(known.image_entry)
        self._extra = extra = reuse_or_allocate(many, (4,), self._extra)
        damping = 1.0 if start is None else FIRST_DAMPING
        before, last = np.inf, None
        for sweep in range(1, most_sweeps + 1):
            gather_fields(self.model, grains, near_by, known, field, potential, own_image)
            magnetise(
                self.table, self.model, grains, near_by, self.walls, known, damping, fraction, contrast, new, squares,
                extra,
            )  # fmt: skip
            step, total = (float(x) for x in squares.sum(axis=0))
            residual = 0.0 if total == 0.0 else float(np.sqrt(step / total))  # a NaN stays one
            result.residual, result.sweeps = residual, sweep
            if not np.isfinite(residual):
                raise NotFiniteGrains(f"the moments of the grains are not finite after {sweep} sweeps")
            if residual <= tolerance or sweep == most_sweeps:
                break  # `field`, `potential` and `fraction` are those of `moment`
            asked = (new - moment) / damping
            mixed = mix_by_secant(moment, asked, damping, last)
            last = moment, asked
            moment = result.moment = mixed
            grains = grains._replace(moment=moment)
            if sweep > 1 and step > 0.96 * before:
                damping, last = max(0.7 * damping, MIN_DAMPING), None
            elif sweep == 1 and start is None:
                damping = FIRST_DAMPING
            before = step
        return result

    def _is_far(self, moment: np.ndarray, volume: np.ndarray, applied: np.ndarray) -> bool:
        """True if the initial moments are of another scale than the field, as after its fast fall."""
        ratio = self.table.sphere_ratio[0]
        lone = np.minimum(ratio * np.sqrt((applied**2).sum(axis=1)), self.table.scale)
        return float((moment**2).sum()) > FAR_START**2 * float(((volume * lone) ** 2).sum())

    def forces(
        self,
        position: np.ndarray,
        radius: np.ndarray,
        rows: NeighbourRows,
        found: Magnetisation,
        *,
        attraction: bool = True,
        velocity: np.ndarray | None = None,
        ahead: float = 0.0,
    ) -> tuple[np.ndarray, float, float]:
        """Forces (n, 3) [N], and sums of x x F about z [N m]: of the pairs, from moments and fields, and of the walls.

        Without `attraction` the near excess dF is left out, for those who take it from the gap of every step; with
        `ahead` > 0 [s] it is its mean over that time at the present `velocity` (n, 3) [m/s].
        """
        n = len(position)
        force, torque = np.zeros((n, 3)), np.zeros((n, 2))
        if found.known is None:
            return force, 0.0, 0.0
        moving = np.zeros((n, 3)) if velocity is None else velocity
        grains = MagneticGrains(
            position, radius, 4.0 / 3.0 * np.pi * radius**3, found.moment, found.applied, found.slope, found.field,
            found.potential, found.fraction, found.contrast, found.height, found.own_image,
        )  # fmt: skip
        many = len(found.known.near_entry) + len(found.known.image_entry)
        self._extra = extra = reuse_or_allocate(many, (4,), self._extra)
        contact_forces(
            self.table, self.model, grains, rows.arrays, self.walls, found.known, attraction, moving, float(ahead),
            force, torque, extra,
        )  # fmt: skip
        return force, -float(torque[:, 0].sum()), float(torque[:, 1].sum())


def mix_by_secant(
    moment: np.ndarray, asked: np.ndarray, damping: float, last: tuple[np.ndarray, np.ndarray] | None
) -> np.ndarray:
    """The next moments (n, 3) [A m^2] of a damped fixed-point iteration that remembers one sweep.

    `asked` is what an undamped step would change, `last` the moments and the step asked of the sweep before (None:
    nothing is remembered, the damped step alone). Of all moments on the line through both sweeps those are taken for
    which the step asked is smallest, and the damped step is made from there: Anderson's acceleration of depth one
    (D. G. Anderson, J. ACM 12 (1965) 547). It follows an iteration that alternates as well as one that creeps.
    """
    plain = moment + damping * asked
    if last is None:
        return plain
    moved, changed = moment - last[0], asked - last[1]
    size = float((changed**2).sum())
    if size == 0.0:
        return plain
    back = float((changed * asked).sum()) / size
    return plain - back * (moved + damping * changed)


def field_slope(position: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """dH_r/dr, H_r/r, dH_z/dz and dH_r/dz + dH_z/dr (n, 4) of grad H (n, 3, 3) [A/m^2] of a field of revolution.

    In each grain's own half plane: a turn about the axis leaves them.
    """
    x, y = position[:, 0], position[:, 1]
    rho = np.hypot(x, y)
    per_rho = np.divide(1.0, rho, out=np.zeros(len(rho)), where=rho > 0.0)
    c, s = x * per_rho, y * per_rho
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (gradient[:, a].T for a in range(3))
    slope = np.empty((len(rho), 4))
    slope[:, 0] = c * c * xx + c * s * (xy + yx) + s * s * yy
    slope[:, 1] = s * s * xx - c * s * (xy + yx) + c * c * yy
    slope[:, 2] = zz
    slope[:, 3] = (zx + xz) * c + (zy + yz) * s
    return slope
