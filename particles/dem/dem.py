"""Discrete element method: grains, walls on turning bodies, contact laws; the loop around the compiled step.

The step itself is `particles.dem.step_kernel`. Here the Verlet list is renewed (sort by cells, wrap through the
sector, carry the history), sums become `StepTotals`, and what went wrong is explained.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from geometry.walls import Wall
from particles.bodies import Body
from particles.dem import step_kernel as kernel
from particles.dem import sums
from particles.dem.attraction import PREFIX as ATTRACTION
from particles.dem.attraction import Attraction
from particles.dem.contact_kernel import LAST_ROLLING, LAST_STORED, LAST_TANGENTIAL, Resistance
from particles.dem.kernel_state import (
    Call,
    GrainState,
    PairSlots,
    StepArguments,
    Totals,
    WallSlots,
    WallState,
)
from particles.dem.step_totals import EnergyTotals, StepTotals
from particles.dem.time_step import choose_time_step
from particles.faults import DemError, DemErrorKind
from particles.grain_motion import Gravity
from particles.grains import Grains
from particles.laws.cohesion import Cohesion
from particles.laws.columns import COHESION_0, COHESION_1, MU_ROLLING, MU_TWISTING
from particles.laws.contact_law import ContactLaw
from particles.laws.linear import EqualLinearTable
from particles.laws.pair_table import PairLaws
from particles.laws.rolling_friction import RollingFriction
from particles.laws.springs import SPRINGS, remembers, spring, varies
from particles.laws.twisting_friction import TwistingFriction
from particles.lists.contact_list import ContactList, ListedWalls, reaches
from particles.lists.contact_table import ContactTable, contact_table, geometric_overlaps
from particles.lists.neighbours import PairList, cell_order, finest_cell
from particles.lists.skin import USUAL, WIDEST, next_skin
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
    ledger : bool
        Keep the books of energy; without them a step is about a fifth cheaper.

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
        ledger: bool = True,
    ) -> None:
        if isinstance(contact, PairLaws):
            if (rolling, twisting, cohesion) != (None, None, None):
                raise ValueError("rolling, twisting and cohesion stand beside PairLaws; give them to PairLaws")
            laws = contact
        else:
            laws = PairLaws.of_one(contact, rolling=rolling, twisting=twisting, cohesion=cohesion)
        choose_time_step(laws, grains.mass, grains.radius, dt=dt)
        self.grains, self.walls, self.bodies, self.laws = grains, list(walls), list(bodies), laws
        self.dt, self.sector, self.overlap_limit, self.ledger = float(dt), sector, overlap_limit, ledger
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
        self._species = None
        if species is not None and len(laws.pair) > 1:
            self._species = np.array(species, dtype=np.int64)
            if self._species.shape != (n,) or self._species.min() < 0 or self._species.max() >= len(laws.pair):
                raise ValueError(f"species must be {n} numbers from 0 to {len(laws.pair) - 1}")
        material = np.zeros(len(self.walls), dtype=np.int64) if wall_material is None else np.array(wall_material)
        if len(material) != len(self.walls) or (len(material) and not 0 <= material.max() < laws.wall.shape[1]):
            raise ValueError(f"wall_material must be {len(self.walls)} numbers from 0 to {laws.wall.shape[1] - 1}")
        self._wall_row = np.ascontiguousarray(laws.wall[:, material[self._device.wall].astype(np.int64)])
        self._table = self._law_table()
        self._choose_columns()
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
        self._elastic = self._stored_at_rest() if ledger else 0.0
        self._kinetic = grains.kinetic_energy() if ledger else 0.0

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
        if self.gravity is None:
            return None
        if callable(self.gravity):
            return np.asarray(self.gravity(np.array([self.time])), dtype=float).reshape(3)
        return np.asarray(self.gravity, dtype=float)

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
        totals = np.zeros(sums.N_SUMS)
        totals[sums.CONTACT_LATER : sums.CONTACT_LATER + 3] = self._later
        body_totals = np.zeros((len(self.bodies), sums.N_BODY_SUMS))
        body_totals[:, sums.LAST_TORQUE] = self._last_torque
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
                self._stale = answer != sums.DONE
                if answer in (sums.NOT_FINITE, sums.OVERLAP, sums.TOO_FAST):
                    self._explain(answer, totals)
        self._later = totals[sums.CONTACT_LATER : sums.CONTACT_LATER + 3].copy()
        self._last_torque = body_totals[:, sums.LAST_TORQUE].copy()
        if n_steps > 0 and self.ledger:
            self._elastic, self._kinetic = float(totals[sums.ELASTIC]), float(totals[sums.KINETIC])
        return self._summary(n_steps, totals, body_totals, kinetic, elastic, rebuilds)

    def contacts(self) -> ContactTable:
        """The contacts of now, with the forces that the next step will feel; changes nothing."""
        kept = self._list
        if self._stale:  # a list of its own, in the present order; the run will make another one when it goes on
            self._contacts = self._fresh_list()
            self._contacts.take(kept.memory(), np.arange(self.grains.count), None, self.sector, self._vectors)
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
        g = self.grains
        arrays = {name: getattr(g, name).copy() for name in ("where", "motion", "mass", "particle_id")}
        for name, value in (
            ("magnetic_moment", g.magnetic_moment),
            ("external_force", self.external_force),
            ("species", self._species),
        ):
            if value is not None:
                arrays[name] = value.copy()
        arrays |= {f"list_{name}": value.copy() for name, value in self._list.arrays().items()}
        if self.attraction is not None:
            arrays |= self.attraction.state()
        arrays["net"] = self._net.copy()
        arrays["bodies"] = np.array([[b.angle, b.speed, b.external_torque] for b in self.bodies]).reshape(-1, 3)
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
        if len(state["mass"]) != self.grains.count or len(state["bodies"]) != len(self.bodies):
            raise ValueError(
                f"the state has {len(state['mass'])} grains and {len(state['bodies'])} bodies, this DEM "
                f"{self.grains.count} and {len(self.bodies)}; restore it into the scene that it came from"
            )
        attracts = any(name.startswith(ATTRACTION) for name in state)
        if attracts and self.attraction is None:
            raise ValueError("the state's grains attract each other; give this DEM the same `attraction` first")
        for name in ("where", "motion", "mass", "particle_id"):
            setattr(self.grains, name, state[name].copy())
        moment, force, species = (state.get(name) for name in ("magnetic_moment", "external_force", "species"))
        self.grains.magnetic_moment = None if moment is None else moment.copy()
        self.external_force = None if force is None else force.copy()
        self._species = None if species is None else species.copy()
        if self.attraction is not None and attracts:
            self.attraction.restore(state)
        else:
            self.attraction = None
        prefix = "list_"
        self._contacts = ContactList.from_arrays(
            {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}
        )
        self._net = state["net"].copy()
        self._last_torque, self._later = state["last_torque"].copy(), state["later"].copy()
        for body, (angle, speed, torque) in zip(self.bodies, state["bodies"], strict=True):
            body.angle, body.speed, body.external_torque = float(angle), float(speed), float(torque)
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
        if remembered != self._n_columns:
            raise ValueError(
                f"a contact of the state remembers {remembered} numbers, one of this DEM {self._n_columns}; begin with "
                "grains of the same kind of contact law, of the same rolling and twisting friction and books of energy"
            )
        own, speeds = (self.dt, self.skin), [body.speed for body in self.bodies]
        of_the_run = ("external_force", "magnetic_moment")
        self.restore({k: v for k, v in state.items() if k not in of_the_run and not k.startswith(ATTRACTION)})
        self.dt, self.skin = own
        for body, speed in zip(self.bodies, speeds, strict=True):
            body.speed, body.external_torque = speed, 0.0
        self.step_count = self._list_step = 0
        self._rebuild()
        if self.ledger:
            self._kinetic = self.grains.kinetic_energy()
            self._elastic = self._stored_now()

    # -- inside: what the kernel is given
    # ---------------------------------------------------------------------------------------------------

    def _law_table(self) -> Any:
        """The table of the law; with constant dashpots [kg/s] where grains of a linear law are of one size and mass."""
        g, rows = self.grains, self.laws.rows
        table = SPRINGS[self.laws.kernel].table(rows)
        if self.laws.kernel != "linear" or self._species is not None:
            return table
        if np.ptp(g.radius) > 0.0 or np.ptp(g.mass) > 0.0:
            return table
        dashpots = np.zeros((len(rows), 2))
        for row in range(len(rows)):
            m_eff = float(g.mass[0]) * (1.0 if row in self.laws.wall else 0.5)
            dashpots[row] = spring(table, row, 1e-6, m_eff, 1.0, 0.0)[2:4]
        return EqualLinearTable(rows, dashpots)

    def _choose_columns(self) -> None:
        """Which parts the compiled step has, and where a contact keeps what it remembers."""
        rows = self.laws.rows
        self._rolling, self._twisting = bool(rows[:, MU_ROLLING].any()), bool(rows[:, MU_TWISTING].any())
        rolling = LAST_STORED + 1 if varies(self._table) else 3
        twisting = rolling + (3 if self._rolling else 0)
        last = twisting + (1 if self._twisting else 0)
        # what a contact does not remember has no column
        self._resistance = None
        if self._rolling or self._twisting:
            self._resistance = Resistance(rolling if self._rolling else -1, twisting if self._twisting else -1)
        self._ledger_column = last if self.ledger else None
        self._n_columns = last
        if self.ledger:
            self._n_columns += 8 if self._twisting else 7 if self._rolling else 4
        vectors = [0]
        if self._rolling:
            vectors.append(rolling)
        if self.ledger:
            vectors.append(last + LAST_TANGENTIAL)
            if self._rolling:
                vectors.append(last + LAST_ROLLING)
        self._vectors = np.array(vectors, dtype=np.int64)

    def _fit_scratch(self) -> None:
        """Work arrays whose sizes follow from the list."""
        contacts, n_bodies = self._list, len(self.bodies)
        n_chunks = len(contacts.chunks.start) - 1
        most = int(np.diff(contacts.wall_start).max(initial=1))
        self._scratch = np.zeros((n_chunks, most, N_FOUND))
        self._chunk_sums = np.zeros((n_chunks, sums.N_SUMS))
        self._body_chunks = np.zeros((n_chunks, n_bodies, sums.N_CHUNK_BODY))
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
        external = gravity = none
        if self.external_force is not None:
            external = np.ascontiguousarray(self.external_force, dtype=float)
            if external.shape != (g.count, 3):
                raise ValueError(f"external_force has shape {external.shape}; it must be ({g.count}, 3)")
        times = (self.step_count + np.arange(n_steps)) * self.dt
        if callable(self.gravity):
            gravity = np.ascontiguousarray(self.gravity(times), dtype=float).reshape(n_steps, 3)
        elif self.gravity is not None:
            gravity = np.array(self.gravity, dtype=float).reshape(1, 3)
        species = np.zeros(0, dtype=np.int64) if self._species is None else self._species
        drives, constants = drives_at(self.bodies, times)
        walls, shift = self._device, None if self.sector is None else c.pairs.shift
        return StepArguments(
            Call(
                n_steps, self.dt, last_call, (0.5 * self.skin) ** 2, WALL_SKIN * self.skin, self.overlap_limit,
                self._fastest,
            ),
            self._table,
            self._resistance,
            self._ledger_column,
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
        totals = np.zeros(sums.N_SUMS) if totals is None else totals
        body_totals = np.zeros((len(self.bodies), sums.N_BODY_SUMS))
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
        c, totals = self._list, np.zeros(sums.N_SUMS)
        records = np.zeros((c.pairs.count, 3)), np.zeros((len(c.wall_other), 7))
        with threads_for(self.grains.count):
            kernel.run_steps(*self._probe(*records, c.touching.copy(), c.wall_touching.copy(), totals))
        return float(totals[sums.ELASTIC])

    def _stored_at_rest(self) -> float:
        """Elastic energy [J] of the overlaps of a state that has no history yet."""
        g, c = self.grains, self._list
        table, energy = self._table, 0.0
        species = np.zeros(g.count, dtype=np.int64) if self._species is None else self._species
        pairs, walls = geometric_overlaps(g, c, self._device, [b.angle for b in self.bodies], self.sector)
        radius, mass = g.radius, g.mass
        for k in np.flatnonzero(pairs > 0.0):
            i, j = int(np.searchsorted(c.pairs.start, k, side="right") - 1), int(c.pairs.other[k])
            m_eff = mass[i] * mass[j] / (mass[i] + mass[j])
            r_eff = radius[i] * radius[j] / (radius[i] + radius[j])
            row = int(self.laws.pair[species[i], species[j]])
            stored = spring(table, row, pairs[k], m_eff, r_eff, 0.0)[4]
            energy += stored - self._pull(row, r_eff) * pairs[k]
            if remembers(table):  # its losses are told from the change of what is stored
                c.history[k, LAST_STORED], c.touching[k] = stored, 1
        for k in np.flatnonzero(walls > 0.0):
            i = int(np.searchsorted(c.wall_start, k, side="right") - 1)
            row = int(self._wall_row[species[i], c.wall_other[k]])
            stored = spring(table, row, walls[k], mass[i], radius[i], 0.0)[4]
            energy += stored - self._pull(row, radius[i]) * walls[k]
            if remembers(table):
                c.wall_history[k, LAST_STORED], c.wall_touching[k] = stored, 1
        return energy

    def _pull(self, row: int, r_eff: float) -> float:
        """Pull of cohesion [N] in a contact of this row."""
        return float(self.laws.rows[row, COHESION_0] + self.laws.rows[row, COHESION_1] * r_eff)

    def _fresh_list(self) -> ContactList:
        angles = [body.angle for body in self.bodies]
        return ContactList.make(
            self.grains.where, self.skin, self._device, angles, self.sector, self._n_columns, self._near_gap
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
        if self._encloses:
            self._refuse_escaped()
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
            made.take(memory, order, wraps, self.sector, self._vectors)
        self._contacts = made
        self._fit_scratch()
        self._list_step = self.step_count
        self.list_version += 1
        self._stale = False
        if self.attraction is not None:
            self.attraction.renew()
            self.attraction.listed = True

    def _refuse_escaped(self) -> None:
        g = self.grains
        gone = np.flatnonzero(outside(g.position, self.walls, 2.0 * float(g.radius.max())))
        if len(gone):
            k = gone[0]
            raise DemError(
                DemErrorKind.ESCAPED,
                f"it has left the device ({len(gone)} grains have)",
                "the walls may have a slot, or it was pressed through one: raise the stiffness or shorten dt",
                g.particle_id[k], g.position[k], self.time,
            )  # fmt: skip

    def _explain(self, answer: int, totals: np.ndarray) -> None:
        g = self.grains
        if answer == sums.OVERLAP:
            k = int(totals[sums.GRAIN])
            raise DemError(
                DemErrorKind.OVERLAP,
                f"it overlaps a neighbour or a wall by {100.0 * totals[sums.MAX_OVERLAP]:.3g} % of the "
                f"diameter (the limit is {100.0 * self.overlap_limit:.3g} %)",
                f"raise the stiffness, too soft for the load, or shorten dt = {self.dt:.3g} s if grains are fast",
                g.particle_id[k], g.position[k], self.time,
            )  # fmt: skip
        if answer == sums.TOO_FAST:
            k = int(np.argmax(np.einsum("ij,ij->i", g.velocity, g.velocity)))
            speed = float(np.linalg.norm(g.velocity[k]))
            raise DemError(
                DemErrorKind.TOO_FAST,
                f"at {speed:.3g} m/s it moves {speed * self.dt / g.radius.min():.2g} radii of the smallest grain in a "
                f"step (the limit is {FASTEST:g})",
                f"shorten dt = {self.dt:.3g} s, or find out what drives it",
                g.particle_id[k], g.position[k], self.time,
            )  # fmt: skip
        state = np.concatenate([g.position, g.velocity, g.angular_velocity], axis=1)
        bad = np.flatnonzero(~np.isfinite(state).all(axis=1))
        k = int(bad[0]) if len(bad) else 0
        raise DemError(
            DemErrorKind.NOT_FINITE,
            "its position or velocity is not a finite number",
            f"check the external forces, and whether dt = {self.dt:.3g} s is too long for the stiffness",
            g.particle_id[k], g.position[k], self.time,
        )  # fmt: skip

    def _summary(
        self,
        steps: int,
        totals: np.ndarray,
        bodies: np.ndarray,
        kinetic: float,
        elastic: float,
        rebuilds: int,
    ) -> StepTotals:
        ring = self.n_sectors
        share = ring / max(steps, 1)
        names = [body.name for body in self.bodies]
        torques = {"normal": sums.TORQUE_N, "damping": sums.TORQUE_D, "tangential": sums.TORQUE_T}
        forces = {"normal": sums.FORCE_N, "damping": sums.FORCE_D, "tangential": sums.FORCE_T}

        def force(row: np.ndarray, first: int) -> np.ndarray:
            found = row[first : first + 3] * share
            if ring > 1:
                found[:2] = 0.0
            return found

        parts = {
            name: {kind: force(row, first) for kind, first in forces.items()}
            for name, row in zip(names, bodies, strict=True)
        }
        energy = None
        if self.ledger:
            work = ring * totals
            energy = EnergyTotals(
                wall_work={name: ring * float(row[sums.BODY_WORK]) for name, row in zip(names, bodies, strict=True)},
                dissipation={
                    "normal_damping": float(work[sums.NORMAL_DAMPING]),
                    "tangential_damping": float(work[sums.TANGENTIAL_DAMPING]),
                    "sliding": float(work[sums.SLIDING]),
                    **({} if not self._rolling else {"rolling": float(work[sums.ROLLING])}),
                    **({} if not self._twisting else {"twisting": float(work[sums.TWISTING])}),
                },
                contact_work=float(work[sums.CONTACT_WORK]),
                gravity_work=float(work[sums.GRAVITY_WORK]),
                external_work=float(work[sums.EXTERNAL_WORK]),
                kinetic_energy=ring * self._kinetic,
                kinetic_change=ring * (self._kinetic - kinetic),
                elastic_energy=ring * self._elastic,
                elastic_change=ring * (self._elastic - elastic),
            )
        return StepTotals(
            steps=steps,
            duration=steps * self.dt,
            torque={
                name: {kind: float(row[column]) * share for kind, column in torques.items()}
                for name, row in zip(names, bodies, strict=True)
            },
            force={name: sum(own.values(), np.zeros(3)) for name, own in parts.items()},
            force_parts=parts,
            shaft_work={
                body.name: {
                    "drive": float(row[sums.DRIVE_WORK]),
                    "load": float(row[sums.LOAD_WORK]),
                    "contact": float(row[sums.SHAFT_CONTACT_WORK]),
                }
                for body, row in zip(self.bodies, bodies, strict=True)
                if body.is_free
            },
            energy=energy,
            max_overlap=float(totals[sums.MAX_OVERLAP]),
            n_contacts=int(totals[sums.CONTACTS]),
            max_speed=float(np.sqrt(totals[sums.MAX_SPEED])),
            rebuilds=rebuilds,
        )
