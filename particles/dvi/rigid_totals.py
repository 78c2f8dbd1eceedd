"""What a call of `DVI.run` did: the totals of any engine, and what the solver needed; from the sums of the step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from particles.bodies import Body
from particles.dem.step_totals import EnergyTotals, StepTotals
from particles.dvi import step_books as books


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


def rigid_totals(
    steps: int,
    dt: float,
    bodies: Sequence[Body],
    totals: np.ndarray,
    of_bodies: np.ndarray,
    energy: EnergyTotals,
    rebuilds: int,
) -> RigidTotals:
    """What ``steps`` of ``dt`` [s] did, by the sums of the run and of its bodies."""
    share = 1.0 / max(steps, 1)
    names = [body.name for body in bodies]
    normal = of_bodies[:, books.NORMAL_X : books.NORMAL_Z + 1] * share
    whole = of_bodies[:, books.FORCE_X : books.FORCE_Z + 1] * share
    return RigidTotals(
        steps=steps,
        duration=steps * dt,
        torque={
            name: {
                "normal": float(t[books.TORQUE_N]) * share,
                "damping": 0.0,
                "tangential": float(t[books.TORQUE_T]) * share,
            }
            for name, t in zip(names, of_bodies, strict=True)
        },
        force=dict(zip(names, whole, strict=True)),
        force_parts={
            name: {"normal": n, "damping": np.zeros(3), "tangential": f - n}
            for name, n, f in zip(names, normal, whole, strict=True)
        },
        shaft_work={
            body.name: {
                "drive": float(t[books.DRIVE_WORK]),
                "load": float(t[books.LOAD_WORK]),
                "contact": -float(t[books.BODY_WORK]),
            }
            for body, t in zip(bodies, of_bodies, strict=True)
            if body.is_free
        },
        energy=energy,
        max_overlap=float(totals[books.MAX_OVERLAP]),
        n_contacts=int(totals[books.CONTACTS]),
        max_speed=float(totals[books.MAX_SPEED]),
        rebuilds=rebuilds,
        sweeps=int(totals[books.SWEEPS]),
        max_sweeps=int(totals[books.MAX_SWEEPS]),
        visits=int(totals[books.VISITS]),
        residual=float(totals[books.RESIDUAL]),
        missed_steps=int(totals[books.MISSED]),
        taken_over=int(totals[books.TAKEN_OVER]),
        warm_hits=float(totals[books.KEPT] / max(totals[books.LOADED], 1.0)),
        projections=int(totals[books.PROJECTIONS]),
        stabilisation_work=float(totals[books.STABILISATION]),
    )


def rigid_books(
    bodies: Sequence[Body],
    totals: np.ndarray,
    of_bodies: np.ndarray,
    resist: np.ndarray,
    kinetic: tuple[float, float],
    elastic: tuple[float, float],
) -> EnergyTotals:
    """The books of energy; ``resist`` (2, 2) are mu_r and mu_w, ``kinetic`` and ``elastic`` before and now [J]."""
    return EnergyTotals(
        wall_work={body.name: float(t[books.BODY_WORK]) for body, t in zip(bodies, of_bodies, strict=True)},
        dissipation={
            "impact": float(totals[books.IMPACT]),
            "sliding": float(totals[books.SLIDING]),
            **({"rolling": float(totals[books.ROLLING])} if resist[:, 0].any() else {}),
            **({"twisting": float(totals[books.TWISTING])} if resist[:, 1].any() else {}),
        },
        contact_work=float(totals[books.CONTACT_WORK]),
        gravity_work=float(totals[books.GRAVITY_WORK]),
        external_work=float(totals[books.EXTERNAL_WORK]),
        kinetic_energy=kinetic[1],
        kinetic_change=kinetic[1] - kinetic[0],
        elastic_energy=elastic[1],
        elastic_change=elastic[1] - elastic[0],
    )
