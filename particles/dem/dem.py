"""Discrete element method: grains, walls on turning bodies, contact laws; the loop around the compiled step.

The step itself is `particles.dem.step_kernel`. Here the Verlet list is renewed (sort by cells, wrap through the
sector, carry the history), and the state is taken and put back: both handle every array that a grain or a contact has,
and stand in one file so that a new one is forgotten in neither. Sums become `StepTotals` in `run_summary`, and what
went wrong is explained in `run_faults`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geometry.walls import Wall
from particles import checkpoint
from particles.bodies import Body
from particles.dem import run_faults, run_summary, total_columns
from particles.dem import step_kernel as kernel
from particles.dem.attraction import PREFIX as ATTRACTION
from particles.dem.attraction import Attraction
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
from particles.dem.step_totals import StepTotals
from particles.dem.stored_energy import law_table, stored_at_rest
from particles.dem.time_step import choose_time_step
from particles.grain_motion import Gravity, gravity_at, held_force
from particles.grains import Grains
from particles.laws.cohesion import Cohesion
from particles.laws.contact_law import ContactLaw
from particles.laws.pair_table import PairLaws, species_of, wall_rows
from particles.laws.rolling_friction import RollingFriction
from particles.laws.twisting_friction import TwistingFriction
from particles.neighbours.contact_list import ContactList, ListedWalls, reaches
from particles.neighbours.contact_table import ContactTable, contact_table, geometric_overlaps
from particles.neighbours.neighbour_list import PairList, cell_order, finest_cell
from particles.neighbours.skin import USUAL, WIDEST, next_skin
from particles.sector import CyclicSector
from particles.shafts import Shafts, drives_at
from particles.threads import threads_for
from particles.walls.device_walls import DeviceWalls
from particles.walls.triangle_kernels import N_FOUND
from particles.walls.wall_table import outside

STEPS_PER_CALL = 512  # bounds the tables in time (speeds, torques, gravity)
WALL_SKIN = 0.5  # of the skin: how far triangles may turn before the list is made anew

FASTEST = 1.0  # radii of the smallest grain in a step: beyond it a grain may pass through another


class DEM:
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
    sector : CyclicSector, optional
        Simulate one wedge of the ring.
    rolling, twisting, cohesion : optional
        Resistance to rolling and to twisting, and pull, beside a single law (`PairLaws` has its own); None leaves each
        out of the compiled step.
    species : ndarray of int, shape (n,), optional
        Material of each grain, a row of ``PairLaws.pair``.
    wall_material : sequence of int, optional
        Material of each wall, a column of ``PairLaws.wall``; 0 by default.
    skin : float, optional
        Of the Verlet list [m]; by default it starts at a quarter of the mean diameter and follows what is cheapest.
    overlap_limit : float
        Overlap, as a share of the diameter, at which the run is stopped.
    energy_budget : bool
        Keep the energy budget; without them a step is about a fifth cheaper.

    Attributes
    ----------
    external_force : ndarray, shape (n, 3), or None
        Force on each grain [N] in the present order, held until it is set again; sorted along with the
        grains.
    attraction : Attraction or None
        Pull of near grains and walls from the gap of every step, its drive held (`particles.dem.attraction`); None
        leaves it out of the compiled step.
    time, step_count, order_version, list_version
        Time [s] of the positions, steps done, how often the grains have been put in another order, and how
        often the neighbour list was made (between two of them no grain moves by more than half the skin or
        wraps).

    Raises
    ------
    ValueError
        For a step too long for the contact, an unknown body, a sector too narrow.
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
        sector: CyclicSector | None = None,
        rolling: RollingFriction | None = None,
        twisting: TwistingFriction | None = None,
        cohesion: Cohesion | None = None,
        species: np.ndarray | None = None,
        wall_material: Sequence[int] | None = None,
        skin: float | None = None,
        overlap_limit: float = 0.1,
        energy_budget: bool = True,
    ) -> None:
        if isinstance(contact, PairLaws):
            if (rolling, twisting, cohesion) != (None, None, None):
                raise ValueError("rolling, twisting and cohesion stand beside PairLaws; give them to PairLaws")
            laws = contact
        else:
            laws = PairLaws.of_one(contact, rolling=rolling, twisting=twisting, cohesion=cohesion)
        choose_time_step(laws, grains.mass, grains.radius, dt=dt)
        self.grains, self.walls, self.bodies, self.laws = grains, list(walls), list(bodies), laws
        self.dt, self.sector, self.overlap_limit, self.energy_budget = float(dt), sector, overlap_limit, energy_budget
        self.gravity = gravity if gravity is None or callable(gravity) else np.array(gravity, dtype=float).reshape(3)
        if sector is not None and isinstance(self.gravity, np.ndarray) and self.gravity[:2].any():
            raise ValueError(
                f"gravity = {self.gravity} m/s^2 turns from sector to sector; allowed beside a sector: along z only"
            )
        self._mean_radius = math.fsum(grains.radius) / grains.count  # to the bit, in whatever order they stand
        self._fastest = FASTEST * float(np.min(grains.radius)) / self.dt
        self._own_skin = skin is None
        self.skin = USUAL * self._mean_radius if skin is None else float(skin)
        if not 0.0 < self.skin < np.inf:
            raise ValueError(f"skin = {self.skin * 1e3:g} mm; allowed: more than 0 (a quarter of a diameter is usual)")
        self.external_force: np.ndarray | None = None
        self.attraction: Attraction | None = None
        self.step_count = self.order_version = self.list_version = 0
        n, n_bodies = grains.count, len(self.bodies)
        self._device = DeviceWalls(self.walls, self.bodies)
        self._species = species_of(laws, n, species)
        self._wall_row = wall_rows(laws, len(self.walls), wall_material, self._device.wall)
        self._table = law_table(laws, grains, one_species=self._species is None)
        self._columns = contact_columns(laws.rows, self._table, energy_budget)
        self._turn = None if sector is None else np.array([np.cos(sector.angle), np.sin(sector.angle)])
        # a device that does not hold its grains at the start (a bare disc, a belt) cannot lose them either
        self._encloses = not outside(grains.position, self.walls, 0.0).any()
        self._net = np.zeros((n, 3))
        self._later = np.zeros(3)
        self._last_torque = np.zeros(n_bodies)
        self._stale = True
        self._list_step = 0
        self._contacts: ContactList | None = None
        self._rebuild()
        self._elastic = self._stored_at_rest() if energy_budget else 0.0
        self._kinetic = grains.kinetic_energy() if energy_budget else 0.0

    @property
    def contact(self) -> ContactLaw:
        """The law between grains (of the first species)."""
        return self.laws.laws[int(self.laws.pair[0, 0])]

    @property
    def time(self) -> float:
        """Time [s] of the positions; velocities lag by half a step."""
        return self.step_count * self.dt

    @property
    def gravity_now(self) -> np.ndarray | None:
        """Acceleration of gravity [m/s^2] at this time, shape (3,)."""
        pull = gravity_at(self.gravity, np.array([self.time]))
        return pull[0] if len(pull) else None

    @property
    def list_skin(self) -> float:
        """How much further than touching the present list reaches [m]."""
        return self.skin

    @property
    def listed_pairs(self) -> PairList:
        """Pairs of the present list; see `renew_list`, and `Attraction.near_gap` for how far they reach.

        Of row i: the partners ``other`` at R(shift*angle) x_other, all in the present order of the grains.
        """
        return self._list.pairs

    @property
    def listed_walls(self) -> ListedWalls:
        """Walls near each grain in the present list."""
        number = self._list.wall_other
        return ListedWalls(self._list.wall_start, self._device.wall[number], number < len(self._device.rows))

    @property
    def n_sectors(self) -> int:
        """Sectors in the full ring (1 without a sector)."""
        return 1 if self.sector is None else self.sector.n_sectors

    @property
    def contact_force(self) -> np.ndarray:
        """Sum of the contact forces on each grain at the last step [N], shape (n, 3)."""
        return self._net.copy()

    @property
    def _list(self) -> ContactList:
        assert self._contacts is not None
        return self._contacts

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
        elastic, kinetic, rebuilds, left = self._elastic, self._kinetic, 0, n_steps
        angle, speed = (np.array([getattr(b, name) for b in self.bodies]) for name in ("angle", "speed"))
        with threads_for(self.grains.count):
            while left > 0:
                if self._outdated:
                    self._rebuild()
                    rebuilds += 1
                if self.attraction is not None:  # first: it may set the held force
                    self.attraction.fetch(self)
                batch = min(left, STEPS_PER_CALL)
                answer, done = kernel.run_steps(
                    *self._arguments(batch, batch == left, angle, speed, totals, body_totals)
                )
                left -= done
                self.step_count += done
                for body, a, w in zip(self.bodies, angle, speed, strict=True):
                    body.angle, body.speed = float(a), float(w)
                self._stale = answer != total_columns.DONE
                if answer in (total_columns.NOT_FINITE, total_columns.OVERLAP, total_columns.TOO_FAST):
                    raise run_faults.stopped(
                        answer, totals, self.grains, self.dt, self.overlap_limit, FASTEST, self.time
                    )
        self._later = totals[total_columns.CONTACT_LATER : total_columns.CONTACT_LATER + 3].copy()
        self._last_torque = body_totals[:, total_columns.LAST_TORQUE].copy()
        energy, ring = None, self.n_sectors
        if self.energy_budget:
            if n_steps > 0:
                self._elastic, self._kinetic = (
                    float(totals[total_columns.ELASTIC]),
                    float(totals[total_columns.KINETIC]),
                )
            energy = run_summary.energy_budget(
                ring,
                self.bodies,
                totals,
                body_totals,
                self._columns,
                (kinetic, self._kinetic),
                (elastic, self._elastic),
            )
        return run_summary.summary(n_steps, self.dt, ring, self.bodies, totals, body_totals, energy, rebuilds)

    def contacts(self) -> ContactTable:
        """The contacts of now, with the forces that the next step will feel; changes nothing."""
        kept = self._list
        if self._stale:  # a list of its own, in the present order; the run will make another one when it goes on
            self._contacts = self._fresh_list()
            self._contacts.take(kept.memory(), np.arange(self.grains.count), None, self.sector, self._columns.vectors)
            self._fit_scratch()
        try:
            return self._contacts_of(self._list)
        finally:
            if self._contacts is not kept:
                self._contacts = kept
                self._fit_scratch()

    def _contacts_of(self, contacts: ContactList) -> ContactTable:
        pair_force, wall_force = np.zeros((contacts.pairs.count, 3)), np.zeros((len(contacts.wall_other), 7))
        touching, wall_touching = contacts.touching.copy(), contacts.wall_touching.copy()
        with threads_for(self.grains.count):
            kernel.run_steps(*self._probe(pair_force, wall_force, touching, wall_touching))
        return contact_table(
            self.grains, contacts, self._device.wall, self.sector, touching, wall_touching, pair_force, wall_force
        )

    def invalidate(self) -> None:
        """Say that positions were changed from outside: the list is renewed before the next step."""
        self._stale = True

    def renew_list(self) -> bool:
        """Make the neighbour list anew if it is outdated, as `run` would; whether it was.

        For who needs to know, before a run, which pairs its list holds. Grains may be sorted and wrapped.
        """
        if not self._outdated:
            return False
        self._rebuild()
        return True

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to go on bit for bit."""
        arrays = checkpoint.taken(
            self.grains, self.bodies, self._list.arrays(), external_force=self.external_force, species=self._species
        )
        if self.attraction is not None:
            arrays |= self.attraction.state()
        arrays["net"] = self._net.copy()
        arrays["last_torque"], arrays["later"] = self._last_torque.copy(), self._later.copy()
        arrays["counters"] = np.array(
            [self.step_count, self.order_version, self._stale, self.list_version, self._list_step], dtype=np.int64
        )
        arrays["scalars"] = np.array([self._elastic, self._kinetic, self.dt, self.skin])
        return arrays

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into a DEM that was made with the same walls, bodies, contact, sector and `attraction`.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies, or an attraction whose table this DEM does not have.
        """
        checkpoint.refuse_another_scene("DEM", state, self.grains, self.bodies)
        attracts = any(name.startswith(ATTRACTION) for name in state)
        if attracts and self.attraction is None:
            raise ValueError("the state's grains attract each other; give this DEM the same `attraction` first")
        checkpoint.put_grains(state, self.grains)
        self.external_force, self._species = (checkpoint.held_in(state, name) for name in ("external_force", "species"))
        if self.attraction is not None and attracts:
            self.attraction.restore(state)
        else:
            self.attraction = None
        self._contacts = ContactList.from_arrays(checkpoint.list_of(state))
        self._net = state["net"].copy()
        self._last_torque, self._later = state["last_torque"].copy(), state["later"].copy()
        checkpoint.put_bodies(state, self.bodies)
        self.step_count, self.order_version, stale, self.list_version, self._list_step = (
            int(v) for v in state["counters"]
        )
        self._stale = bool(stale)
        self._elastic, self._kinetic, self.dt, self.skin = (float(v) for v in state["scalars"])
        self._fit_scratch()
        if self.attraction is not None and self.attraction.pair_drive is not None:
            self.attraction.fetch(self)  # the drives are known: how strong they are can be asked before the next step

    def begin_with(self, state: dict[str, np.ndarray]) -> None:
        """Begin at time 0 with the grains of a `state` and what their contacts remember.

        Law, step, skin and the speeds of the bodies stay this DEM's; the bodies' angles are the state's, so that walls
        with teeth stand to the grains as they did. Held forces, moments and attraction are left behind.

        Raises
        ------
        ValueError
            As `restore`, or where contacts remember something else, by another kind of law.
        """
        remembered = state["list_pair_history"].shape[1]
        if remembered != self._columns.total:
            raise ValueError(
                f"a contact of the state remembers {remembered} numbers, one of this DEM {self._columns.total}; "
                "begin with grains of the same kind of contact law, rolling and twisting friction and energy budget"
            )
        own, speeds = (self.dt, self.skin), [body.speed for body in self.bodies]
        of_the_run = ("external_force", "magnetic_moment")
        self.restore({k: v for k, v in state.items() if k not in of_the_run and not k.startswith(ATTRACTION)})
        self.dt, self.skin = own
        for body, speed in zip(self.bodies, speeds, strict=True):
            body.speed, body.external_torque = speed, 0.0
        self.step_count = self._list_step = 0
        self._rebuild()
        if self.energy_budget:
            self._kinetic = self.grains.kinetic_energy()
            self._elastic = self._stored_now()

    # -- inside: what the kernel is given
    # ---------------------------------------------------------------------------------------------------

    def _fit_scratch(self) -> None:
        """Work arrays whose sizes follow from the list."""
        contacts, n_bodies = self._list, len(self.bodies)
        n_chunks = len(contacts.chunks.start) - 1
        most = int(np.diff(contacts.wall_start).max(initial=1))
        self._scratch = np.zeros((n_chunks, most, N_FOUND))
        self._chunk_sums = np.zeros((n_chunks, total_columns.N_SUMS))
        self._body_chunks = np.zeros((n_chunks, n_bodies, total_columns.N_CHUNK_BODY))
        self._body_turn = np.zeros((n_bodies, 2))

    def _arguments(
        self,
        n_steps: int,
        last_call: bool,
        angle: np.ndarray,
        speed: np.ndarray,
        totals: np.ndarray,
        body_totals: np.ndarray,
        driven: bool = True,
    ) -> StepArguments:
        g, c = self.grains, self._list
        none = np.zeros((0, 3))
        times = (self.step_count + np.arange(n_steps)) * self.dt
        external, gravity = held_force(self.external_force, g.count), gravity_at(self.gravity, times)
        species = np.zeros(0, dtype=np.int64) if self._species is None else self._species
        drives, constants = drives_at(self.bodies, times)
        walls, shift = self._device, None if self.sector is None else c.pairs.shift
        return StepArguments(
            Call(
                n_steps, self.dt, last_call, (0.5 * self.skin) ** 2, WALL_SKIN * self.skin, self.overlap_limit,
                self._fastest,
            ),
            self._table,
            self._columns.resistance,
            self._columns.energy_column,
            None if self.attraction is None else self.attraction.held(c, g.count, driven),
            GrainState(g.where, g.motion, g.mass, species, gravity, external, c.reference, self._net),
            PairSlots(
                c.pairs.start, c.pairs.other, shift, self._turn, self.laws.pair, c.touching, c.history, none
            ),
            WallSlots(c.wall_start, c.wall_other, c.wall_touching, c.wall_history, none, self._scratch),
            WallState(walls.rows, walls.triangles, self._wall_row, walls.body, speed, self._body_turn),
            Shafts(drives, constants, angle, speed, walls.reach, c.angles, float(self.n_sectors)),
            c.chunks,
            Totals(totals, body_totals, self._chunk_sums, self._body_chunks),
        )  # fmt: skip

    def _probe(self, pair_force, wall_force, touching, wall_touching, totals=None) -> StepArguments:
        """Arguments of one step on copies of everything that it changes; it leaves its forces in the first two."""
        angle, speed = (np.array([getattr(b, name) for b in self.bodies]) for name in ("angle", "speed"))
        totals = np.zeros(total_columns.N_SUMS) if totals is None else totals
        body_totals = np.zeros((len(self.bodies), total_columns.N_BODY_SUMS))
        given = self._arguments(1, True, angle, speed, totals, body_totals, driven=False)
        g, p, w = given.grains, given.pairs, given.slots
        return given._replace(
            grains=g._replace(where=g.where.copy(), motion=g.motion.copy(), net=g.net.copy()),
            pairs=p._replace(touching=touching, history=p.history.copy(), record=pair_force),
            slots=w._replace(touching=wall_touching, history=w.history.copy(), record=wall_force),
            chunks=given.chunks._replace(reaction=given.chunks.reaction.copy()),
        )

    def _stored_now(self) -> float:
        """Elastic energy [J] of the contacts of now, by what they remember."""
        c, totals = self._list, np.zeros(total_columns.N_SUMS)
        records = np.zeros((c.pairs.count, 3)), np.zeros((len(c.wall_other), 7))
        with threads_for(self.grains.count):
            kernel.run_steps(*self._probe(*records, c.touching.copy(), c.wall_touching.copy(), totals))
        return float(totals[total_columns.ELASTIC])

    def _stored_at_rest(self) -> float:
        """Elastic energy [J] of the overlaps of a state that has no history yet."""
        angles = [body.angle for body in self.bodies]
        overlaps = geometric_overlaps(self.grains, self._list, self._device, angles, self.sector)
        return stored_at_rest(self._table, self.laws, self._wall_row, self._species, self.grains, self._list, overlaps)

    def _fresh_list(self) -> ContactList:
        angles = [body.angle for body in self.bodies]
        return ContactList.make(
            self.grains.where, self.skin, self._device, angles, self.sector, self._columns.total, self._near_gap
        )

    @property
    def _near_gap(self) -> float:
        """Gap [radii] up to which a list made now holds every pair at every step."""
        return 0.0 if self.attraction is None else self.attraction.near_gap

    @property
    def _outdated(self) -> bool:
        return self._stale or (self.attraction is not None and not self.attraction.listed)

    def _rebuild(self) -> None:
        """Wrap, sort by cells, list the neighbours anew, and carry the history into it."""
        g = self.grains
        if self._encloses and len(gone := np.flatnonzero(outside(g.position, self.walls, 2.0 * float(g.radius.max())))):
            raise run_faults.escaped(g, gone, self.time)
        wraps = None
        if self.sector is not None:
            wraps = self.sector.wraps(g.position)
            gone = np.flatnonzero(wraps)
            for array in (g.position, g.velocity, g.angular_velocity, g.magnetic_moment, self.external_force):
                if array is not None:
                    array[gone] = self.sector.turn(array[gone], wraps[gone])
            if self.attraction is not None:
                self.attraction.wrapped(gone, wraps[gone], self.sector)
        memory = None
        if self._contacts is not None:
            memory = self._contacts.memory()
            if self._own_skin:
                extra = (self._contacts.pairs.count - len(memory.other)) / g.count
                widest = WIDEST if self.sector is None else USUAL  # a sector is checked for the usual one
                steps = self.step_count - self._list_step
                self.skin = next_skin(self.skin, steps, extra, self._mean_radius, widest)
            self._contacts = None  # before the next one: two lists are the most memory that grains ever need
        reach, cutoff = reaches(g.radius, self.skin, self._near_gap)
        order = cell_order(g.position, finest_cell(reach, cutoff))
        if np.any(order[1:] < order[:-1]):
            g.permute(order)
            self._net = self._net[order]
            if self._species is not None:
                self._species = self._species[order]
            if self.external_force is not None:
                self.external_force = np.ascontiguousarray(self.external_force[order])
            if self.attraction is not None:
                self.attraction.sorted_as(order)
            self.order_version += 1
        made = self._fresh_list()
        if memory is not None:
            made.take(memory, order, wraps, self.sector, self._columns.vectors)
        self._contacts = made
        self._fit_scratch()
        self._list_step = self.step_count
        self.list_version += 1
        self._stale = False
        if self.attraction is not None:
            self.attraction.renew()
            self.attraction.listed = True
