"""Rigid grains between walls on turning bodies: the loop around the compiled step of `particles.dvi.step_kernel`.

The same face as `particles.DEM`: what moves grains need not know which of the two does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.walls import Wall
from particles.bodies import Body
from particles.dem.step_totals import EnergyTotals, StepTotals
from particles.dvi import gauss_seidel as gs
from particles.dvi import step_books as books
from particles.dvi import step_kernel as kernel
from particles.dvi.accelerated import ANDERSON, APGD, GAUSS_SEIDEL, INTERIOR, relax_number
from particles.dvi.couples import N_COUPLE, N_SPRING_COUPLE, no_couples
from particles.dvi.impulse_list import ImpulseList
from particles.dvi.interior_point import solve_by_interior_point
from particles.dvi.kernel_state import (
    Call,
    Couples,
    GrainState,
    PairSlots,
    Partition,
    Records,
    Search,
    StepArguments,
    Totals,
    WallSlots,
    WallState,
)
from particles.dvi.rigid_contact import RigidContact
from particles.dvi.rigid_triangles import N_TURN
from particles.dvi.shares import make_shares
from particles.dvi.springs import spring_table
from particles.faults import DemError, DemErrorKind, ParticleError
from particles.grain_motion import Gravity
from particles.grains import Grains
from particles.laws.rolling_friction import RollingFriction
from particles.laws.twisting_friction import TwistingFriction
from particles.lists.contact_table import ContactTable
from particles.lists.neighbours import cell_order
from particles.shafts import Shafts, drives_at
from particles.threads import at_most
from particles.walls.device_walls import DeviceWalls
from particles.walls.triangle_kernels import N_FOUND, closest_on_triangle
from particles.walls.wall_kernels import wall_overlaps
from particles.walls.wall_table import outside

STEPS_PER_CALL = 512  # bounds the table of prescribed speeds
# grains may reach beyond the gap that their own speeds close, when others push them: this share of the fastest one's
# way is added
MARGIN = 0.25
FAST_SKIN = 4.0  # skin, in ways of the fastest grain in a step: a step from the list and the next, for two grains
FAST_WALLS = 4.0  # the same for triangles, in ways of their fastest point: three steps from the list and the next
SHOT_OFF = 20.0  # radii a step: what no wall of a device throws a grain at
SLOP = 1e-4  # overlap, as a share of the radius, below which positions are left alone


@dataclass(frozen=True, slots=True)
class RigidTotals(StepTotals):
    """Totals of a run of rigid grains; ``energy.dissipation`` has "impact" and "sliding", where they are simulated also
    "rolling" and "twisting"; no force is "damping".

    Attributes
    ----------
    sweeps, max_sweeps : int
        Sweeps over the contacts in all, and in the hardest step.
    visits : int
        Contacts that the sweeps have visited.
    residual : float
        Largest natural map at the end of a step [m/s].
    missed_steps : int
        Steps that did not reach the tolerance.
    taken_over : int
        Steps that the accelerated solver finished.
    warm_hits : float
        Share of the loaded contacts that had an impulse to start from.
    projections : int
        Sweeps over the positions that removed overlap (they conserve no angular momentum).
    stabilisation_work : float
        Work of the held forces on the displacements that removed overlap [J].
    """

    sweeps: int
    max_sweeps: int
    visits: int
    residual: float
    missed_steps: int
    taken_over: int
    warm_hits: float
    projections: int
    stabilisation_work: float


class DVI:
    """Rigid grains moving between walls.

    Parameters
    ----------
    grains : Grains
        Taken over: its arrays are replaced, sorted and advanced.
    walls, bodies
        Walls refer to bodies by name.
    contact : RigidContact
        Friction and restitution of every contact.
    dt : float
        Step [s].
    gravity : array_like, shape (3,), or callable, optional
        Acceleration [m/s^2]; a callable takes times (k,) [s] and returns (k, 3).
    theta : float
        Weight of the new velocity in the drift, 1/2 to 1; at 1 velocities lag by half a step, as in `DEM`.
    friction : "coulomb" or "convex"
        Exact Coulomb, or the convex relaxation that Project Chrono solves.
    solver : "gauss_seidel", "accelerated", "interior_point" or "psor" or "apgd"
        Sweeps alone; accelerated sweeps after the first; these, and an interior point for steps on which they stall;
        projected over-relaxation, accelerated projected gradients (both convex only).
    tolerance : float
        On the natural map [m/s].
    max_sweeps : int
        Sweeps a step.
    skin : float, optional
        Of the Verlet list [m]; 0.3 of the mean diameter by default.
    overlap_limit : float
        Overlap, as a share of the diameter, at which the run is stopped.
    warm_start : bool
        Begin from the impulses of the last step.
    stiffness : array_like, shape (2, 2), optional
        [[k_n, k_t] between grains, [k_n, k_t] at walls] [N/m] of contacts that give way (`particles.dvi.springs`);
        rigid ones without.
    rolling, twisting : optional
        Resistance to rolling and to twisting (`particles.dvi.couples`).

    Attributes
    ----------
    external_force, time, step_count, order_version, list_version
        As in `DEM`.
    """

    def __init__(
        self,
        grains: Grains,
        walls: Sequence[Wall],
        bodies: Sequence[Body],
        contact: RigidContact,
        *,
        dt: float,
        gravity: Gravity | None = None,
        sector: None = None,
        theta: float = 1.0,
        friction: str = "coulomb",
        solver: str = "accelerated",
        tolerance: float = 1e-6,
        max_sweeps: int = 10_000,
        relaxation: float = 1.0,
        skin: float | None = None,
        overlap_limit: float = 0.1,
        warm_start: bool = True,
        stiffness: np.ndarray | None = None,
        rolling: RollingFriction | None = None,
        twisting: TwistingFriction | None = None,
    ) -> None:
        if sector is not None:
            raise ValueError("rigid grains (DVI) need the full ring; leave the sector out, or use DEM")
        if not 0.0 < dt < np.inf:
            raise ValueError(f"dt = {dt:g} s; allowed: more than 0")
        if not 0.5 <= theta <= 1.0:
            raise ValueError(f"theta = {theta:g}; allowed: 1/2 to 1")
        if not 0.0 < tolerance < np.inf:
            raise ValueError(f"tolerance = {tolerance:g} m/s; allowed: more than 0")
        for name, value, allowed in (
            ("friction", friction, ("coulomb", "convex")),
            ("solver", solver, ("gauss_seidel", "accelerated", "interior_point", "psor", "apgd")),
        ):
            if value not in allowed:
                raise ValueError(f"{name} = {value!r}; allowed: {', '.join(allowed)}")
        if solver in ("psor", "apgd") and friction != "convex":
            raise ValueError(f'solver = "{solver}" solves the convex law; choose friction = "convex"')
        self.grains, self.walls, self.bodies, self.contact = grains, list(walls), list(bodies), contact
        self.dt, self.theta, self.sector, self.overlap_limit = float(dt), float(theta), sector, overlap_limit
        self.tolerance, self.max_sweeps, self.warm_start = float(tolerance), int(max_sweeps), warm_start
        self.gravity = gravity if gravity is None or callable(gravity) else np.array(gravity, dtype=float).reshape(3)
        self.skin = 0.6 * float(np.mean(grains.radius)) if skin is None else float(skin)
        if not 0.0 < self.skin < np.inf:
            raise ValueError(f"skin = {self.skin * 1e3:g} mm; allowed: more than 0")
        self.ledger = True  # the books of energy are a by-product here
        self.external_force: np.ndarray | None = None
        self.step_count = self.order_version = self.list_version = 0
        if stiffness is not None and (solver in ("apgd", "interior_point") or not warm_start):
            raise ValueError(
                f'solver = "{solver}", warm_start = {warm_start}: springs (stiffness) need their impulses of the step '
                'before and "accelerated", "gauss_seidel" or "psor"; or leave stiffness out'
            )
        self._resist = np.zeros((2, 2))  # mu_r and mu_w between grains, at walls
        for column, part in enumerate((rolling, twisting)):
            if part is not None:
                self._resist[:, column] = part.table()
        if self._resist.any() and solver in ("apgd", "interior_point"):
            raise ValueError(
                f'solver = "{solver}" solves no rolling or twisting friction; choose "accelerated", "gauss_seidel" or '
                '"psor", or leave them out'
            )
        self._law = contact.table()
        self._stiffness = None if stiffness is None else np.array(stiffness, dtype=float)
        self._soft = self._springs_of_step()
        self._springs = np.zeros(4)  # energy [J]: normal, tangential, of rolling, of twisting
        self._convex = None if friction == "coulomb" else True
        self._relax = relax_number(self._convex, float(relaxation) if solver == "psor" else None)
        self._method = {"accelerated": ANDERSON, "interior_point": INTERIOR, "apgd": APGD}.get(solver, GAUSS_SEIDEL)
        self._open_step = np.array([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._device = DeviceWalls(self.walls, self.bodies)
        self._turn = np.zeros((len(self.bodies) if len(self._device.triangles) else 0, N_TURN))
        self._encloses = not outside(grains.position, self.walls, 0.0).any()
        n = grains.count
        self._grain = np.zeros((n, gs.N_GRAIN))
        self._bound = np.zeros(n)
        self._body = np.zeros((len(self.bodies), gs.N_BODY))
        self._couples = no_couples()
        self._stale = True
        self._reach = self.skin
        self._impulses: ImpulseList | None = None
        self._rebuild()
        self._springs[0] = self._pressed_in()

    @property
    def time(self) -> float:
        """Time [s] of the positions."""
        return self.step_count * self.dt

    @property
    def list_skin(self) -> float:
        """How much further than touching the present list reaches [m]: more than `skin` where grains are fast."""
        return self._reach

    @property
    def gravity_now(self) -> np.ndarray | None:
        """Acceleration of gravity [m/s^2] at this time, shape (3,)."""
        pull = self._pull(1)
        return pull[0] if len(pull) else None

    @property
    def n_sectors(self) -> int:
        """Sectors in the full ring."""
        return 1

    @property
    def contact_force(self) -> np.ndarray:
        """Sum of the contact forces on each grain, mean over the last step [N], shape (n, 3)."""
        c = self._list
        net = np.zeros((self.grains.count, 3))
        np.add.at(net, c.pairs.rows(), c.pair_impulse[:, :3])
        np.subtract.at(net, c.pairs.other, c.pair_impulse[:, :3])
        np.add.at(net, c.wall_rows(), c.wall_impulse[:, :3])
        return net / self.dt

    @property
    def _list(self) -> ImpulseList:
        assert self._impulses is not None
        return self._impulses

    def run(self, n_steps: int) -> RigidTotals:
        """Advance by ``n_steps`` steps.

        Raises
        ------
        DemError
            For overlap beyond the limit, a number that is not finite, a grain outside the device.
        """
        totals = np.zeros(books.N_SUMS)
        totals[kernel.GRAIN] = -1.0
        body_totals = np.zeros((len(self.bodies), books.N_BODY_SUMS))
        kinetic, rebuilds, left = self.grains.kinetic_energy(), 0, n_steps
        elastic = float(self._springs.sum())
        angle, speed = (np.array([getattr(b, name) for b in self.bodies]) for name in ("angle", "speed"))
        while left > 0:
            if self._stale:
                self._rebuild()
                rebuilds += 1
            answer, done = self._advance(min(left, STEPS_PER_CALL), angle, speed, totals, body_totals)
            left -= done
            self.step_count += done
            for body, a, w in zip(self.bodies, angle, speed, strict=True):
                body.angle, body.speed = float(a), float(w)
            if answer == kernel.HAND_OVER:
                self._improve()
                continue
            self._stale = answer != kernel.DONE
            if answer in (kernel.NOT_FINITE, kernel.OVERLAP):
                self._explain(answer, totals)
            self._refuse_shot_off(totals[books.MAX_SPEED])
        return self._summary(n_steps, totals, body_totals, kinetic, elastic, rebuilds)

    def contacts(self) -> ContactTable:
        """The loaded contacts of the last step."""
        g, c = self.grains, self._list
        x, radius = g.position, g.radius
        k = np.flatnonzero(c.pair_impulse[:, :3].any(axis=1))
        i, j = c.pairs.rows()[k], c.pairs.other[k].astype(np.int64)
        away = x[j] - x[i]
        reach = radius[i] + radius[j]
        point = x[i] + away * (radius[i] / reach)[:, None]
        w = np.flatnonzero(c.wall_impulse[:, :3].any(axis=1))
        row, wall = c.wall_rows()[w], c.wall_other[w].astype(np.int64)
        depth = self._depths(row, wall)
        seen = np.isfinite(depth[:, 0])
        row, wall, w, depth = row[seen], wall[seen], w[seen], depth[seen]
        at_wall = x[row] + (radius[row] - depth[:, 0])[:, None] * depth[:, 1:]
        none = np.full(len(row), -1)
        return ContactTable(
            np.concatenate([i, row]), np.concatenate([j, none]),
            np.concatenate([np.full(len(i), -1), self._device.wall[wall]]),
            np.zeros(len(i) + len(row), dtype=np.int64), np.concatenate([point, at_wall]),
            np.concatenate([c.pair_impulse[k, :3], c.wall_impulse[w, :3]]) / self.dt,
            np.concatenate([reach - np.linalg.norm(away, axis=1), depth[:, 0]]),
        )  # fmt: skip

    def invalidate(self) -> None:
        """Say that positions were changed from outside: the list is renewed before the next step."""
        self._stale = True

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to go on bit for bit."""
        g = self.grains
        arrays = {name: getattr(g, name).copy() for name in ("where", "motion", "mass", "particle_id")}
        for name, value in (("magnetic_moment", g.magnetic_moment), ("external_force", self.external_force)):
            if value is not None:
                arrays[name] = value.copy()
        arrays |= {f"list_{name}": value.copy() for name, value in self._list.arrays().items()}
        arrays["bodies"] = np.array([[b.angle, b.speed, b.external_torque] for b in self.bodies]).reshape(-1, 3)
        arrays["brake"], arrays["springs"] = self._body[:, gs.BRAKE].copy(), self._springs.copy()
        arrays["counters"] = np.array(
            [self.step_count, self.order_version, self._stale, self.list_version], dtype=np.int64
        )
        arrays["scalars"] = np.array([self.dt, self.skin, self._reach])
        return arrays

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into a DVI that was made with the same walls, bodies and contact.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies, or couples where this DVI has none, or none.
        """
        self._refuse_another_scene(state)
        if state["list_pair_impulse"].shape[1] != self._list.pair_impulse.shape[1]:
            raise ValueError(
                "of the state and this DVI, one has rolling or twisting friction and the other none; restore it into "
                "the scene that it came from"
            )
        for name in ("where", "motion", "mass", "particle_id"):
            setattr(self.grains, name, state[name].copy())
        moment, force = state.get("magnetic_moment"), state.get("external_force")
        self.grains.magnetic_moment = None if moment is None else moment.copy()
        self.external_force = None if force is None else force.copy()
        prefix = "list_"
        self._impulses = ImpulseList.from_arrays(
            {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}
        )
        for body, (angle, speed, torque) in zip(self.bodies, state["bodies"], strict=True):
            body.angle, body.speed, body.external_torque = float(angle), float(speed), float(torque)
        self._body[:, gs.BRAKE], self._springs = state["brake"], state["springs"].copy()
        self.step_count, self.order_version = (int(v) for v in state["counters"][:2])
        self._stale, self.list_version = bool(state["counters"][2]), int(state["counters"][3])
        self.dt, self.skin, self._reach = (float(v) for v in state["scalars"])
        self._soft = self._springs_of_step()
        self._make_room()

    def begin_with(self, state: dict[str, np.ndarray]) -> None:
        """Begin at time 0 with the grains of a `state` and the angles of its bodies; impulses are left behind.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies.
        """
        self._refuse_another_scene(state)
        for name in ("where", "motion", "mass", "particle_id"):
            setattr(self.grains, name, state[name].copy())
        self.grains.magnetic_moment = self.external_force = self._impulses = None
        for body, (angle, _, _) in zip(self.bodies, state["bodies"], strict=True):
            body.angle, body.external_torque = float(angle), 0.0
        self._body[:, gs.BRAKE], self.step_count = 0.0, 0
        self._rebuild()
        self._springs = np.array([self._pressed_in(), 0.0, 0.0, 0.0])

    # -- inside
    # ---------------------------------------------------------------------------------------------------

    def _refuse_another_scene(self, state: dict[str, np.ndarray]) -> None:
        if len(state["mass"]) != self.grains.count or len(state["bodies"]) != len(self.bodies):
            raise ValueError(
                f"the state has {len(state['mass'])} grains and {len(state['bodies'])} bodies, this DVI "
                f"{self.grains.count} and {len(self.bodies)}; restore it into the scene that it came from"
            )

    def _advance(
        self, n_steps: int, angle: np.ndarray, speed: np.ndarray, totals: np.ndarray, body_totals: np.ndarray
    ) -> tuple[int, int]:
        g, c = self.grains, self._list
        if not self.warm_start and self._open_step[0] < 0.0:
            n_steps = 1  # impulses are forgotten between calls
            c.pair_impulse[:], c.wall_impulse[:], self._body[:, gs.BRAKE] = 0.0, 0.0, 0.0
        given = self._arguments(n_steps, angle, speed, Totals(totals, body_totals, self._springs))
        with at_most(1 if self._share is None else len(self._share.pairs) // 2):
            answer = kernel.run_steps(*given)
        state = given.grains
        g.position[:], g.velocity[:], g.angular_velocity[:] = state.position, state.velocity, state.spin
        return answer

    def _arguments(self, n_steps: int, angle: np.ndarray, speed: np.ndarray, totals: Totals) -> StepArguments:
        g, c, device = self.grains, self._list, self._device
        external = np.zeros((0, 3))
        if self.external_force is not None:
            external = np.ascontiguousarray(self.external_force, dtype=float)
            if external.shape != (g.count, 3):
                raise ValueError(f"external_force has shape {external.shape}; it must be ({g.count}, 3)")
        position, velocity, spin = (np.ascontiguousarray(a) for a in (g.position, g.velocity, g.angular_velocity))
        times = (self.step_count + np.arange(n_steps)) * self.dt
        # the new velocities are those of the end of the step at theta = 1/2, and lag behind it at 1
        drives, constants = drives_at(self.bodies, times, times + 2.0 * (1.0 - self.theta) * self.dt)
        return StepArguments(
            Call(
                n_steps, self.dt, self.theta, 0.5 * self._reach, c.wall_way, self.overlap_limit, SLOP, MARGIN,
                self._law, Search(self._method, self._relax, self.tolerance, self.max_sweeps), self._open_step,
            ),
            self._convex,
            self._soft,
            GrainState(
                position, velocity, spin, np.ascontiguousarray(g.radius), g.mass, self._pull(n_steps), external,
                c.reference, self._bound,
            ),
            PairSlots(c.pairs.start, c.pairs.other, c.pair_impulse, self._pair_slot),
            WallSlots(c.wall_start, c.wall_other, c.wall_impulse, self._wall_slot, self._found, self._tally),
            WallState(device.rows, device.triangles, device.body, self._turn),
            Shafts(drives, constants, angle, speed, device.reach, c.angles, float(self.n_sectors)),
            Records(self._grain, self._body, self._pair_index, self._pair, self._wall_index, self._wall),
            self._couples,
            Partition(self._share, True if self._share is None else None),
            totals,
        )  # fmt: skip

    def _pull(self, n_steps: int) -> np.ndarray:
        """Gravity at the coming steps, (n_steps, 3) or (1, 3); (0, 3) without."""
        if self.gravity is None:
            return np.zeros((0, 3))
        if callable(self.gravity):
            times = (self.step_count + np.arange(n_steps)) * self.dt
            return np.ascontiguousarray(self.gravity(times), dtype=float).reshape(n_steps, 3)
        return np.array(self.gravity, dtype=float).reshape(1, 3)

    def _springs_of_step(self) -> np.ndarray | None:
        """The table of springs for the present step; None for rigid contacts."""
        return None if self._stiffness is None else spring_table(self.dt, self._stiffness, self._law[:, 1])

    def _records(self) -> Records:
        """Grains, bodies and contacts as the last step left them (`particles.dvi.gauss_seidel`), copied."""
        p, s = int(self._open_step[5]), int(self._open_step[6])
        views = (self._grain, self._body, self._pair_index[:p], self._pair[:p], self._wall_index[:s], self._wall[:s])
        return Records(*(array.copy() for array in views))

    def _improve(self) -> None:
        """Let the interior point work on the step that the kernel has left open."""
        p, s = int(self._open_step[0]), int(self._open_step[1])
        sweeps, self._open_step[3] = solve_by_interior_point(
            self._convex, self.tolerance, self._grain, self._body,
            self._pair_index[:p], self._pair[:p], self._wall_index[:s], self._wall[:s],
        )  # fmt: skip
        self._open_step[2] += sweeps

    def _make_room(self) -> None:
        """Records for as many contacts as the list has slots."""
        p, s = self._list.pairs.count, len(self._list.wall_other)
        self._pair_index, self._wall_index = np.zeros((p, 2), dtype=np.int32), np.zeros((s, 2), dtype=np.int32)
        self._pair_slot, self._wall_slot = np.zeros(p, dtype=np.int32), np.zeros(s, dtype=np.int32)
        memory = 0 if self._soft is None else gs.N_SPRING
        self._pair, self._wall = np.zeros((p, gs.N_PAIR + memory)), np.zeros((s, gs.N_WALL_CONTACT + memory))
        self._couples = no_couples()
        if self._resist.any():
            columns = N_COUPLE if self._soft is None else N_SPRING_COUPLE
            self._couples = Couples(self._resist, np.zeros((p, columns)), np.zeros((s, columns)))
        self._share = make_shares(
            self._list.pairs.start, self._list.pairs.other, self._list.wall_start,
            (len(self.bodies), books.N_BODY_SUMS), self._wall.shape[1],
        )  # fmt: skip
        triangles = s if len(self._device.triangles) else 0
        self._found, self._tally = np.zeros((triangles, N_FOUND)), np.zeros((triangles, 2), dtype=np.int64)

    def _rebuild(self) -> None:
        """Sort by cells, list the neighbours anew, and carry the impulses into it."""
        g = self.grains
        if self._encloses:
            self._refuse_escaped()
        old_id = g.particle_id
        order = cell_order(g.position, 2.0 * float(g.radius.max()) + self.skin)
        if np.any(order[1:] < order[:-1]):
            old_id = old_id.copy()
            g.permute(order)
            if self.external_force is not None:
                self.external_force = np.ascontiguousarray(self.external_force[order])
            self.order_version += 1
        # whatever the step may move must be in the list: fast grains need a thicker skin
        fastest = float(np.sqrt(np.max(np.sum(g.velocity**2, axis=1))))
        vane = max((abs(b.speed) * r for b, r in zip(self.bodies, self._device.reach, strict=True)), default=0.0)
        fastest = max(fastest, (1.0 + float(self._law[1, 1])) * vane)  # what it strikes
        self._reach = max(self.skin, FAST_SKIN * self.dt * fastest)
        made = ImpulseList.make(
            np.ascontiguousarray(g.position), g.radius, self._reach, self._device, [b.angle for b in self.bodies],
            max(0.5 * self.skin, FAST_WALLS * self.dt * vane), 6 if self._resist.any() else 3,
        )  # fmt: skip
        if self._impulses is not None:
            made.take_impulses(self._impulses, old_id, g.particle_id)
        self._impulses = made
        self._make_room()
        self.list_version += 1
        self._stale = False

    def _depths(self, row: np.ndarray, wall: np.ndarray) -> np.ndarray:
        """Overlap [m] and unit vector towards the wall, (s, 4), of grains ``row`` at walls or triangles ``wall``."""
        x, radius, device = self.grains.position, self.grains.radius, self._device
        depth = np.zeros((len(row), 4))
        smooth = wall < len(device.rows)
        depth[smooth] = wall_overlaps(x, radius, device.rows, row[smooth], wall[smooth])
        for k in np.flatnonzero(~smooth):
            angle = self.bodies[device.body[wall[k]]].angle
            cos, sin = np.cos(angle), np.sin(angle)
            to_world = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
            centre = x[row[k]] @ to_world
            away = to_world @ (np.array(closest_on_triangle(device.triangles, wall[k], *centre)) - centre)
            distance = float(np.linalg.norm(away))
            depth[k, 0] = radius[row[k]] - distance
            depth[k, 1:] = away / max(distance, np.finfo(float).tiny)
        return depth

    def _pressed_in(self) -> float:
        """Energy [J] that the normal springs hold at the start, where grains overlap each other or smooth walls."""
        if self._stiffness is None:
            return 0.0
        g, c = self.grains, self._list
        i, j = c.pairs.rows(), c.pairs.other
        pairs = g.radius[i] + g.radius[j] - np.linalg.norm(g.position[j] - g.position[i], axis=1)
        row, wall = c.wall_rows(), c.wall_other.astype(np.int64)
        smooth = wall < len(self._device.rows)
        walls = self._depths(row[smooth], wall[smooth])[:, 0]
        by_kind = zip(self._stiffness[:, 0], (pairs, walls), strict=True)
        return float(sum(0.5 * k * np.sum(depth[depth > 0.0] ** 2) for k, depth in by_kind))

    def _refuse_escaped(self) -> None:
        g = self.grains
        gone = np.flatnonzero(outside(g.position, self.walls, float(g.radius.max())))
        if len(gone):
            k = gone[0]
            raise DemError(
                DemErrorKind.ESCAPED,
                f"it has left the device ({len(gone)} grains have)",
                f"the walls may have a slot; or shorten dt = {self.dt:.3g} s",
                g.particle_id[k], g.position[k], self.time,
            )  # fmt: skip

    def _refuse_shot_off(self, fastest: float) -> None:
        """A solution that missed its tolerance by far may shoot a grain out of the device within a step."""
        g = self.grains
        if fastest * self.dt <= SHOT_OFF * float(g.radius.min()):
            return
        k = int(np.argmax(np.sum(g.velocity**2, axis=1)))
        raise DemError(
            DemErrorKind.TOO_FAST,
            f"it was shot off at {fastest:.3g} m/s, {0.5 * fastest * self.dt / g.radius[k]:.3g} diameters in a step, "
            f"by contacts whose impulses did not converge to {self.tolerance:.3g} m/s",
            f"rigid grains jammed between walls that push have no finite forces: shorten dt = {self.dt:.3g} s, allow "
            "more sweeps, leave more clearance, or use DEM",
            g.particle_id[k], g.position[k], self.time,
        )  # fmt: skip

    def _explain(self, answer: int, totals: np.ndarray) -> None:
        g = self.grains
        if answer == kernel.OVERLAP:
            k = int(totals[kernel.GRAIN])
            raise DemError(
                DemErrorKind.OVERLAP,
                f"it overlaps a neighbour or a wall by {100.0 * totals[kernel.MAX_OVERLAP]:.3g} % of the "
                f"diameter (the limit is {100.0 * self.overlap_limit:.3g} %)",
                f"shorten dt = {self.dt:.3g} s, or tighten the tolerance of {self.tolerance:.3g} m/s",
                g.particle_id[k], g.position[k], self.time,
            )  # fmt: skip
        state = np.concatenate([g.position, g.velocity, g.angular_velocity], axis=1)
        bad = np.flatnonzero(~np.isfinite(state).all(axis=1))
        if len(bad) == 0:
            raise ParticleError(f"t = {self.time:.6g} s: the speed of a shaft is not a finite number")
        raise DemError(
            DemErrorKind.NOT_FINITE,
            "its position or velocity is not a finite number", "check the external forces",
            g.particle_id[bad[0]], g.position[bad[0]], self.time,
        )  # fmt: skip

    def _summary(
        self, steps: int, totals: np.ndarray, bodies: np.ndarray, kinetic: float, elastic: float, rebuilds: int
    ) -> RigidTotals:
        share = 1.0 / max(steps, 1)
        names = [body.name for body in self.bodies]
        now = self.grains.kinetic_energy()
        normal = bodies[:, books.NORMAL_X : books.NORMAL_Z + 1] * share
        whole = bodies[:, books.FORCE_X : books.FORCE_Z + 1] * share
        return RigidTotals(
            steps=steps,
            duration=steps * self.dt,
            torque={
                name: {
                    "normal": float(t[books.TORQUE_N]) * share,
                    "damping": 0.0,
                    "tangential": float(t[books.TORQUE_T]) * share,
                }
                for name, t in zip(names, bodies, strict=True)
            },
            force=dict(zip(names, whole, strict=True)),
            force_parts={
                name: {"normal": n, "damping": np.zeros(3), "tangential": f - n}
                for name, n, f in zip(names, normal, whole, strict=True)
            },
            shaft_work={
                body.name: {
                    "drive": float(t[kernel.DRIVE_WORK]),
                    "load": float(t[kernel.LOAD_WORK]),
                    "contact": -float(t[books.BODY_WORK]),
                }
                for body, t in zip(self.bodies, bodies, strict=True)
                if body.is_free
            },
            energy=EnergyTotals(
                wall_work={name: float(t[books.BODY_WORK]) for name, t in zip(names, bodies, strict=True)},
                dissipation={
                    "impact": float(totals[books.IMPACT]),
                    "sliding": float(totals[books.SLIDING]),
                    **({"rolling": float(totals[kernel.ROLLING])} if self._resist[:, 0].any() else {}),
                    **({"twisting": float(totals[kernel.TWISTING])} if self._resist[:, 1].any() else {}),
                },
                contact_work=float(totals[kernel.CONTACT_WORK]),
                gravity_work=float(totals[books.GRAVITY_WORK]),
                external_work=float(totals[books.EXTERNAL_WORK]),
                kinetic_energy=now,
                kinetic_change=now - kinetic,
                elastic_energy=float(self._springs.sum()),
                elastic_change=float(self._springs.sum()) - elastic,
            ),
            max_overlap=float(totals[kernel.MAX_OVERLAP]),
            n_contacts=int(totals[books.CONTACTS]),
            max_speed=float(totals[books.MAX_SPEED]),
            rebuilds=rebuilds,
            sweeps=int(totals[kernel.SWEEPS]),
            max_sweeps=int(totals[kernel.MAX_SWEEPS]),
            visits=int(totals[kernel.VISITS]),
            residual=float(totals[kernel.RESIDUAL]),
            missed_steps=int(totals[kernel.MISSED]),
            taken_over=int(totals[kernel.TAKEN_OVER]),
            warm_hits=float(totals[books.KEPT] / max(totals[books.LOADED], 1.0)),
            projections=int(totals[kernel.PROJECTIONS]),
            stabilisation_work=float(totals[kernel.STABILISATION]),
        )
