"""Axial magnetic force on the bodies of a device that can move: which regions they are, and how it is told."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from emclutch.device.device import CoilDevice
from field import ConvergenceError, MagneticField
from field.section.maxwell_force import UndefinedForce, axial_force, gives_way

MOVABLE = ("disc", "rotor")


def movable_bodies(coil: CoilDevice, solution: MagneticField) -> Iterator[tuple[str, list[str]]]:
    """Yield each movable body of the device with its regions; see `regions_of_body`."""
    for body in MOVABLE:
        regions = regions_of_body(coil, solution, body)
        if regions:
            yield body, regions


def regions_of_body(coil: CoilDevice, solution: MagneticField, body: str) -> list[str]:
    """Regions that are pulled as one body: those that bear its name, and what turns with it and carries flux.

    Steel covers belong to the rotor that they close; between parts that touch and turn together no force is asked.
    """
    problem, chosen = solution.problem, []
    for name in coil.mesh.regions:
        named = next((own for own in MOVABLE if name == own or name.startswith(f"{own}_")), None)
        if named is None and name not in ("air", problem.coil_region, problem.powder_region):
            named = None if gives_way(problem, name, solution) else coil.shape.body(name)
        if named == body:
            chosen.append(name)
    return chosen


def force_on(solution: MagneticField, regions: Sequence[str]) -> dict:
    """Axial force [N] on a body through air and powder, and what of it is not to be had, with the reason."""
    yielding = _yielding(solution)
    try:
        force = axial_force(solution, regions, yielding=yielding)
    except UndefinedForce as error:
        return {"regions": list(regions), "not_defined": f"because {error.reason}"}
    missing = {}
    # One by one: where the displaced device does not converge, the error estimate may, and the reverse.
    for part, asked in (("virtual_work", {"virtual_work": True}), ("next_order", {"next_order": True})):
        try:
            found = axial_force(solution, regions, yielding=yielding, **asked)
        except ConvergenceError as error:
            missing[part] = str(error)
        else:
            force = replace(force, **{part: getattr(found, part)})
    row: dict = {
        "regions": list(regions),
        "maxwell_stress": force.maxwell_stress,
        "virtual_work": force.virtual_work,
        "error_estimate": force.error,
    }
    if "virtual_work" in missing:
        row["no_virtual_work"] = f"because a displaced solve failed: {missing['virtual_work']}"
    if "next_order" in missing:
        row["error_estimate_of_two_shells"] = f"because the solve of the next order failed: {missing['next_order']}"
    return row


def force_in_words(solution: MagneticField, regions: Sequence[str]) -> str:
    """Axial force on a body with its error, which a solve with elements of the next order tells; empty without one."""
    force = stress_force(solution, regions)
    if force is None:
        return ""
    try:
        error = axial_force(solution, regions, yielding=_yielding(solution), next_order=True).error
    except ConvergenceError:
        return f"{force:.4g} N along z, error not known"
    doubt = "; smaller than its error: none is known" if abs(force) <= error else ""
    return f"{force:.4g} ± {error:.2g} N along z (twice the change to elements of the next order){doubt}"


def stress_force(solution: MagneticField, regions: Sequence[str]) -> float | None:
    """Axial force [N] on a body by the Maxwell stress alone; None where none is defined."""
    try:
        return axial_force(solution, regions, yielding=_yielding(solution)).maxwell_stress + 0.0  # no -0
    except UndefinedForce:
        return None


def _yielding(solution: MagneticField) -> list[str]:
    """Powder gives way to a body, as a fluid at constant fill."""
    return [name for name in ("powder",) if name in solution.problem.mesh.regions]
