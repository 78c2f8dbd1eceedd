"""Budgets of torque and energy of a coupling window; every term comes from its own computation.

Torque about z, whole device:  torque on rotor + disc + housing + field + dL/dt - gravity = residual

- on the bodies: contact forces times levers, accumulated step by step as the grains move;
- on the field (poles and coil): minus the magnetic torque on the grains, x x F of the gradient force on dipoles, of the
  field on charges, of the pairs and of the images (`coupling.mutual_moments`); where the field turns with a slotted
  body, all of it acts on that body;
- on the sources of other lagged forces (a fluid, say): minus the torque of its effect, each in its own column;
- dL/dt: from positions and velocities at the window's ends, spins included;
- gravity: weight times lever of the centre of mass, mean of the window's ends: the only term that is not an exact sum.

Energy of the grains:  work of walls + lagged forces + gravity - dissipated - d(kinetic + elastic) = residual,
where every mechanism's loss is its own sum over contacts: the residual is the error of the grains' step, second order.
A sheared box has no axis and no walls: no balance of torques, and the work of the shear in place of that of walls
(`coupling.sheared_means`). A gap that repeats has no axis either.
The work of the magnetic forces, part of that of the lagged ones, is what the grains' energy W in the field falls by
where that field stands still and moments follow at every step: nothing in the mean of a steady run. What is left of it
comes from moments and mmfs that lag between their evaluations, and from the field that changes.
"""

from __future__ import annotations

from time import perf_counter, process_time

from coupling.layered_field import LayeredField
from coupling.sheared_means import GapMeans, ShearedMeans
from coupling.window_row import BodyRow, EnergyRow, SolverRow, WallClock, WindowRow
from geometry.kernels.cache import compile_seconds
from particles import DviTotals


