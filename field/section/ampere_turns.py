"""How the coil's ampere-turns divide among the parts of a section: the magnetic potential drop of each.

Of the solved field, with H = nu B - M in the powder, the weak form tested with the solution itself is

    N I Phi = integral over all space of H . B dV,        Phi the flux through a mean turn,

whatever the materials' laws (the discrete solution satisfies it to Newton's residual). The fraction of a part is

    (N I)_part = integral over the part of H . B dV / Phi        [A].

A part that carries the whole flux has its potential drop H l, as in the magnetic circuit of a text book; one that
carries a part of the flux (leakage through the coil's window and the air) counts with that part. The shares add up to
N I. Those of air and coil are flux that passes by the powder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from field.section.magnetic_field import MagneticField
from geometry import AnnularBox

OPEN_BOUNDARY = "beyond the mesh"
"""Name of what an open boundary adds."""


def ampere_turns_by_part(
    solution: MagneticField, spaces: Mapping[str, Sequence[AnnularBox]] | None = None
) -> dict[str, float]:
    """Ampere-turns of each region, the largest first [A]; their sum is N I.

    Parameters
    ----------
    solution : MagneticField
        A field with a current.
    spaces : mapping of str to sequence of AnnularBox, or None
        Parts of the air by name (a running clearance); triangles of the air with their centroid inside are counted
        there.

    Raises
    ------
    ValueError
        Without current, in a field of sources far away, or with hysteresis, where H is no function of B.
    """
    problem, elements = solution.problem, solution.problem.elements
    if solution.ampere_turns == 0.0 or solution.boundary_field != 0.0 or solution.history is not None:
        raise ValueError("ampere-turns divide among parts in the field of a coil alone, with a current, no hysteresis")
    gradient = elements.gradient(solution.psi)
    B = np.hypot(gradient[:, 0], gradient[:, 1]) / elements.radius
    H, _ = problem.H_of_B(B, solution.powder)
    density = H * B
    if solution.powder is not None and solution.powder.source is not None:
        own, M = problem.powder_elements, solution.powder.source  # r B = (-psi_z, psi_r)
        density[own] -= (gradient[own, 0] * M[:, 1] - gradient[own, 1] * M[:, 0]) / elements.radius[own]
    work = 2.0 * np.pi * (density * elements.radius * elements.weight).sum(axis=1)  # of each element [J]
    mesh = problem.mesh
    parts = {name: np.asarray(region) for name, region in mesh.regions.items()}
    r, z = mesh.centroid().T
    for name, boxes in (spaces or {}).items():
        inside, air = np.zeros(r.size, dtype=bool), parts["air"]
        for box in boxes:
            inside |= (box.r0 < r) & (r < box.r1) & (box.z0 < z) & (z < box.z1)
        parts[name], parts["air"] = air[inside[air]], air[~inside[air]]
    works = {name: float(work[part].sum()) for name, part in parts.items()}
    if problem.exterior is not None:
        works[OPEN_BOUNDARY] = 4.0 * np.pi * problem.exterior.energy(solution.psi)
    flux = solution.flux_linkage_per_turn
    return {name: works[name] / flux for name in sorted(works, key=works.__getitem__, reverse=True)}


def ampere_turns_in_words(parts: Mapping[str, float], least: float = 0.01) -> str:
    """Fractions of N I in per cent, the largest first; parts below the fraction `least` are added up as others."""
    total = sum(parts.values())
    shown = {name: value / total for name, value in parts.items() if value >= least * total}
    words = [f"{name} {100.0 * fraction:.3g} %" for name, fraction in shown.items()]
    rest = 1.0 - sum(shown.values())
    if len(shown) < len(parts):
        words.append(f"others {100.0 * rest:.2g} %")
    return f"{total:.4g} A: {', '.join(words)}"
