"""Discrete element method: grains, walls on turning bodies, contact law; the loop around the compiled step.

The step itself is `particles.dem.step_kernel`. Here the Verlet list is renewed (sort by cells, wrap through the
sector, carry the history), sums become `StepTotals`, and what went wrong is explained.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.walls import Wall
from particles.bodies import Body, FreeShaft, PrescribedSpeed
from particles.dem import step_kernel as kernel
from particles.dem.step_totals import StepTotals
from particles.dem.time_step import choose_time_step
from particles.faults import DemError
from particles.grains import Grains
from particles.laws.linear import LinearContact
from particles.laws.rolling_friction import RollingFriction
from particles.lists.contact_list import ContactList
from particles.lists.contact_table import ContactTable, contact_table, stored_at_rest
from particles.lists.neighbours import cell_order
from particles.sector import CyclicSector
from particles.threads import threads_for
from particles.walls.wall_table import outside, wall_table

ROWS_PER_CHUNK = 256  # chunks must follow from the number of grains alone (same result with any number of threads)
STEPS_PER_CALL = 512  # bounds the table of prescribed speeds


class DEM:
    """Grains moving between walls.

    Parameters
    ----------
    grains : Grains
        Taken over: its arrays are replaced, sorted and advanced.
    walls, bodies
        Walls refer to bodies by name.
    contact : LinearContact
        The law of every contact.
    dt : float
        Step [s]; `particles.dem.time_step.choose_time_step` proposes one.
    gravity : array_like, shape (3,), optional
        Acceleration [m/s^2]; None leaves it out of the compiled step.
    sector : CyclicSector, optional
        Simulate one wedge of the ring.
    rolling : RollingFriction, optional
        Rolling resistance; None leaves it out of the compiled step.
    skin : float, optional
        Of the Verlet list [m]; a quarter of the mean diameter by default.
    overlap_limit : float
        Overlap, as a share of the diameter, at which the run is stopped.

    Attributes
    ----------
    external_force : ndarray, shape (n, 3), or None
        Force on each grain [N] in the present order, held until it is set again; sorted along with the
        grains.
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
        contact: LinearContact,
        *,
        dt: float,
        gravity: np.ndarray | Sequence[float] | None = None,
        sector: CyclicSector | None = None,
        rolling: RollingFriction | None = None,
        skin: float | None = None,
        overlap_limit: float = 0.1,
    ) -> None:
        choose_time_step(contact, grains.mass, grains.radius, dt=dt)
        self.grains, self.walls, self.bodies, self.contact = grains, list(walls), list(bodies), contact
        self.dt, self.sector, self.overlap_limit = float(dt), sector, overlap_limit
        self.gravity = None if gravity is None else np.array(gravity, dtype=float).reshape(3)
        self.skin = 0.5 * float(np.mean(grains.radius)) if skin is None else float(skin)
        if not 0.0 < self.skin < np.inf:
            raise ValueError(f"skin = {self.skin * 1e3:g} mm; allowed: more than 0 (a quarter of a diameter is usual)")
        self.external_force: np.ndarray | None = None
        self.step_count = 0
        self.order_version = 0
        self.list_version = 0
        self._table = wall_table(self.walls, self.bodies)
        self._law = contact.table()
        self._rolling = None if rolling is None else rolling.table()
        self._turn = None if sector is None else np.array([np.cos(sector.angle), np.sin(sector.angle)])
        # a device that does not hold its grains at the start (a bare disc, a belt) cannot lose them either
        self._encloses = not outside(grains.position, self.walls, 0.0).any()
        n, n_bodies = grains.count, len(self.bodies)
        n_chunks = -(-n // ROWS_PER_CHUNK)
        self._chunk = np.arange(n_chunks + 1, dtype=np.int64) * n // n_chunks
        self._chunk_sums = np.zeros((n_chunks, kernel.N_SUMS))
        self._body_chunks = np.zeros((n_chunks, n_bodies, 5))
        self._net = np.zeros((n, 6))
        self._stale = True
        self._contacts: ContactList | None = None
        self._rebuild()
        self._elastic = stored_at_rest(grains, self._list, self._table.rows, sector, contact.stiffness_n)

    @property
    def time(self) -> float:
        """Time [s] of the positions; velocities lag by half a step."""
        return self.step_count * self.dt

    @property
    def n_sectors(self) -> int:
        """Sectors in the full ring (1 without a sector)."""
        return 1 if self.sector is None else self.sector.n_sectors

    @property
    def contact_force(self) -> np.ndarray:
        """Sum of the contact forces on each grain at the last step [N], shape (n, 3)."""
        return self._net[:, :3].copy()

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
        totals = np.zeros(kernel.N_SUMS)
        body_totals = np.zeros((len(self.bodies), kernel.N_BODY_SUMS))
        elastic, kinetic, rebuilds, left = self._elastic, self.grains.kinetic_energy(), 0, n_steps
        angle, speed = (np.array([getattr(b, name) for b in self.bodies]) for name in ("angle", "speed"))
        with threads_for(self.grains.count):
            while left > 0:
                if self._stale:
                    self._rebuild()
                    rebuilds += 1
                answer, done = self._advance(min(left, STEPS_PER_CALL), angle, speed, totals, body_totals)
                left -= done
                self.step_count += done
                for body, a, w in zip(self.bodies, angle, speed, strict=True):
                    body.angle, body.speed = float(a), float(w)
                self._stale = answer != kernel.DONE
                if answer in (kernel.NOT_FINITE, kernel.OVERLAP):
                    self._explain(answer, totals)
        if n_steps > 0:
            self._elastic = float(totals[kernel.ELASTIC])
        return self._summary(n_steps, totals, body_totals, kinetic, elastic, rebuilds)

    def contacts(self) -> ContactTable:
        """The contacts of the last step."""
        return contact_table(self.grains, self._list, self._table.rows, self.sector)

    def invalidate(self) -> None:
        """Say that positions were changed from outside: the list is renewed before the next step."""
        self._stale = True

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to go on bit for bit."""
        g = self.grains
        arrays = {
            name: getattr(g, name).copy()
            for name in ("position", "velocity", "angular_velocity", "radius", "mass", "particle_id")
        }
        for name, value in (("magnetic_moment", g.magnetic_moment), ("external_force", self.external_force)):
            if value is not None:
                arrays[name] = value.copy()
        arrays |= {f"list_{name}": value.copy() for name, value in self._list.arrays().items()}
        arrays["net"] = self._net.copy()
        arrays["bodies"] = np.array([[b.angle, b.speed, b.external_torque] for b in self.bodies]).reshape(-1, 3)
        arrays["counters"] = np.array(
            [self.step_count, self.order_version, self._stale, self.list_version], dtype=np.int64
        )
        arrays["scalars"] = np.array([self._elastic, self.dt, self.skin])
        return arrays

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into a DEM that was made with the same walls, bodies, contact and sector.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies.
        """
        if len(state["radius"]) != self.grains.count or len(state["bodies"]) != len(self.bodies):
            raise ValueError(
                f"the state has {len(state['radius'])} grains and {len(state['bodies'])} bodies, this DEM "
                f"{self.grains.count} and {len(self.bodies)}; restore it into the scene that it came from"
            )
        for name in ("position", "velocity", "angular_velocity", "radius", "mass", "particle_id"):
            setattr(self.grains, name, state[name].copy())
        moment, force = state.get("magnetic_moment"), state.get("external_force")
        self.grains.magnetic_moment = None if moment is None else moment.copy()
        self.external_force = None if force is None else force.copy()
        prefix = "list_"
        self._contacts = ContactList.from_arrays(
            {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}
        )
        self._net = state["net"].copy()
        for body, (angle, speed, torque) in zip(self.bodies, state["bodies"], strict=True):
            body.angle, body.speed, body.external_torque = float(angle), float(speed), float(torque)
        self.step_count, self.order_version = (int(v) for v in state["counters"][:2])
        self._stale, self.list_version = bool(state["counters"][2]), int(state["counters"][3])
        self._elastic, self.dt, self.skin = (float(v) for v in state["scalars"])

    # -- inside
    # ---------------------------------------------------------------------------------------------------

    def _advance(
        self, n_steps: int, angle: np.ndarray, speed: np.ndarray, totals: np.ndarray, body_totals: np.ndarray
    ) -> tuple[int, int]:
        g, c = self.grains, self._list
        times = (self.step_count + np.arange(n_steps)) * self.dt
        speeds = np.zeros((n_steps, len(self.bodies)))
        data = np.zeros((len(self.bodies), 4))
        for b, body in enumerate(self.bodies):
            if isinstance(body.motion, PrescribedSpeed):
                speeds[:, b] = body.motion.at(times)
            elif isinstance(body.motion, FreeShaft):
                motion = body.motion
                data[b] = 1.0, motion.inertia, motion.drive_torque + body.external_torque, motion.load_torque
        external = self.external_force
        if external is not None:
            external = np.ascontiguousarray(external, dtype=float)
            if external.shape != (g.count, 3):
                raise ValueError(f"external_force has shape {external.shape}; it must be ({g.count}, 3)")
        return kernel.run_steps(
            n_steps, self.dt, float(self.n_sectors), self._law, self._rolling, self._turn, self.gravity, external,
            (0.5 * self.skin) ** 2, self.overlap_limit, self._chunk,
            g.position, g.velocity, g.angular_velocity, g.radius, g.mass, c.reference,
            c.pairs.start, c.pairs.other, None if self.sector is None else c.pairs.shift, c.touching,
            c.history, c.reaction, c.incoming_start, c.incoming_slot,
            self._table.rows, self._table.body, c.wall_start, c.wall_other, c.wall_touching, c.wall_history,
            c.wall_force, speeds, data, angle, speed, self._net, self._chunk_sums, self._body_chunks,
            totals, body_totals,
        )  # fmt: skip

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
        order = cell_order(g.position, 2.0 * float(g.radius.max()) + self.skin)
        if np.any(order[1:] < order[:-1]):
            g.permute(order)
            self._net = self._net[order]
            if self.external_force is not None:
                self.external_force = np.ascontiguousarray(self.external_force[order])
            self.order_version += 1
        made = ContactList.make(
            g.position, g.radius, self.skin, self._table.rows, self.sector, 3 if self._rolling is None else 6
        )
        if self._contacts is not None:
            made.take_history(self._contacts, order, wraps, self.sector)
        self._contacts = made
        self.list_version += 1
        self._stale = False

    def _refuse_escaped(self) -> None:
        g = self.grains
        gone = np.flatnonzero(outside(g.position, self.walls, 2.0 * float(g.radius.max())))
        if len(gone):
            k = gone[0]
            raise DemError(
                f"it has left the device ({len(gone)} grains have)",
                "the walls may have a slot, or it was pressed through one: raise the stiffness or shorten dt",
                g.particle_id[k], g.position[k], self.time,
            )  # fmt: skip

    def _explain(self, answer: int, totals: np.ndarray) -> None:
        g = self.grains
        if answer == kernel.OVERLAP:
            k = int(totals[kernel.GRAIN])
            raise DemError(
                f"it overlaps a neighbour or a wall by {100.0 * totals[kernel.MAX_OVERLAP]:.3g} % of the "
                f"diameter (the limit is {100.0 * self.overlap_limit:.3g} %)",
                f"raise the stiffness (k_n = {self.contact.stiffness_n:.3g} N/m is too soft for the load), "
                f"or shorten dt = {self.dt:.3g} s if grains are fast",
                g.particle_id[k], g.position[k], self.time,
            )  # fmt: skip
        state = np.concatenate([g.position, g.velocity, g.angular_velocity], axis=1)
        bad = np.flatnonzero(~np.isfinite(state).all(axis=1))
        k = int(bad[0]) if len(bad) else 0
        raise DemError(
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
        force = bodies[:, kernel.FORCE_X : kernel.FORCE_Z + 1] * share
        if ring > 1:
            force[:, :2] = 0.0
        names = [body.name for body in self.bodies]
        now = self.grains.kinetic_energy()
        work = ring * totals
        return StepTotals(
            steps=steps,
            duration=steps * self.dt,
            torque={
                name: {
                    "normal": float(t[kernel.TORQUE_N]) * share,
                    "tangential": float(t[kernel.TORQUE_T]) * share,
                }
                for name, t in zip(names, bodies, strict=True)
            },
            force=dict(zip(names, force, strict=True)),
            wall_work={name: ring * float(t[kernel.BODY_WORK]) for name, t in zip(names, bodies, strict=True)},
            shaft_work={
                body.name: {"drive": float(t[kernel.DRIVE_WORK]), "load": float(t[kernel.LOAD_WORK])}
                for body, t in zip(self.bodies, bodies, strict=True)
                if body.is_free
            },
            dissipation={
                "normal_damping": float(work[kernel.NORMAL_DAMPING]),
                "tangential_damping": float(work[kernel.TANGENTIAL_DAMPING]),
                "sliding": float(work[kernel.SLIDING]),
                **({} if self._rolling is None else {"rolling": float(work[kernel.ROLLING])}),
            },
            contact_work=float(work[kernel.CONTACT_WORK]),
            gravity_work=float(work[kernel.GRAVITY_WORK]),
            external_work=float(work[kernel.EXTERNAL_WORK]),
            kinetic_energy=ring * now,
            kinetic_change=ring * (now - kinetic),
            elastic_energy=ring * self._elastic,
            elastic_change=ring * (self._elastic - elastic),
            max_overlap=float(totals[kernel.MAX_OVERLAP]),
            n_contacts=int(totals[kernel.CONTACTS]),
            max_speed=float(np.sqrt(totals[kernel.MAX_SPEED])),
            rebuilds=rebuilds,
        )