class WindowBudget:
    """Sum of one window; `close` returns its row."""

    def __init__(self, simulation):
        self._simulation = simulation
        self._begin, self._processor = perf_counter(), process_time()
        self._part: tuple[str, float, float] | None = None
        self._seconds = dict.fromkeys(("field", "magnetic", "contact"), 0.0)
        self._field_impulse: dict[str, float] = {}  # torques of the field times their duration [N m s]
        self._other_impulse: dict[str, float] = {}  # of other effects
        lagged = [effect for effect in simulation.effects if effect.has_lagged_forces]
        self._lagged_is_magnetic = all(effect.of_the_field for effect in lagged)
        self._steps: list = []
        self._momentum = simulation.motion.grains.angular_momentum_z()
        self._weight = _weight_torque(simulation.motion)
        motion = simulation.motion
        self._sheared = None if motion.box is None else ShearedMeans(motion, simulation.magnetised)
        self._gap, source = None, simulation.source
        if motion.gap_box is not None:
            self._gap = GapMeans(motion, source.given if isinstance(source, LayeredField) else 0.0)
        self._solves = 0 if simulation.source is None else simulation.source.solves
        self._magnetic: float | None = None

    def clock(self, part: str | None) -> None:
        """Count time for `part` from here on ("field", "magnetic", "contact"; None: for nothing), less compiling."""
        now, compiled = perf_counter(), compile_seconds()
        if self._part is not None:
            name, since, before = self._part
            self._seconds[name] += max(0.0, now - since - (compiled - before))
        self._part = None if part is None else (part, now, compiled)

    def add_torques(self, torques: dict[str, float], of_the_field: bool) -> None:
        """Add torques of lagged forces on the sector's grains [N m], which are constant during the next sub-cycle."""
        impulse = self._field_impulse if of_the_field else self._other_impulse
        duration = self._simulation.lagged_steps * self._simulation.motion.dt
        for name, torque in torques.items():
            impulse[name] = impulse.get(name, 0.0) + torque * duration

    def add_steps(self, totals) -> None:
        """Add the totals of a sub-cycle of the grains."""
        self._steps.append(totals)
        for means in (self._sheared, self._gap):
            if means is not None:
                means.add_steps(totals)

    def add_stretch(self, totals, change: float) -> None:
        """Add the stretch of a sheared box after a sub-cycle: the change of its volume [m^3]."""
        assert self._sheared is not None
        self._sheared.add_stretch(totals, change)

    def end_steps(self) -> None:
        """Take the energy of the moments in the field of the window's steps, before the field is solved again."""
        if self._simulation.motion.energy_budget:
            self._magnetic = self._magnetic_energy()

    def close(self) -> WindowRow:
        """Return the window's row."""
        self.clock(None)
        simulation = self._simulation
        motion, n, steps = simulation.motion, simulation.n_sectors, self._steps
        duration = sum(s.duration for s in steps)
        residual = 0.0
        bodies: dict[str, BodyRow] = {}
        has_axis = self._sheared is None and self._gap is None
        for body in motion.bodies if has_axis else ():
            parts = {
                kind: sum(s.torque[body.name][kind] * s.duration for s in steps) / duration
                for kind in ("normal", "damping", "tangential")
            }
            bodies[body.name] = row = BodyRow(speed=body.speed, **parts)
            if body is simulation.field_carrier:
                # the field turns with this body: the grains' torque in it has its reaction here
                row.field = -n * self._field_impulse.pop(body.name, 0.0) / duration
            residual += row.torque
        if not has_axis:  # what the field turns is in the stress
            self._field_impulse.clear()
        field_torque = {name: n * total / duration for name, total in self._field_impulse.items()}
        residual -= sum(field_torque.values())
        other_torque = {name: n * total / duration for name, total in self._other_impulse.items()}
        for torque in other_torque.values():
            residual -= torque
        angular_momentum = n * motion.grains.angular_momentum_z()
        residual += (angular_momentum - n * self._momentum) / duration
        residual -= 0.5 * n * (self._weight + _weight_torque(motion))
        source, magnetised = simulation.source, simulation.magnetised
        is_solved = source is not None and source.solution is not None
        energy = self._energy() if motion.energy_budget else None
        window = WindowRow(
            time=motion.time,
            bodies=bodies,
            field_torque=field_torque,
            other_torque=other_torque,
            angular_momentum=angular_momentum if has_axis else None,
            torque_residual=residual if has_axis else None,
            energy=energy,
            lagged_is_magnetic=self._lagged_is_magnetic,
            field_solves=source.solves - self._solves if is_solved else None,
            n_contacts=steps[-1].n_contacts,
            max_overlap=max(s.max_overlap for s in steps),
            max_speed=max(s.max_speed for s in steps),
            solver=_solver_row(steps) if isinstance(steps[-1], DviTotals) else None,
            rebuilds=sum(s.rebuilds for s in steps),
            steps=sum(s.steps for s in steps),
            seconds=WallClock(
                field=None if magnetised is None else self._seconds["field"],
                magnetic=self._seconds["magnetic"] if simulation.has_lagged_forces else None,
                contact=self._seconds["contact"],
                total=perf_counter() - self._begin,
                processor=process_time() - self._processor,
            ),
        )
        for means in (self._sheared, self._gap):
            if means is not None:
                window.parts += [part for part in means.rows() if part is not None]
        if magnetised is not None:
            window.add(magnetised.window_part())
        if source is not None:
            window.add(source.window_part())
            if source.feedback is not None:
                window.add(source.feedback.window_part())
        return window

    def _magnetic_energy(self) -> float | None:
        magnetised = self._simulation.magnetised
        energy = None if magnetised is None else magnetised.energy()
        return None if energy is None else self._simulation.n_sectors * energy

    def _energy(self) -> EnergyRow:
        steps, simulation, sheared = self._steps, self._simulation, self._sheared
        budgets = [s.energy_budget for s in steps]
        work_walls: float | None = sum(sum(each.wall_work.values()) for each in budgets)
        work_shear = through_field = work_pressure = None
        if sheared is not None:
            if simulation.magnetised is not None:
                through_field = sheared.shear_work_magnetic + sheared.stretch_work_magnetic
            mechanical = sum(each.shear_work["contacts"] + each.shear_work["motion"] for each in budgets)
            work_pressure = None if simulation.barostat is None else sheared.stretch_work
            work_walls, work_shear = None, mechanical + sheared.shear_work_magnetic
        has_weight = simulation.motion.gravity is not None
        return EnergyRow(
            kinetic_energy=budgets[-1].kinetic_energy,
            elastic_energy=budgets[-1].elastic_energy,
            magnetic_energy=self._magnetic,
            work_walls=work_walls,
            work_shear=work_shear,
            work_pressure=work_pressure,
            work_box_magnetic=through_field,
            work_lagged=sum(each.external_work for each in budgets) if simulation.has_lagged_forces else None,
            work_gravity=sum(each.gravity_work for each in budgets) if has_weight else None,
            losses={kind: sum(each.dissipation[kind] for each in budgets) for kind in budgets[-1].dissipation},
            dissipated=sum(sum(each.dissipation.values()) for each in budgets),
            stored=sum(each.kinetic_change + each.elastic_change for each in budgets),
        )


def _solver_row(steps: list) -> SolverRow:
    n = sum(s.steps for s in steps)
    return SolverRow(
        sweeps=sum(s.sweeps for s in steps) / n,
        largest_sweeps=max(s.max_sweeps for s in steps),
        solver_residual=max(s.residual for s in steps),
        missed_steps=sum(s.missed_steps for s in steps),
        warm_hits=sum(s.warm_hits * s.steps for s in steps) / n,
        stabilisation_work=sum(s.stabilisation_work for s in steps),
    )


def _weight_torque(motion) -> float:
    """Return the torque of the grains' weight about z [N m]: sum of m (x g_y - y g_x)."""
    g = motion.gravity_now
    if g is None:
        return 0.0
    moment = motion.grains.mass @ motion.grains.position[:, :2]
    return float(moment[0] * g[1] - moment[1] * g[0])
