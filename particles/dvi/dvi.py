"""DVI: grains whose contacts are solved implicitly; the loop around the compiled step of `particles.dvi.step_kernel`.

A differential variational inequality: contacts are rigid, or compliant on springs that a step need not resolve.

**Lagged forces** (`DVI.external_force`) are explicit: constant during a step. The stiffest of them is the pull of the
necks between magnetised grains, which changes within a few hundredths of a radius. That is a negative stiffness,
which makes grains snap together and rings at no step; below the smallest gap, where contacts are closed, the pull is
constant, and a closed contact has no motion that could change it. Stability does not limit the step; the accuracy of
the neck force does. The pull is its mean over the change of the gap at the present velocities, computed in the step
(`particles.dvi.near_pulls`), or with the moments where these are computed at every step (`coupling.effects.dipoles`).
In the default step it adds little to the speeds at which grains separate (`particles.dvi.dvi_step`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.kernels.simd import LANES
from geometry.walls import Wall
from particles import run_errors
from particles.bodies import Body
from particles.dem import box_kernel
from particles.dem.overlap_limits import STOPS
from particles.dvi import end_of_step, flow_in_box
from particles.dvi import gauss_seidel as gs
from particles.dvi import step_kernel as kernel
from particles.dvi.accelerated import ANDERSON, GAUSS_SEIDEL
from particles.dvi.compliance import spring_table
from particles.dvi.contact_groups import N_GROUP
from particles.dvi.contact_torques import N_SPRING_TORQUE, N_TORQUE, no_contact_torques
from particles.dvi.dvi_contact import DviContact
from particles.dvi.dvi_totals import DviTotals, dvi_box_stress, dvi_totals, rigid_energy_budget, shear_work
from particles.dvi.impulse_list import ImpulseList
from particles.dvi.loaded_contacts import loaded_contacts, net_impulses, normal_spring_energy
from particles.dvi.near_pulls import near_pulls
from particles.dvi.solver_state import (
    DviArguments,
    DviCall,
    DviGrains,
    DviSums,
    DviWalls,
    PairImpulses,
    SolverContacts,
    SolverSettings,
    SweepThreads,
    Torques,
    WallImpulses,
)
from particles.dvi.sweep_chunks import make_sweep_chunks
from particles.dvi.triangle_contacts import N_TURN
from particles.grain_motion import GrainMotion, Gravity, gravity_at, lagged_force
from particles.grains import Grains
from particles.laws.cohesion import Cohesion
from particles.laws.rolling_friction import RollingFriction
from particles.laws.twisting_friction import TwistingFriction
from particles.neighbours.contact_table import ContactTable
from particles.neighbours.neighbour_list import cell_order
from particles.periodicity import Periodicity, images_of
from particles.shafts import Shafts, drives_at
from particles.step_status import NOT_FINITE, OVERLAP
from particles.threads import at_most
from particles.walls.triangle_kernels import N_CONTACT

STEPS_PER_CALL = 512  # bounds the table of prescribed speeds
# grains may reach beyond the gap that their own speeds close, when others push them: this fraction of the fastest one's
# way is added
MARGIN = 0.25
FAST_SKIN = 4.0  # skin, in ways of the fastest grain in a step: a step from the list and the next, for two grains
MIN_SKIN = 3.0 + MARGIN  # the same where space is too narrow for more: a step and the drift before it, a list each
FAST_WALLS = 4.0  # the same for triangles, in ways of their fastest point: three steps from the list and the next
USUAL_SKIN = 0.8  # of the mean radius
SLOP = 1e-4  # overlap, as a fraction of the radius, below which positions are left alone


class DVI(GrainMotion):
    """Grains moving between walls, their contacts rigid or on implicit springs.

    Parameters
    ----------
    grains : Grains
        Taken over: its arrays are replaced, sorted and advanced.
    walls, bodies
        Walls refer to bodies by name.
    contact : DviContact
        Friction and restitution of every contact.
    dt : float
        Step [s].
    gravity : array_like, shape (3,), or callable, optional
        Acceleration [m/s^2]; a callable takes times (k,) [s] and returns (k, 3).
    periodicity : Periodicity, optional
        Simulate one copy of a space that repeats: one wedge of the ring, a sheared box. A box is taken over, its strain
        is advanced; it has neither walls nor gravity (`particles.dvi.flow_in_box`).
    theta : float
        Weight of the new velocity in the drift, 1/2 to 1; at 1 velocities lag by half a step, as in `DEM`.
    friction_cone : "coulomb" or "convex"
        Exact Coulomb, or the convex relaxation that Project Chrono solves.
    solver : "gauss_seidel" or "accelerated"
        Sweeps alone; accelerated sweeps after the first.
    tolerance : float
        On the natural map [m/s].
    max_sweeps : int
        Sweeps a step.
    skin : float, optional
        Of the Verlet list [m]; 0.4 of the mean diameter by default.
    overlap_limit : float
        Overlap, as a fraction of the diameter, at which the run is stopped.
    stiffness : array_like, shape (2, 2), optional
        [[k_n, k_t] between grains, [k_n, k_t] at walls] [N/m] of compliant contacts (`particles.dvi.compliance`);
        rigid ones without.
    rolling, twisting : optional
        Resistance to rolling and to twisting (`particles.dvi.contact_torques`).
    cohesion : Cohesion, optional
        Pull of contacts (`particles.dvi.adhesion`).

    Attributes
    ----------
    external_force, attraction, time, step_count, order_version, list_version
        As in `DEM`; an attraction is its mean over the way that a gap goes in a step (`particles.dvi.near_pulls`).
    """

    def __init__(
        self,
        grains: Grains,
        walls: Sequence[Wall],
        bodies: Sequence[Body],
        contact: DviContact,
        *,
        dt: float,
        gravity: Gravity | None = None,
        periodicity: Periodicity | None = None,
        theta: float = 1.0,
        friction_cone: str = "coulomb",
        solver: str = "accelerated",
        tolerance: float = 1e-6,
        max_sweeps: int = 10_000,
        skin: float | None = None,
        overlap_limit: float = STOPS,
        stiffness: np.ndarray | None = None,
        rolling: RollingFriction | None = None,
        twisting: TwistingFriction | None = None,
        cohesion: Cohesion | None = None,
    ) -> None:
        if not 0.0 < dt < np.inf:
            raise ValueError(f"dt = {dt:g} s; allowed: more than 0")
        if not 0.5 <= theta <= 1.0:
            raise ValueError(f"theta = {theta:g}; allowed: 1/2 to 1")
        if not 0.0 < tolerance < np.inf:
            raise ValueError(f"tolerance = {tolerance:g} m/s; allowed: more than 0")
        for name, value, allowed in (
            ("friction_cone", friction_cone, ("coulomb", "convex")),
            ("solver", solver, ("gauss_seidel", "accelerated")),
        ):
            if value not in allowed:
                raise ValueError(f"{name} = {value!r}; allowed: {', '.join(allowed)}")
        super().__init__(
            grains, walls, bodies, dt=dt, gravity=gravity, periodicity=periodicity,
            skin=USUAL_SKIN * float(np.mean(grains.radius)) if skin is None else skin, overlap_limit=overlap_limit,
        )  # fmt: skip
        self.contact, self.theta = contact, float(theta)
        self.tolerance, self.max_sweeps = float(tolerance), int(max_sweeps)
        self.energy_budget = True  # the energy budget is a by-product here
        self._resist = np.zeros((2, 2))  # mu_r and mu_w between grains, at walls
        for column, part in enumerate((rolling, twisting)):
            if part is not None:
                self._resist[:, column] = part.table()
        self._cohesion = np.zeros((2, 2)) if cohesion is None else cohesion.table()
        self._law, self._n_contacts = np.hstack([contact.table(), self._cohesion]), np.zeros(2, dtype=np.int64)
        self._columns = 6 if self._resist.any() else 3  # of a contact's impulse
        self._pull = self._columns if self._cohesion.any() else 0
        self._columns += 3 if self._pull else 0
        self._stiffness = None if stiffness is None else np.array(stiffness, dtype=float)
        self._compliance = self._springs_of_step()
        self._springs = np.zeros(4)  # energy [J]: normal, tangential, of rolling, of twisting
        self._convex = None if friction_cone == "coulomb" else True  # None is a type of its own: the kernel without it
        self._method = ANDERSON if solver == "accelerated" else GAUSS_SEIDEL
        self._turn = np.zeros((len(self.bodies) if len(self._device.triangles) else 0, N_TURN))
        n = grains.count
        self._grain, self._bound = np.zeros((n, gs.N_GRAIN)), np.zeros(n)
        self._membership = np.zeros((n, 2), dtype=np.int64)
        self._body = np.zeros((len(self.bodies), gs.N_BODY))
        self._contact_torques = no_contact_torques()
        self._reach = self.skin
        self._impulses: ImpulseList | None = None
        self._rebuild()
        self._springs[0] = self._elastic = self._normal_spring_energy()

    @property
    def list_skin(self) -> float:
        """Reach of the present list beyond touching [m]: more than `skin` where grains are fast."""
        return self._reach

    @property
    def contact_force(self) -> np.ndarray:
        """Sum of the contact forces on each grain, mean over the last step [N], shape (n, 3)."""
        return net_impulses(self._list, self.periodicity, self._pull) / self.dt

    @property
    def _list(self) -> ImpulseList:
        assert self._impulses is not None
        return self._impulses

    def run(self, n_steps: int) -> DviTotals:
        """Advance by ``n_steps`` steps.

        Raises
        ------
        DemError
            For overlap beyond the limit, a number that is not finite, a grain outside the device.
        """
        totals = np.zeros(end_of_step.N_SUMS)
        totals[kernel.GRAIN] = -1.0
        body_totals = np.zeros((len(self.bodies), end_of_step.N_BODY_SUMS))
        sums = DviSums(totals, body_totals, self._springs, np.zeros(0 if self.box is None else flow_in_box.N_BOX_SUMS))
        kinetic, elastic = self._kinetic_now(), self._elastic

        def call(left: int, angle: np.ndarray, speed: np.ndarray) -> tuple[int, int]:
            return self._advance(min(left, STEPS_PER_CALL), angle, speed, sums)

        rebuilds = self._march(n_steps, totals, call)
        self._elastic = float(self._springs.sum())
        stress = None if self.box is None else dvi_box_stress(max(n_steps, 1) * self.dt, self.box, sums.box)
        work = {} if self.box is None else shear_work(self.box, sums.box)
        energy = rigid_energy_budget(
            self.n_sectors, self.bodies, totals, body_totals, self._resist,
            (kinetic, self._kinetic_now()), (elastic, self._elastic), work,
        )  # fmt: skip
        return dvi_totals(n_steps, self.dt, self.n_sectors, self.bodies, totals, body_totals, energy, rebuilds, stress)

    def stretch(self, factor: float) -> None:
        """See `GrainMotion.stretch`; the added energy of the springs is part of the next run's elastic change."""
        before = self._normal_spring_energy()
        super().stretch(factor)
        self._springs[0] += self._normal_spring_energy() - before

    def _raise_stopped(self, status: int, totals: np.ndarray) -> None:
        g, dt = self.grains, self.dt
        if status == OVERLAP:
            remedy = f"shorten dt = {dt:.3g} s, or tighten the tolerance of {self.tolerance:.3g} m/s"
            row, overlap = int(totals[end_of_step.GRAIN]), totals[end_of_step.MAX_OVERLAP]
            raise run_errors.too_deep(g, row, overlap, self.overlap_limit, self.time, remedy)
        if status == NOT_FINITE:
            raise run_errors.not_finite(g, self.time, "check the external forces")
        run_errors.refuse_shot_off(
            totals[end_of_step.MAX_SPEED], g, self._peculiar_velocity, dt, self.tolerance, self.time
        )

    def contacts(self) -> ContactTable:
        """The loaded contacts of the last step."""
        g, c = self.grains, self._list
        return loaded_contacts(g, c, self._device, self.bodies, self.periodicity, self._pull, self.dt)

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to continue bit for bit."""
        arrays = super().state()
        arrays["brake"], arrays["springs"] = self._body[:, gs.BRAKE].copy(), self._springs.copy()
        arrays["scalars"], arrays["elastic"] = np.array([self.dt, self.skin, self._reach]), np.array(self._elastic)
        return arrays

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into a DVI that was made with the same walls, bodies and contact.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies, or torques or pulls where this DVI has none, or none.
        """
        if state["list_pair_impulse"].shape[1] != self._columns:
            raise ValueError(
                "of the state and this DVI, one has rolling or twisting friction, or cohesion, and the other none; "
                "restore it into the scene that it came from"
            )
        super().restore(state)
        self._body[:, gs.BRAKE], self._springs = state["brake"], state["springs"].copy()
        self.dt, self.skin, self._reach = (float(v) for v in state["scalars"])
        self._elastic = float(state.get("elastic", self._springs.sum()))
        self._compliance = self._springs_of_step()
        self._make_room()

    def _restore_list(self, arrays: dict[str, np.ndarray]) -> None:
        self._impulses = ImpulseList.from_arrays(arrays)

    def begin_with(self, state: dict[str, np.ndarray]) -> None:
        """Begin at time 0 with the grains of a `state` and the angles of its bodies; impulses are left behind.

        Of a sheared box the shear rate stays this DVI's, edges and offset are the state's, its strain begins at 0;
        peculiar velocities are kept.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies.
        """
        self._restore_grains(state)
        self.attraction = None
        self.grains.magnetic_moment = self.grains.dipole = self.external_force = self._impulses = None
        for body, (angle, _, _) in zip(self.bodies, state["bodies"], strict=True):
            body.angle, body.external_torque = float(angle), 0.0
        self._body[:, gs.BRAKE], self.step_count = 0.0, 0
        if self.box is not None:
            rate, z = self.box.rate, self.grains.position[:, 2]
            self.box.restore(state)
            self.grains.velocity -= self.box.flow(z)
            self.box.rate, self.box.strain = rate, 0.0
            self.grains.velocity += self.box.flow(z)
        self._rebuild()
        self._elastic = self._normal_spring_energy()
        self._springs = np.array([self._elastic, 0.0, 0.0, 0.0])

    def _advance(self, n_steps: int, angle: np.ndarray, speed: np.ndarray, sums: DviSums) -> tuple[int, int]:
        g = self.grains
        if self.attraction is not None:  # first: it may set the lagged force
            self.attraction.fetch(self)
        arguments = self._arguments(n_steps, angle, speed, sums)
        with at_most(1 if self._chunks is None else len(self._chunks.pairs) // 2):
            status = kernel.run_steps(*arguments)
        state = arguments.grains
        g.position[:], g.velocity[:], g.angular_velocity[:] = state.position, state.velocity, state.spin
        if self.box is not None:
            self.box.strain = float(state.flow[box_kernel.STRAIN])
            self.box.offset = float(state.flow[box_kernel.OFFSET])
        return status

    def _arguments(self, n_steps: int, angle: np.ndarray, speed: np.ndarray, totals: DviSums) -> DviArguments:
        g, c, device = self.grains, self._list, self._device
        external, images = lagged_force(self.external_force, g.count), images_of(self.periodicity)
        near = near_pulls(self.attraction, external if len(external) else np.zeros((g.count, 3)))
        external = np.empty_like(near.lagged) if len(near.lagged) else external
        position, velocity, spin = (np.ascontiguousarray(a) for a in (g.position, g.velocity, g.angular_velocity))
        flow = np.zeros(0) if self.box is None else box_kernel.flow_of(self.box, self._reach, self._interaction)
        times = (self.step_count + np.arange(n_steps)) * self.dt
        # the new velocities are those of the end of the step at theta = 1/2, and lag behind it at 1
        drives, constants = drives_at(self.bodies, times, times + 2.0 * (1.0 - self.theta) * self.dt)
        return DviArguments(
            DviCall(
                n_steps, self.dt, self.theta, 0.5 * self._reach, c.wall_travel, self.overlap_limit, SLOP, MARGIN,
                self._law, self._pull, SolverSettings(self._method, self.tolerance, self.max_sweeps), self._n_contacts,
            ),
            self._convex,
            self._compliance,
            DviGrains(
                position, velocity, spin, np.ascontiguousarray(g.radius), g.mass,
                gravity_at(self.gravity, times), external, c.reference, self._bound, flow,
            ),
            near,
            PairImpulses(c.pairs.start, c.pairs.other, c.pair_impulse, self._pair_slot, c.pairs.shift, images),
            WallImpulses(c.wall_start, c.wall_other, c.wall_impulse, self._wall_slot, self._triangle_contact,
                         self._tally),
            DviWalls(device.rows, device.triangles, device.body, self._turn),
            Shafts(drives, constants, angle, speed, device.reach, c.angles, float(self.n_sectors)),
            SolverContacts(self._grain, self._body, self._pair_index, self._pair, self._wall_index, self._wall,
                           self._pair_group, self._wall_group, self._membership, self._pair_shift, images),
            self._contact_torques,
            SweepThreads(self._chunks, True if self._chunks is None else None),
            totals,
        )  # fmt: skip

    def _springs_of_step(self) -> np.ndarray | None:
        """The table of springs for the present step; None for rigid contacts."""
        return None if self._stiffness is None else spring_table(self.dt, self._stiffness, self._law[:, 1])

    def _records(self) -> tuple[np.ndarray, ...]:
        """Grains, bodies and contacts as the last step left them (`particles.dvi.gauss_seidel`), copied."""
        p, s = self._n_contacts
        views = (self._grain, self._body, self._pair_index[:p], self._pair[:p], self._wall_index[:s], self._wall[:s])
        return tuple(array.copy() for array in views)

    def _make_room(self) -> None:
        """Records for as many contacts as the list has slots."""
        p, s = self._list.pairs.count, len(self._list.wall_other)
        self._pair_index, self._wall_index = np.zeros((p, 2), dtype=np.int32), np.zeros((s, 2), dtype=np.int32)
        self._pair_slot, self._wall_slot = np.zeros(p, dtype=np.int32), np.zeros(s, dtype=np.int32)
        self._pair_shift = np.zeros(p, dtype=np.int8)
        memory = 0 if self._compliance is None else gs.N_SPRING
        self._pair, self._wall = np.zeros((p, gs.N_PAIR + memory)), np.zeros((s, gs.N_WALL_CONTACT + memory))
        self._pair_group, self._wall_group = (np.empty((k, N_GROUP, LANES), dtype=np.int32) for k in (p, s))
        self._contact_torques = no_contact_torques()
        if self._resist.any():
            columns = N_TORQUE if self._compliance is None else N_SPRING_TORQUE
            self._contact_torques = Torques(self._resist, np.zeros((p, columns)), np.zeros((s, columns)))
        self._chunks = make_sweep_chunks(
            self._list.pairs.start, self._list.pairs.other, self._list.wall_start,
            (len(self.bodies), end_of_step.N_BODY_SUMS), self._wall.shape[1],
        )  # fmt: skip
        triangles = s if len(self._device.triangles) else 0
        self._triangle_contact, self._tally = np.zeros((triangles, N_CONTACT)), np.zeros((triangles, 2), dtype=np.int64)

    def _rebuild(self) -> None:
        """Wrap, sort by cells, list the neighbours again, and carry the impulses into it."""
        g = self.grains
        self._refuse_escaped(float(g.radius.max()), f"the walls may have a slot; or shorten dt = {self.dt:.3g} s")
        # whatever the step may move must be in the list: fast grains need a thicker skin. An error leaves all as it was
        fastest = float(np.sqrt(np.max(np.sum(self._peculiar_velocity**2, axis=1))))
        if self.box is not None:
            fastest += abs(self.box.rate) * float(g.radius.max())
        vane = max((abs(b.speed) * r for b, r in zip(self.bodies, self._device.reach, strict=True)), default=0.0)
        fastest = max(fastest, (1.0 + float(self._law[1, 1])) * vane)  # what it strikes
        self._reach = max(self.skin, FAST_SKIN * self.dt * fastest)
        if self.periodicity is not None:  # a narrow copy of space: lists that last for one step
            widest = self.periodicity.widest_cutoff(g.position) - self._interaction
            if MIN_SKIN * self.dt * fastest > widest > 0.0:
                limit = float(f"{widest / (MIN_SKIN * g.radius.min()):.3g}")
                raise run_errors.too_fast(g, self._peculiar_velocity, self.dt, limit, self.time)
            self._reach = min(self._reach, widest) if widest > 0.0 else self._reach  # else it is refused as too narrow
        wraps = None if self.periodicity is None else self._wrap(self.periodicity)
        order = cell_order(g.position_radius, 2.0 * float(g.radius.max()) + self.skin)
        if np.any(order[1:] < order[:-1]):
            self._sort(order)
        memory = None if self._impulses is None else self._impulses.memory()
        self._impulses = None  # its memory is free before the new list is made
        self._impulses = ImpulseList.make(
            np.ascontiguousarray(g.position), *self._reaches(self._reach), self._device, [b.angle for b in self.bodies],
            max(0.5 * self.skin, FAST_WALLS * self.dt * vane), self.periodicity, self._columns,
        )  # fmt: skip
        if memory is not None:
            self._impulses.transfer(memory, order, wraps, self.sector)
        self._make_room()
        self._note_list()

    @property
    def _interaction(self) -> float:
        return self._reaches(0.0)[1]

    def _kinetic_now(self) -> float:
        """Kinetic energy [J] of the present velocities, less the flow's of a sheared box."""
        if self.box is None:
            return self.grains.kinetic_energy()
        g, peculiar = self.grains, self._peculiar_velocity
        return 0.5 * float(
            g.mass @ np.einsum("ij,ij->i", peculiar, peculiar)
            + g.inertia @ np.einsum("ij,ij->i", g.angular_velocity, g.angular_velocity)
        )

    def _normal_spring_energy(self) -> float:
        return normal_spring_energy(
            self._stiffness, self.grains, self._list, self._device, self.bodies, self.periodicity, self._cohesion
        )
