"""Budgets of torque and energy of a coupling window; every term comes from its own computation.

Torque about z, whole device:  torque on rotor + disc + housing + field + dL/dt - gravity = residual

- on the bodies: contact forces times levers, accumulated step by step as the grains move;
- on the field (poles and coil): minus the magnetic torque on the grains, from m and B for the pairs of dipoles
  (-sum m_i x B_j, see `coupling.dipoles`), from x x F for the gradient force and the images; where a slotted body
  carries the field round, the gradient force's part is booked on that body;
- on what else holds forces (a fluid, say): minus the torque that its effect books, each in its own column;
- dL/dt: from positions and velocities at the window's ends, spins included;
- gravity: weight times lever of the centre of mass, mean of the window's ends: the one term that is no exact sum.

Energy of the grains:  work of walls + held forces + gravity - dissipated - d(kinetic + elastic) = residual,
where every mechanism's loss is its own sum over contacts: the residual is the error of the grains' step, second order.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from geometry.kernels.cache import compile_seconds
from particles import DviTotals


class WindowBudget:
    """Adds up one window; `close` returns its row of the history (SI units, whole device)."""

    def __init__(self, simulation):
        self._simulation = simulation
        self._begin = perf_counter()
        self._part: tuple[str, float, float] | None = None
        self._seconds = dict.fromkeys(("field", "magnetic", "contact"), 0.0)
        self._recorded: dict[str, list[float]] = {}  # of the field
        self._beside: dict[str, list[float]] = {}  # of other effects
        of_the_field = all(effect.of_the_field for effect in simulation.effects if effect.holds_forces)
        self._work_held = "work_magnetic" if of_the_field else "work_held"
        self._steps: list = []
        self._momentum = simulation.motion.grains.angular_momentum_z()
        self._weight = _weight_torque(simulation.motion)
        self._solves = 0 if simulation.source is None else simulation.source.solves

    def clock(self, part: str | None) -> None:
        """From now on time counts for `part` ("field", "magnetic", "contact"; None: for nothing), less compiling."""
        now, compiled = perf_counter(), compile_seconds()
        if self._part is not None:
            name, since, before = self._part
            self._seconds[name] += max(0.0, now - since - (compiled - before))
        self._part = None if part is None else (part, now, compiled)

    def record(self, torques: dict[str, float], of_the_field: bool) -> None:
        """Torques of held forces on the sector's grains [N m], which hold during the next sub-cycle."""
        booked = self._recorded if of_the_field else self._beside
        for name, torque in torques.items():
            booked.setdefault(name, []).append(torque)

    def add_steps(self, totals) -> None:
        """Totals of a sub-cycle of the grains."""
        self._steps.append(totals)

    def close(self) -> dict[str, float]:
        """The window's row: torques [N m], energies [J], counts, wall-clock seconds."""
        self.clock(None)
        simulation = self._simulation
        motion, n, steps = simulation.motion, simulation.n_sectors, self._steps
        duration = sum(s.duration for s in steps)
        row: dict[str, float] = {"time": motion.time}
        residual = 0.0
        for body in motion.bodies:
            if body.name != "housing":  # it stands
                row[f"{body.name}_speed"] = body.speed
            parts = {
                kind: sum(s.torque[body.name][kind] * s.duration for s in steps) / duration
                for kind in ("normal", "damping", "tangential")
            }
            row[f"torque_{body.name}"] = sum(parts.values())
            if body is simulation.field_carrier:
                # the field turns with this body: the grains' torque in it has its reaction here
                row[f"torque_{body.name}_field"] = -n * float(np.mean(self._recorded.pop(body.name, [0.0])))
                row[f"torque_{body.name}"] += row[f"torque_{body.name}_field"]
            if body.name == "disc":
                row |= {f"torque_disc_{kind}": value for kind, value in parts.items()}
            residual += row[f"torque_{body.name}"]
        if self._recorded:
            booked = {name: n * float(np.mean(values)) for name, values in self._recorded.items()}
            row["torque_field"] = -sum(booked.values())
            row |= {f"torque_field_{name}": -value for name, value in booked.items() if len(booked) > 1}
            residual += row["torque_field"]
        for name, values in self._beside.items():
            row[f"torque_{name}"] = -n * float(np.mean(values))
            residual += row[f"torque_{name}"]
        row["angular_momentum"] = n * motion.grains.angular_momentum_z()
        residual += (row["angular_momentum"] - n * self._momentum) / duration
        residual -= 0.5 * n * (self._weight + _weight_torque(motion))
        row["torque_residual"] = residual
        if motion.energy_budget:
            self._close_energy(row)
        if simulation.magnetised is not None:
            row |= simulation.magnetised.window_row()
        source = simulation.source
        if source is not None and source.solution is not None:
            row["field_solves"] = source.solves - self._solves
        if source is not None and source.feedback is not None:
            row |= source.feedback.window_row()
        row["n_contacts"] = steps[-1].n_contacts
        row["max_overlap"] = max(s.max_overlap for s in steps)
        row["max_speed"] = max(s.max_speed for s in steps)
        if isinstance(steps[-1], DviTotals):
            row |= _solver_row(steps)
        row["rebuilds"] = sum(s.rebuilds for s in steps)
        row["steps"] = sum(s.steps for s in steps)
        if simulation.magnetised is not None:
            row["wall_field"] = self._seconds["field"]
        if simulation.holds_forces:
            row["wall_magnetic"] = self._seconds["magnetic"]
        row["wall_contact"] = self._seconds["contact"]
        row["wall_total"] = perf_counter() - self._begin
        return row

    def _close_energy(self, row: dict[str, float]) -> None:
        steps = self._steps
        row["kinetic_energy"] = steps[-1].energy_budget.kinetic_energy
        row["elastic_energy"] = steps[-1].energy_budget.elastic_energy
        row["work_walls"] = sum(sum(s.energy_budget.wall_work.values()) for s in steps)
        if self._simulation.holds_forces:
            row[self._work_held] = sum(s.energy_budget.external_work for s in steps)
        if self._simulation.motion.gravity is not None:
            row["work_gravity"] = sum(s.energy_budget.gravity_work for s in steps)
        for kind in steps[-1].energy_budget.dissipation:
            row[f"dissipated_{kind}"] = sum(s.energy_budget.dissipation[kind] for s in steps)
        row["dissipated"] = sum(sum(s.energy_budget.dissipation.values()) for s in steps)
        stored = sum(s.energy_budget.kinetic_change + s.energy_budget.elastic_change for s in steps)
        row["energy_residual"] = (
            row["work_walls"]
            + row.get(self._work_held, 0.0)
            + row.get("work_gravity", 0.0)
            - row["dissipated"]
            - stored
        )


def _solver_row(steps: list) -> dict[str, float]:
    """Return what the solver of rigid contacts has done: sweeps a step, worst residual [m/s], steps that missed, ..."""
    n = sum(s.steps for s in steps)
    return {
        "sweeps": sum(s.sweeps for s in steps) / n,
        "largest_sweeps": max(s.max_sweeps for s in steps),
        "solver_residual": max(s.residual for s in steps),
        "missed_steps": sum(s.missed_steps for s in steps),
        "warm_hits": sum(s.warm_hits * s.steps for s in steps) / n,
        "stabilisation_work": sum(s.stabilisation_work for s in steps),
    }


def _weight_torque(motion) -> float:
    """Torque of the grains' weight about z [N m]: sum of m (x g_y - y g_x)."""
    g = motion.gravity_now
    if g is None:
        return 0.0
    moment = motion.grains.mass @ motion.grains.position[:, :2]
    return float(moment[0] * g[1] - moment[1] * g[0])
