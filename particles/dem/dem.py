"""Discrete element method: grains, walls on turning bodies, contact laws; the loop around the compiled step.

The step itself is `particles.dem.step_kernel`; grains, lists and checkpoints are `particles.dem.listed_grains`. Sums
become `StepTotals` in `particles.dem.run_summary`, and what went wrong is explained in `particles.run_errors`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np

from geometry.walls import Wall
from particles import run_errors
from particles.attraction import PREFIX as ATTRACTION
from particles.bodies import Body
from particles.dem import box_kernel, run_summary, total_columns
from particles.dem import step_kernel as kernel
from particles.dem.contact_columns import contact_columns
from particles.dem.kernel_state import (
    Call,
    GrainState,
    PairSlots,
    StepArguments,
    Totals,
    WallSlots,
    WallState,
)
from particles.dem.listed_grains import ListedGrains
from particles.dem.overlap_limits import STOPS
from particles.dem.pair_search import pair_scratch
from particles.dem.step_tables import StepTables
from particles.dem.stored_energy import elastic_energy_at_rest, scene_law_table
from particles.dem.time_step import choose_time_step
from particles.dem.wall_contacts import wall_scratch
from particles.grain_motion import Gravity, lagged_force
from particles.grains import MOMENTS, Grains
from particles.laws.cohesion import Cohesion
from particles.laws.contact_law import ContactLaw
from particles.laws.pair_table import PairLaws, species_of, wall_rows
from particles.laws.rolling_friction import RollingFriction
from particles.laws.twisting_friction import TwistingFriction
from particles.neighbours.contact_list import ContactList
from particles.neighbours.contact_table import ContactTable, contact_table, geometric_overlaps
from particles.periodicity import Periodicity
from particles.shafts import Shafts
from particles.step_status import NOT_FINITE, OVERLAP, TOO_FAST
from particles.step_totals import StepTotals
from particles.threads import threads_for

STEPS_PER_CALL = 512  # bounds the tables in time (speeds, torques, gravity)
WALL_SKIN = 0.5  # of the skin: how far triangles may turn before the list is rebuilt

FASTEST = 1.0  # radii of the smallest grain in a step: beyond it a grain may pass through another


class DEM(ListedGrains):
    """Grains moving between walls.

    Parameters
    ----------
    grains : Grains
        Taken over: its arrays are replaced, sorted and advanced.
    walls, bodies
        Walls refer to bodies by name.
    contact : ContactLaw or PairLaws
        The law of every contact, or a law for each pair of materials.
    dt : float
        Step [s]; `particles.dem.time_step.choose_time_step` proposes one.
    gravity : array_like, shape (3,), or callable, optional
        Acceleration [m/s^2]; a callable takes times (k,) [s] and returns (k, 3). None leaves it out of the compiled
        step.
    periodicity : Periodicity, optional
        Simulate one copy of a space that repeats: one wedge of the ring, a sheared box, a gap. A box is taken over, its
        strain is advanced; it has neither walls nor gravity.
    rolling, twisting, cohesion : optional
        Resistance to rolling and to twisting, and pull, with a single law (`PairLaws` has its own); None leaves each
        out of the compiled step.
    species : ndarray of int, shape (n,), optional
        Material of each grain, a row of ``PairLaws.pair``.
    wall_material : sequence of int, optional
        Material of each wall, a column of ``PairLaws.wall``; 0 by default.
    skin : float, optional
        Of the Verlet list [m]; by default it starts at a quarter of the mean diameter and follows what is cheapest.
    overlap_limit : float
        Overlap, as a fraction of the diameter, at which the run is stopped.
    energy_budget : bool
        Keep the energy budget; without it a step is about a fifth cheaper.

    Attributes
    ----------
    external_force : ndarray, shape (n, 3), or None
        Force on each grain [N] in the present order, constant until it is set again (lagged); sorted with the
        grains.
    attraction : Attraction or None
        Pull of near grains and walls from the gap of every step, its drive lagged (`particles.attraction`); None
        leaves it out of the compiled step.
    time, step_count, order_version, list_version
        Time [s] of the positions, steps done, how often the grains have been put in another order, and how
        often the neighbour list was made (between two of them no grain moves by more than half the skin or
        wraps).

    Raises
    ------
    ValueError
        For a step too long for the contact, an unknown body, a copy of space too narrow for its lists.
    DemError
        During `run`: overlap beyond the limit, a number that is not finite, a grain outside the device.
    """

    def __init__(
        self,
        grains: Grains,
        walls: Sequence[Wall],
        bodies: Sequence[Body],
        contact: ContactLaw | PairLaws,
        *,
        dt: float,
        gravity: Gravity | None = None,
        periodicity: Periodicity | None = None,
        rolling: RollingFriction | None = None,
        twisting: TwistingFriction | None = None,
        cohesion: Cohesion | None = None,
        species: np.ndarray | None = None,
        wall_material: Sequence[int] | None = None,
        skin: float | None = None,
        overlap_limit: float = STOPS,
        energy_budget: bool = True,
    ) -> None:
        if isinstance(contact, PairLaws):
            if (rolling, twisting, cohesion) != (None, None, None):
                raise ValueError("rolling, twisting and cohesion conflict with PairLaws; give them to PairLaws")
            laws = contact
        else:
            laws = PairLaws.of_one(contact, rolling=rolling, twisting=twisting, cohesion=cohesion)
        choose_time_step(laws, grains.mass, grains.radius, dt=dt)
        grain_species = species_of(laws, grains.count, species)
        self._table = scene_law_table(laws, grains, one_species=grain_species is None)
        columns = contact_columns(laws.rows, self._table, energy_budget)
        super().__init__(
            grains, walls, bodies, columns, dt=dt, gravity=gravity, periodicity=periodicity, skin=skin,
            overlap_limit=overlap_limit, species=grain_species,
        )  # fmt: skip
        self.laws, self.energy_budget = laws, energy_budget
        self._wall_row = wall_rows(laws, len(self.walls), wall_material, self._device.wall)
        angle = None if self.sector is None else self.sector.angle
        self._turn = None if angle is None else np.array([np.cos(angle), np.sin(angle)])
        self._box_later = np.zeros(box_kernel.N_BOX_SUMS - box_kernel.LAST_CONTACT)
        self._later = np.zeros(3)
        self._last_torque = np.zeros(len(self.bodies))
        self._elastic = self._elastic_energy_at_rest() if energy_budget else 0.0
        self._kinetic = self._kinetic_now() if energy_budget else 0.0

    @property
    def contact(self) -> ContactLaw:
        """The law between grains (of the first species)."""
        return self.laws.laws[int(self.laws.pair[0, 0])]

    @property
    def _fastest(self) -> float:
        """Peculiar speed [m/s] from which on the run stops."""
        return FASTEST * float(np.min(self.grains.radius)) / self.dt

    def run(self, n_steps: int) -> StepTotals:
        """Advance by ``n_steps`` steps.

        Raises
        ------
        DemError
            See the class.
        """
        totals = np.zeros(total_columns.N_SUMS)
        totals[total_columns.CONTACT_LATER : total_columns.CONTACT_LATER + 3] = self._later
        body_totals = np.zeros((len(self.bodies), total_columns.N_BODY_SUMS))
        body_totals[:, total_columns.LAST_TORQUE] = self._last_torque
        sums = None
        if self.box is not None:
            sums = np.zeros(box_kernel.N_BOX_SUMS)
            sums[box_kernel.LAST_CONTACT :] = self._box_later
        elastic, kinetic, last = self._elastic, self._kinetic, self.step_count + n_steps
        tables: StepTables | None = None

        def call(left: int, angle: np.ndarray, speed: np.ndarray) -> tuple[int, int]:
            nonlocal tables
            if self.attraction is not None:  # first: it may set the lagged force
                self.attraction.fetch(self)
            if tables is None or tables.end == self.step_count:
                tables = self._step_tables(min(left, STEPS_PER_CALL))
            batch = tables.end - self.step_count
            arguments = self._arguments(batch, tables.end == last, angle, speed, totals, body_totals, sums, tables)
            status = kernel.run_steps(*arguments)
            flow = arguments.grains.flow
            if self.box is not None and flow is not None:
                self.box.strain, self.box.offset = float(flow[box_kernel.STRAIN]), float(flow[box_kernel.OFFSET])
            return status

        with threads_for(self.grains.count):
            rebuilds = self._march(n_steps, totals, call)
        self._later = totals[total_columns.CONTACT_LATER : total_columns.CONTACT_LATER + 3].copy()
        self._last_torque = body_totals[:, total_columns.LAST_TORQUE].copy()
        energy, ring, stress = None, self.n_sectors, None
        if self.box is not None and sums is not None:
            self._box_later = sums[box_kernel.LAST_CONTACT :].copy()
            stress = run_summary.dem_box_stress(n_steps, self.box, sums)
        if self.energy_budget:
            if n_steps > 0:
                self._elastic = float(totals[total_columns.ELASTIC])
                self._kinetic = float(totals[total_columns.KINETIC])
            energy = run_summary.energy_budget(
                ring, self.bodies, totals, body_totals, self._columns,
                (kinetic, self._kinetic), (elastic, self._elastic), sums,
            )  # fmt: skip
        return run_summary.summary(n_steps, self.dt, ring, self.bodies, totals, body_totals, energy, rebuilds, stress)

    def _raise_stopped(self, status: int, totals: np.ndarray) -> None:
        g, dt = self.grains, self.dt
        if status == OVERLAP:
            remedy = f"raise the stiffness, too soft for the load, or shorten dt = {dt:.3g} s if grains are fast"
            row, overlap = int(totals[total_columns.GRAIN]), totals[total_columns.MAX_OVERLAP]
            raise run_errors.too_deep(g, row, overlap, self.overlap_limit, self.time, remedy)
        if status == TOO_FAST:
            raise run_errors.too_fast(g, self._peculiar_velocity, dt, FASTEST, self.time)
        if status == NOT_FINITE:
            remedy = f"check the external forces, and whether dt = {dt:.3g} s is too long for the stiffness"
            raise run_errors.not_finite(g, self.time, remedy)

    def contacts(self) -> ContactTable:
        """Return the present contacts, with the forces that the next step will feel; changes nothing."""
        kept = self._list
        if self._stale:  # a list of its own, in the present order; the run will make another one when it continues
            self._contacts = self._fresh_list(*self._reaches(self.skin))
            order = np.arange(self.grains.count)
            self._contacts.transfer(kept.memory(), order, None, self.sector, self._columns.vectors)
        try:
            return self._contacts_of(self._list)
        finally:
            self._contacts = kept

    def _contacts_of(self, contacts: ContactList) -> ContactTable:
        pair_force, wall_force = np.zeros((contacts.pairs.count, 3)), np.zeros((len(contacts.wall_other), 7))
        probe = self._probe(pair_force, wall_force)
        with threads_for(self.grains.count):
            kernel.run_steps(*probe)
        return contact_table(
            self.grains, contacts, self._device.wall, self.periodicity, probe.pairs.touching, probe.slots.touching,
            pair_force, wall_force,
        )  # fmt: skip

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to continue bit for bit."""
        arrays = super().state()
        arrays["last_torque"], arrays["later"] = self._last_torque.copy(), self._later.copy()
        if self.box is not None:
            arrays["box_later"] = self._box_later.copy()
        arrays["scalars"] = np.array([self._elastic, self._kinetic, self.dt, self.skin])
        return arrays

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into a DEM that was made with the same walls, bodies, contact, periodicity and `attraction`.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies, or an attraction whose table this DEM does not have.
        """
        super().restore(state)
        self._last_torque, self._later = state["last_torque"].copy(), state["later"].copy()
        if self.box is not None:
            self._box_later = state["box_later"].copy()
        self._elastic, self._kinetic, self.dt, self.skin = (float(v) for v in state["scalars"])
        if self.attraction is not None and self.attraction.pair_drive is not None:
            self.attraction.fetch(self)  # the drives are known: how strong they are can be asked before the next step

    def begin_with(self, state: dict[str, np.ndarray]) -> None:
        """Begin at time 0 with the grains of a `state` and what their contacts remember.

        Law, step, skin and the speeds of the bodies stay this DEM's; the bodies' angles are the state's, so that walls
        with teeth stand to the grains as they did. Of a sheared box the shear rate stays this DEM's, edges and offset
        are the state's, and its strain begins at 0; spins and peculiar velocities are kept. Lagged forces, moments
        and attraction are left behind.

        Raises
        ------
        ValueError
            As `restore`.
        """
        own, speeds = (self.dt, self.skin), [body.speed for body in self.bodies]
        rate = 0.0 if self.box is None else self.box.rate
        of_the_run = ("external_force", *MOMENTS)
        self.restore({k: v for k, v in state.items() if k not in of_the_run and not k.startswith(ATTRACTION)})
        self.dt, self.skin = own
        for body, speed in zip(self.bodies, speeds, strict=True):
            body.speed, body.external_torque = speed, 0.0
        self.step_count = self._list_step = 0
        if self.box is not None:
            velocity, half_step = self.grains.velocity, 0.5 * float(state["scalars"][2])  # velocities lag behind by it
            z = self.grains.position[:, 2] - half_step * velocity[:, 2]
            velocity -= self.box.flow(z)
            self.box.rate, self.box.strain = rate, 0.0
            velocity += self.box.flow(z)
        self._rebuild()
        for halves in (self._last_torque, self._later, self._box_later):  # of the last step, which another run took
            halves[:] = 0.0
        if self.energy_budget:
            self._kinetic = self._kinetic_now()
            self._elastic = self._elastic_energy_now()

    # -- arguments of the kernel

    def _step_tables(self, n_steps: int) -> StepTables:
        return StepTables(self.gravity, self.bodies, self.step_count, n_steps, self.dt)

    def _arguments(
        self,
        n_steps: int,
        last_call: bool,
        angle: np.ndarray,
        speed: np.ndarray,
        totals: np.ndarray,
        body_totals: np.ndarray,
        box_sums: np.ndarray | None,
        tables: StepTables | None = None,
        driven: bool = True,
    ) -> StepArguments:
        tables = tables or self._step_tables(n_steps)
        g, c, n_bodies = self.grains, self._list, len(self.bodies)
        n_chunks, most_walls = len(c.chunks.start) - 1, int(np.diff(c.wall_start).max(initial=1))
        none = np.zeros((0, 3))
        external, gravity = lagged_force(self.external_force, g.count), tables.gravity(self.step_count)
        species = np.zeros(0, dtype=np.int64) if self._species is None else self._species
        drives, constants = tables.drives(self.step_count), tables.constants
        walls, shift, box = self._device, None if self.periodicity is None else c.pairs.shift, self.box
        images = None if self.periodicity is None or self.sector is not None else self.periodicity.images
        virial = None if box is None else box_kernel.virial_scratch(n_chunks)
        flow = None if box is None else box_kernel.flow_of(box, self.skin, self._interaction)
        return StepArguments(
            Call(
                n_steps, self.dt, last_call, (0.5 * self.skin) ** 2, WALL_SKIN * self.skin, self.overlap_limit,
                self._fastest, numba.get_num_threads(),
            ),
            self._table,
            self._columns.resistance,
            self._columns.energy_column,
            None if self.attraction is None else self.attraction.lagged(c, g.count, driven),
            GrainState(g.position_radius, g.velocity_force, g.mass, species, gravity, external, c.reference, self._net,
                flow, virial),
            PairSlots(
                c.pairs.start, c.row, c.pairs.other.view(np.uint32), shift, self._turn, images, self.laws.pair,
                *c.pair_memory, none, pair_scratch(n_chunks),
            ),
            WallSlots(c.wall_start, c.wall_other, *c.wall_memory, none, *wall_scratch(n_chunks, most_walls)),
            WallState(walls.rows, walls.triangles, self._wall_row, walls.body, speed, np.zeros((n_bodies, 2))),
            Shafts(drives, constants, angle, speed, walls.reach, c.angles, float(self.n_sectors)),
            c.chunks,
            Totals(
                totals, body_totals, np.zeros((n_chunks, total_columns.N_SUMS)),
                np.zeros((n_chunks, n_bodies, total_columns.N_CHUNK_BODY)), box_sums,
            ),
        )  # fmt: skip

    def _probe(self, pair_force: np.ndarray, wall_force: np.ndarray, totals: np.ndarray | None = None) -> StepArguments:
        """Arguments of one step on copies of everything that it changes; it leaves its forces in the first two."""
        angle, speed = self._body_state()
        totals = np.zeros(total_columns.N_SUMS) if totals is None else totals
        body_totals = np.zeros((len(self.bodies), total_columns.N_BODY_SUMS))
        sums = None if self.box is None else np.zeros(box_kernel.N_BOX_SUMS)
        arguments = self._arguments(1, True, angle, speed, totals, body_totals, sums, driven=False)
        g, contacts = arguments.grains, self._list
        return arguments._replace(
            grains=g._replace(
                position_radius=g.position_radius.copy(), velocity_force=g.velocity_force.copy(), net=g.net.copy()
            ),
            pairs=arguments.pairs._replace(**contacts.pair_memory.copied()._asdict(), record=pair_force),
            slots=arguments.slots._replace(**contacts.wall_memory.copied()._asdict(), record=wall_force),
            chunks=arguments.chunks._replace(reaction=arguments.chunks.reaction.copy()),
        )

    def _kinetic_now(self) -> float:
        """Kinetic energy [J] of the present velocities, less the flow's of a sheared box."""
        if self.box is None:
            return self.grains.kinetic_energy()
        g = self.grains
        peculiar = g.velocity - self.box.flow(g.position[:, 2] - 0.5 * self.dt * g.velocity[:, 2])
        return 0.5 * float(
            g.mass @ np.einsum("ij,ij->i", peculiar, peculiar)
            + g.inertia @ np.einsum("ij,ij->i", g.angular_velocity, g.angular_velocity)
        )

    def _elastic_energy_now(self) -> float:
        """Elastic energy [J] of the present contacts, by what they remember."""
        c, totals = self._list, np.zeros(total_columns.N_SUMS)
        records = np.zeros((c.pairs.count, 3)), np.zeros((len(c.wall_other), 7))
        with threads_for(self.grains.count):
            kernel.run_steps(*self._probe(*records, totals))
        return float(totals[total_columns.ELASTIC])

    def _elastic_energy_at_rest(self) -> float:
        """Elastic energy [J] of the overlaps of a state that has no history yet."""
        angles = [body.angle for body in self.bodies]
        overlaps = geometric_overlaps(self.grains, self._list, self._device, angles, self.periodicity)
        return elastic_energy_at_rest(
            self._table, self.laws, self._wall_row, self._species, self.grains, self._list, overlaps
        )
