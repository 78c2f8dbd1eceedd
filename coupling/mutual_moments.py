"""Moments and forces of grains that magnetise one another and whose flux gathers where they touch, of one energy.

Two models. **mutual**: every grain is a dipole in the field of all others, M_i = M_sph(|S_i|) S_i/|S_i| with S_i the
applied field and that of the others (and, where the applied field is the mean one of an even powder, the grain's own
contribution; `coupling.pair_fields`).

**near_field** adds the excess flux through the necks of near pairs, whose gap g is less than 1.2 radii. Unknown are, of
every grain, the dipole part M_i of its magnetisation and, of every near pair k = (i, j), the magnetomotive
force (mmf) D_k over the neck, from j to i along n; the flux q_k follows from it. It leaves grain i and enters grain j
as charges +q_k and -q_k at their centres, Q_i = sum of +-q_k. The state is the stationary point of

    W/mu_0 = sum_i [V_i u(M_i) - m_i.H_i + Q_i^2/(8 pi a_i)] + W_dd + W_qd + W_qq
             + sum_k [w(g_k, D_k, s_k) + q_k D_k - q_k r_k n_k.H_k] + W_t

with u(M) the work of magnetising a lone sphere, W_dd, W_qd and W_qq the energies of all pairs of dipoles and charges
(`coupling.pair_fields`), w that of a neck (`coupling.grain_law_table`), s = 1 - sign(D) (M_i + M_j).n/(2 Ms) the
capacity that the dipole parts leave it, and

    W_t = - sum_k kappa(g_k)/(4 pi r_k^3) c_i c_j m_i,t.m_j,t

what two spheres have less than two dipoles across their line of centres (`field.spheres.transverse_pair`), for which
saturation leaves the contrasts c. So

    u'(M_i) M_i/|M_i| = S_i + sum_k of the necks' and of W_t's derivatives by m_i,
    D_k = r_k n_k.H_k - (phi_i - phi_j),

where S_i and phi_i count all grains, the partner included. Forces are -dW/dx at constant M and D: sums over pairs
that obey the third law, conserve angular momentum, and do no work in a closed loop. The moment of a grain, which makes
the field outside and is what files hold, is m_i + sum_k q_k r_k n_k a_i/(a_i + a_j).

A steel wall is the mirrored pair: neck and energy are half of those of the grain and its image, times the wall's
strength.

Gaps are counted between surfaces, in radii a = 2 a_i a_j/(a_i + a_j). Below `smallest_gap`, which stands for oxide and
roughness of the grains, a stated property of the powder, the neck is that of the smallest gap, its energy goes on along
the tangent.

Source: the functional is this project's; its table is made of finite elements for two spheres. Against finite elements
(`tests/coupling/test_magnetised_contact.py`, `tests/coupling/test_one_energy.py`) it is valid from one to six contacts
of a grain and up to 200 kA/m in iron; beyond 200 kA/m it is too strong where contacts are many. In bcc and fcc lattices
moments are 1.14 to 1.33 times too large, and what necks add to the stress is off by up to a third to 120 kA/m and by
more beyond (docs/explanation/grains_that_magnetise.md).

Dipoles and mmfs are the fixed point of a map that is neither linear nor symmetric, and a saddle of W
(`coupling.moment_sweeps`). The step of an mmf is divided by 1 + (k_i + k_j)/2, k = sum over a grain's necks of
(dq/dD)/(4 pi a), that of a dipole by 1 + (dM/dh) times the sum of |d2w/ds2|/(2 mu_0 Ms^2 V).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coupling.finite_grains import refuse_not_finite
from coupling.grain_law_table import GrainLawTable
from coupling.image_kernels import MAX_WALLS
from coupling.influence import find_influence, reuse_or_allocate
from coupling.influence_kernels import APPLIED
from coupling.kernel_state import FIRST, SECOND, Influence, MagneticGrains, PairModel
from coupling.moment_kernels import (
    add_charge_moments,
    begin_mmf,
    contact_forces,
    grain_energies,
    wall_drives,
    wall_heights,
)
from coupling.moment_sweeps import MomentSweeps
from coupling.neck_kernels import ENERGY, FLUX, N_NECK
from coupling.neighbour_rows import NeighbourRows
from geometry.kernels.simd import LANES

MIN_GAP = 3e-3
"""Default of the gap between surfaces that touch [radii]."""

# Moments so many times those of lone grains are of an earlier field: begin again.
FAR_START = 10.0
RESTARTS = 3  # of sweeps from the best state of Newton's method, where that has failed
MU_0 = 4e-7 * np.pi


@dataclass(slots=True)
class Necks:
    """Mmfs and potentials of a solve, to begin the next one with.

    Attributes
    ----------
    pair : (k, 2) int64
        Numbers of the grains of near pairs.
    neck_mmf : (k,) float64
        From the second to the first [A].
    wall_number, wall, wall_mmf : (l,) int64, int64, float64
        Number of the grain, wall, and mmf from its image to it [A].
    number, potential : (n,) int64, float64
        Numbers of all grains, and their potentials [A]: pairs that have become near ones begin with these.
    """

    pair: np.ndarray
    neck_mmf: np.ndarray
    wall_number: np.ndarray
    wall: np.ndarray
    wall_mmf: np.ndarray
    number: np.ndarray
    potential: np.ndarray


@dataclass(slots=True)
class Magnetisation:
    """Moments of grains and what they follow from.

    Attributes
    ----------
    moment : (n, 3) float64
        Dipole part and the charges' part [A m^2].
    dipole : (n, 3) float64
        Dipole part [A m^2].
    charge : (n,) float64
        Of the necks [A m].
    applied, field : (n, 3) float64
        Field without grains and field with the others' [A/m].
    slope : (n, 4) float64
        Of the applied field [A/m^2], see `field_slope`; zeros where none was given.
    potential : (n,) float64
        Scalar potential of all grains at the centre [A].
    height : (n, w) float64
        Over the walls [m], see `coupling.mirror`.
    contrast : (n, 3) float64
        What saturation leaves of a grain's response across [-], its slope over M [m/A], and dM/dh of a lone sphere.
    neck_mmf, neck : (blocks, 8), (blocks, N_NECK, 8) float64
        Of near pairs as `known` lists them: mmfs [A], fluxes [A m] and energies.
    wall_mmf, wall_neck : (n, w), (n, w, 2) float64
        The same at walls.
    residual : float
        Root mean square of an undamped step over that of the magnetisation, or of the mmfs where that is more [-].
    sweeps : int
    known : Influence or None
        With which they were solved, until the next solve; None: without a field, nothing pulls.
    """

    moment: np.ndarray
    dipole: np.ndarray
    charge: np.ndarray
    applied: np.ndarray
    slope: np.ndarray
    field: np.ndarray
    potential: np.ndarray
    height: np.ndarray
    contrast: np.ndarray
    neck_mmf: np.ndarray
    neck: np.ndarray
    wall_mmf: np.ndarray
    wall_neck: np.ndarray
    residual: float = np.inf
    sweeps: int = 0
    known: Influence | None = None


@dataclass(slots=True)
class LaggedForces:
    """Forces of one evaluation.

    Attributes
    ----------
    force : (n, 3) float64
        [N].
    torque_pairs, torque_walls : float
        Sums of x x F about z of the pairs, and of images and walls [N m].
    virial : (3, 3) float64 or None
        Sum over pairs of r_a F_b, r from the second grain to the first and F on the first [N m]; with the applied
        field's force on the charges.
    """

    force: np.ndarray
    torque_pairs: float
    torque_walls: float
    virial: np.ndarray | None = None


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
        [radii]; of necks at least the first of their table, 2.9e-4.
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
        self.smallest_gap = max(float(smallest_gap), math.exp(table.gap_start)) if near else float(smallest_gap)
        self.walls = np.zeros((0, 6)) if walls is None else np.ascontiguousarray(walls, dtype=float).reshape(-1, 6)
        self.model = PairModel(self.reach, self.smear, self.near, self.smallest_gap)
        self._room: Influence | None = None
        self._near_room: np.ndarray | None = None

    def solve(
        self,
        position: np.ndarray,
        radius: np.ndarray,
        applied: np.ndarray,
        rows: NeighbourRows,
        *,
        gradient: np.ndarray | None = None,
        start: np.ndarray | None = None,
        necks: Necks | None = None,
        number: np.ndarray | None = None,
        tolerance: float = 1e-3,
        max_sweeps: int = 200,
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
            Dipole parts to begin with [A m^2]; default: those of lone spheres.
        necks : Necks, optional
            Mmfs to begin with, of `necks_of` the last solve; pairs that are not among them begin with what the
            applied field and its potentials say.
        number : (n,) int64, optional
            Numbers by which grains are known in `necks`, from 0 and not many more than there are grains; default: their
            rows.
        tolerance : float
            Largest residual; 0: continue for `max_sweeps`.

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
        n, w = len(position), len(self.walls)
        position = np.ascontiguousarray(position)
        volume = 4.0 / 3.0 * np.pi * radius**3
        applied = np.ascontiguousarray(applied, dtype=float)
        refuse_not_finite(position, applied)
        dipole = np.zeros((n, 3)) if start is None else np.array(start, dtype=float)
        slope = np.zeros((n, 4)) if gradient is None else field_slope(position, gradient)
        height = np.empty((n, w))
        wall_heights(position, self.walls, self.reach, height)
        state = Magnetisation(
            dipole, dipole, np.zeros(n), applied, slope, np.zeros((n, 3)), np.zeros(n), height, np.ones((n, 3)),
            np.zeros((0, LANES)), np.zeros((0, N_NECK, LANES)), np.zeros((n, w)), np.zeros((n, w, 2)), 0.0,
        )  # fmt: skip
        if n == 0 or not applied.any():  # without a field soft grains have no moment
            dipole[:] = 0.0
            return state
        if start is not None and self._is_far(dipole, volume, applied):
            dipole[:] = 0.0
            start = necks = None
        grains = self._grains(position, radius, volume, state)
        state.known = known = find_influence(
            self.table, self.model, grains, rows.arrays, self.walls, room=self._room, twin=rows.twin
        )
        self._room = known
        number = np.arange(n) if number is None else number
        state.neck_mmf, state.wall_mmf = self._first_mmf(grains, known, necks, number, state.wall_mmf)
        state.neck = np.zeros((len(state.neck_mmf), N_NECK, LANES))
        sweeps = MomentSweeps(
            self.table, self.model, self.walls, grains, rows.arrays, state, self._scratch(known)
        )
        sweeps.run(tolerance, max_sweeps, start is None)
        for _ in range(RESTARTS):
            if not tolerance < state.residual or state.sweeps >= max_sweeps:
                break
            sweeps.newton(tolerance, max_sweeps)
            if tolerance < state.residual and state.sweeps < max_sweeps:
                sweeps.run(tolerance, max_sweeps - state.sweeps, False)
        state.moment = state.dipole.copy()
        if self.near:
            grains = self._grains(position, radius, volume, state)
            add_charge_moments(
                rows.arrays, grains, self.walls, known, state.neck, state.wall_neck, state.moment, self._scratch(known)
            )
        return state

    def necks_of(self, state: Magnetisation, number: np.ndarray | None = None) -> Necks:
        """Mmfs of a solve, by the grains' `number` (n,); default: their rows."""
        known = state.known
        none, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
        if known is None or not self.near:
            return Necks(np.zeros((0, 2), dtype=np.int64), nothing, none, none, nothing, none, nothing)
        number = np.arange(len(state.moment)) if number is None else number.astype(np.int64)
        row, wall = np.nonzero(state.wall_mmf)
        return Necks(
            number[np.stack((_unique(known, FIRST), _unique(known, SECOND)), axis=1)],
            state.neck_mmf.reshape(-1)[: known.near_pairs].copy(), number[row], wall, state.wall_mmf[row, wall], number,
            state.potential.copy(),
        )  # fmt: skip

    def _first_mmf(
        self,
        grains: MagneticGrains,
        known: Influence,
        necks: Necks | None,
        number: np.ndarray,
        wall_mmf: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mmfs to begin with: of `necks`, else those of the applied field and of the potentials there."""
        neck_mmf = known.near_pair[: len(known.near_unique), APPLIED].copy()
        if not self.near:
            return neck_mmf, wall_mmf
        wall_drives(self.model, grains, self.walls, wall_mmf)
        if necks is None:
            return neck_mmf, wall_mmf
        number = number.astype(np.int64)
        count = 1 + int(max(number.max(initial=0), necks.number.max(initial=0)))
        potential = np.zeros(count)
        potential[necks.number] = necks.potential
        begin_mmf(known.near_unique, number, potential, necks.pair, necks.neck_mmf, neck_mmf)
        row, wall = np.nonzero(wall_mmf)
        wall_mmf[row, wall] -= 2.0 * potential[number[row]]
        row_of = np.full(count, -1)
        row_of[number] = np.arange(len(number))
        row, wall = row_of[necks.wall_number], necks.wall
        here = (row >= 0) & (wall < wall_mmf.shape[1])
        row, wall, before = row[here], wall[here], necks.wall_mmf[here]
        still = wall_mmf[row, wall] != 0.0
        wall_mmf[row[still], wall[still]] = before[still]
        return neck_mmf, wall_mmf

    def _grains(
        self, position: np.ndarray, radius: np.ndarray, volume: np.ndarray, state: Magnetisation
    ) -> MagneticGrains:
        # those of `Grains` are columns of wider rows: one layout for all callers, or each kernel is compiled for two
        return MagneticGrains(
            np.ascontiguousarray(position), np.ascontiguousarray(radius), volume, state.dipole, state.charge,
            state.applied, state.slope, state.field, state.potential, state.contrast, state.height,
        )  # fmt: skip

    def _scratch(self, known: Influence) -> np.ndarray:
        many = len(known.near_entry) + len(known.image_entry)
        self._near_room = reuse_or_allocate(many, (8,), self._near_room)
        return self._near_room

    def _is_far(self, moment: np.ndarray, volume: np.ndarray, applied: np.ndarray) -> bool:
        """True if the initial moments are of another scale than the field, as after its fast fall."""
        ratio = self.table.sphere[0, 0]
        lone = np.minimum(ratio * np.sqrt((applied**2).sum(axis=1)), self.table.scale)
        return float((moment**2).sum()) > FAR_START**2 * float(((volume * lone) ** 2).sum())

    def forces(
        self,
        position: np.ndarray,
        radius: np.ndarray,
        rows: NeighbourRows,
        state: Magnetisation,
        *,
        attraction: bool = True,
        velocity: np.ndarray | None = None,
        ahead: float = 0.0,
        virial: bool = False,
    ) -> LaggedForces:
        """Forces at the solved dipoles and mmfs.

        Without `attraction` the pull of the necks along their lines of centres is left out, for callers that
        evaluate it at the gap of every step; with `ahead` > 0 [s] it is its mean over that time at the present
        `velocity` (n, 3) [m/s]. With `virial` the sum over pairs of r_a F_b is computed too.
        """
        n = len(position)
        force, torque = np.zeros((n, 3)), np.zeros((n, 2))
        if state.known is None:
            return LaggedForces(force, 0.0, 0.0, np.zeros((3, 3)) if virial else None)
        known = state.known
        moving = np.zeros((n, 3)) if velocity is None else velocity
        grains = self._grains(position, radius, 4.0 / 3.0 * np.pi * radius**3, state)
        sums = np.zeros((n, 9)) if virial else None
        necks = np.zeros((len(known.near_unique), 9, LANES)) if virial else None
        contact_forces(
            self.table, self.model, grains, rows.arrays, self.walls, known, state.neck_mmf, state.wall_mmf, attraction,
            moving, float(ahead), force, torque, self._scratch(known), sums, necks,
        )  # fmt: skip
        total = None
        if sums is not None and necks is not None:
            each = necks.transpose(1, 0, 2).reshape(9, -1)[:, : known.near_pairs]
            total = (sums.sum(axis=0) + each.sum(axis=1)).reshape(3, 3)
            total += MU_0 * (state.moment - state.dipole).T @ state.applied
        return LaggedForces(force, float(torque[:, 0].sum()), float(torque[:, 1].sum()), total)

    def energy(self, position: np.ndarray, radius: np.ndarray, state: Magnetisation) -> float:
        """W [J] of the solved state, see the module."""
        if state.known is None:
            return 0.0
        grains, known = self._grains(position, radius, 4.0 / 3.0 * np.pi * radius**3, state), state.known
        each = np.empty(len(position))
        grain_energies(self.table, grains, each)
        near = state.neck[:, ENERGY] - state.neck[:, FLUX] * known.near_pair[: len(state.neck), APPLIED]
        total = each.sum() + near.reshape(-1)[: known.near_pairs].sum()
        if self.near:
            drive = np.empty_like(state.wall_mmf)
            wall_drives(self.model, grains, self.walls, drive)
            total += state.wall_neck[:, :, 1].sum() - 0.5 * (state.wall_neck[:, :, 0] * drive).sum()
        return MU_0 * float(total)


def _unique(known: Influence, column: int) -> np.ndarray:
    """A column of the near pairs (near_pairs,), each once."""
    return known.near_unique[:, column].reshape(-1)[: known.near_pairs]


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
