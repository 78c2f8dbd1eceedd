"""Totals of a call of `DVI.run`: those of any engine, and those of the solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from particles.bodies import Body
from particles.dvi import end_of_step, flow_in_box
from particles.sheared_box import ShearedBox
from particles.step_totals import BoxStress, EnergyTotals, StepTotals, force_on_ring

FLUXES = (flow_in_box.CONTACT, flow_in_box.ATTRACTION, flow_in_box.MOTION)


@dataclass(frozen=True, slots=True)
class DviTotals(StepTotals):
    """Totals of a run by DVI; ``energy.dissipation`` has "impact", "sliding" and, where simulated, "rolling"
    and "twisting"; no force is "damping".

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
    accelerated_steps : int
        Steps that the accelerated solver finished.
    warm_hits : float
        Fraction of the loaded contacts that had an impulse to start from.
    projections : int
        Sweeps over the positions that removed overlap (they conserve no angular momentum).
    stabilisation_work : float
        Work of the lagged forces on the displacements that removed overlap [J].
    """

    sweeps: int
    max_sweeps: int
    visits: int
    residual: float
    missed_steps: int
    accelerated_steps: int
    warm_hits: float
    projections: int
    stabilisation_work: float


def dvi_totals(
    steps: int,
    dt: float,
    ring: int,
    bodies: Sequence[Body],
    totals: np.ndarray,
    body_totals: np.ndarray,
    energy: EnergyTotals,
    rebuilds: int,
    stress: BoxStress | None,
) -> DviTotals:
    """Totals of ``steps`` of ``dt`` [s], by the sums of the run and of its bodies.

    ``ring`` is the number of sectors, of one of which the sums are.
    """
    per_step = ring / max(steps, 1)
    names = [body.name for body in bodies]
    return DviTotals(
        steps=steps,
        duration=steps * dt,
        torque={
            name: {
                "normal": float(t[end_of_step.TORQUE_N]) * per_step,
                "damping": 0.0,
                "tangential": float(t[end_of_step.TORQUE_T]) * per_step,
            }
            for name, t in zip(names, body_totals, strict=True)
        },
        force={
            name: force_on_ring(row[end_of_step.FORCE_X : end_of_step.FORCE_X + 3] * per_step, ring)
            for name, row in zip(names, body_totals, strict=True)
        },
        shaft_work={
            body.name: {
                "drive": float(t[end_of_step.DRIVE_WORK]),
                "load": float(t[end_of_step.LOAD_WORK]),
                "contact": -ring * float(t[end_of_step.BODY_WORK]),
            }
            for body, t in zip(bodies, body_totals, strict=True)
            if body.is_free
        },
        energy=energy,
        max_overlap=float(totals[end_of_step.MAX_OVERLAP]),
        n_contacts=int(totals[end_of_step.CONTACTS]),
        max_speed=float(totals[end_of_step.MAX_SPEED]),
        rebuilds=rebuilds,
        stress=stress,
        sweeps=int(totals[end_of_step.SWEEPS]),
        max_sweeps=int(totals[end_of_step.MAX_SWEEPS]),
        visits=int(totals[end_of_step.VISITS]),
        residual=float(totals[end_of_step.RESIDUAL]),
        missed_steps=int(totals[end_of_step.MISSED]),
        accelerated_steps=int(totals[end_of_step.ACCELERATED]),
        warm_hits=float(totals[end_of_step.KEPT] / max(totals[end_of_step.LOADED], 1.0)),
        projections=int(totals[end_of_step.PROJECTIONS]),
        stabilisation_work=ring * float(totals[end_of_step.STABILISATION]),
    )


def rigid_energy_budget(
    ring: int,
    bodies: Sequence[Body],
    totals: np.ndarray,
    body_totals: np.ndarray,
    resist: np.ndarray,
    kinetic: tuple[float, float],
    elastic: tuple[float, float],
    through_shear: dict[str, float],
) -> EnergyTotals:
    """The energy budget; ``resist`` (2, 2) are mu_r and mu_w, ``through_shear`` the works of a sheared box.

    ``kinetic`` and ``elastic`` are before and now [J], as all sums those of one of the ``ring``'s sectors.
    """
    work = ring * totals
    return EnergyTotals(
        wall_work={
            body.name: ring * float(t[end_of_step.BODY_WORK]) for body, t in zip(bodies, body_totals, strict=True)
        },
        dissipation={
            "impact": float(work[end_of_step.IMPACT]),
            "sliding": float(work[end_of_step.SLIDING]),
            **({"rolling": float(work[end_of_step.ROLLING])} if resist[:, 0].any() else {}),
            **({"twisting": float(work[end_of_step.TWISTING])} if resist[:, 1].any() else {}),
        },
        # what the kernel adds up is the work on the relative motion, that of the flow included
        contact_work=float(work[end_of_step.CONTACT_WORK]) + through_shear.get("contacts", 0.0),
        gravity_work=float(work[end_of_step.GRAVITY_WORK]),
        external_work=float(work[end_of_step.EXTERNAL_WORK]),
        kinetic_energy=ring * kinetic[1],
        kinetic_change=ring * (kinetic[1] - kinetic[0]),
        elastic_energy=ring * elastic[1],
        elastic_change=ring * (elastic[1] - elastic[0]),
        shear_work=through_shear,
    )


def dvi_box_stress(duration: float, box: ShearedBox, sums: np.ndarray) -> BoxStress:
    """Mean over ``duration`` [s] of the sums of a sheared box (`particles.dvi.flow_in_box`)."""
    scale = 1.0 / (duration * box.volume)
    return BoxStress(*(scale * sums[first : first + 9].reshape(3, 3) for first in FLUXES))


def shear_work(box: ShearedBox, sums: np.ndarray) -> dict[str, float]:
    """Works [J] of the shear on the grains, -rate times the flux of momentum along x across z."""
    works = (-box.rate * float(sums[first + 2]) for first in FLUXES)
    return dict(zip(("contacts", "attraction", "motion"), works, strict=True))
