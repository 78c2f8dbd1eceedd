"""From the sums of the compiled step to `StepTotals`: means over the steps, of the whole ring."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from particles.bodies import Body
from particles.dem import box_kernel, total_columns
from particles.dem.contact_columns import ContactColumns
from particles.sheared_box import ShearedBox
from particles.step_totals import BoxStress, EnergyTotals, StepTotals, force_on_ring

TORQUES = {"normal": total_columns.TORQUE_N, "damping": total_columns.TORQUE_D, "tangential": total_columns.TORQUE_T}
WORKS = {
    "contacts": box_kernel.CONTACT_WORK,
    "attraction": box_kernel.PULL_WORK,
    "motion": box_kernel.MOTION_WORK,
}
SYMMETRIC = (box_kernel.PULL, box_kernel.MOTION)
FORCES = total_columns.FORCE_N, total_columns.FORCE_D, total_columns.FORCE_T


def summary(
    steps: int,
    dt: float,
    ring: int,
    bodies: Sequence[Body],
    totals: np.ndarray,
    body_totals: np.ndarray,
    energy: EnergyTotals | None,
    rebuilds: int,
    stress: BoxStress | None,
) -> StepTotals:
    """Totals of ``steps`` of ``dt`` [s]; ``ring`` is the number of sectors, of one of which the sums are."""
    per_step = ring / max(steps, 1)
    rows = dict(zip([body.name for body in bodies], body_totals, strict=True))
    return StepTotals(
        steps=steps,
        duration=steps * dt,
        torque={name: {kind: float(row[c]) * per_step for kind, c in TORQUES.items()} for name, row in rows.items()},
        force={
            name: force_on_ring(per_step * sum((row[first : first + 3] for first in FORCES), np.zeros(3)), ring)
            for name, row in rows.items()
        },
        shaft_work={
            body.name: {
                "drive": float(row[total_columns.DRIVE_WORK]),
                "load": float(row[total_columns.LOAD_WORK]),
                "contact": float(row[total_columns.SHAFT_CONTACT_WORK]),
            }
            for body, row in zip(bodies, body_totals, strict=True)
            if body.is_free
        },
        energy=energy,
        max_overlap=float(totals[total_columns.MAX_OVERLAP]),
        n_contacts=int(totals[total_columns.CONTACTS]),
        max_speed=float(np.sqrt(totals[total_columns.MAX_SQUARED_SPEED])),
        rebuilds=rebuilds,
        stress=stress,
    )


def energy_budget(
    ring: int,
    bodies: Sequence[Body],
    totals: np.ndarray,
    body_totals: np.ndarray,
    columns: ContactColumns,
    kinetic: tuple[float, float],
    elastic: tuple[float, float],
    box: np.ndarray | None,
) -> EnergyTotals:
    """The energy budget; ``kinetic`` and ``elastic`` are before and now [J], as all sums those of one sector.

    ``box`` are the sums of a sheared box, None outside of one.
    """
    work = ring * totals
    return EnergyTotals(
        wall_work={
            body.name: ring * float(row[total_columns.BODY_WORK]) for body, row in zip(bodies, body_totals, strict=True)
        },
        dissipation={
            "normal_damping": float(work[total_columns.NORMAL_DAMPING]),
            "tangential_damping": float(work[total_columns.TANGENTIAL_DAMPING]),
            "sliding": float(work[total_columns.SLIDING]),
            **({} if not columns.rolls else {"rolling": float(work[total_columns.ROLLING])}),
            **({} if not columns.twists else {"twisting": float(work[total_columns.TWISTING])}),
        },
        contact_work=float(work[total_columns.CONTACT_WORK]),
        gravity_work=float(work[total_columns.GRAVITY_WORK]),
        external_work=float(work[total_columns.EXTERNAL_WORK]),
        kinetic_energy=ring * kinetic[1],
        kinetic_change=ring * (kinetic[1] - kinetic[0]),
        elastic_energy=ring * elastic[1],
        elastic_change=ring * (elastic[1] - elastic[0]),
        shear_work={} if box is None else {name: float(box[column]) for name, column in WORKS.items()},
    )


def dem_box_stress(steps: int, box: ShearedBox, sums: np.ndarray) -> BoxStress:
    """Mean over ``steps`` of the sums of a sheared box."""
    scale = 1.0 / (max(steps, 1) * box.volume)
    contacts = sums[box_kernel.CONTACT : box_kernel.PULL].reshape(3, 3).T
    return BoxStress(scale * contacts, *(scale * _symmetric(sums[k : k + 6]) for k in SYMMETRIC))


def _symmetric(parts: np.ndarray) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = parts
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
