"""Axial magnetic force on the bodies of a device that can move: which regions they are, and the force in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from emclutch.device_model.device import CoilDevice
from field import ConvergenceError, MagneticField
from field.section.error_estimate import next_order_field
from field.section.maxwell_force import (
    UndefinedForce,
    axial_force,
    force_by_virtual_work,
    force_of_weight,
    is_deformable,
)

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
            named = None if is_deformable(problem, name, solution) else coil.shape.body(name)
        if named == body:
            chosen.append(name)
    return chosen


def forces_on(solution: MagneticField, bodies: Iterable[tuple[str, Sequence[str]]]) -> dict[str, dict]:
    """Axial force [N] on each body, (name, regions), through air and powder; what is not to be had, with the reason."""
    richer, failure = _next_order(solution)
    return {name: _force_on(solution, regions, richer, failure) for name, regions in bodies}


def _force_on(solution: MagneticField, regions: Sequence[str], richer: MagneticField | None, failure: str) -> dict:
    try:
        force = axial_force(solution, regions, yielding=_yielding(solution))
    except UndefinedForce as error:
        return {"regions": list(regions), "not_defined": f"because {error.reason}"}
    row: dict = {"regions": list(regions), "maxwell_stress": force.maxwell_stress}
    try:
        row["virtual_work"] = force_by_virtual_work(solution, force.weight)
    except ConvergenceError as error:
        row |= {"virtual_work": None, "no_virtual_work": f"because a displaced solve failed: {error}"}
    if richer is None:
        row["error_estimate_of_two_shells"] = f"because the solve of the next order failed: {failure}"
    else:
        force = replace(force, next_order=force_of_weight(richer, force.weight))
    return row | {"error_estimate": force.error}


def forces_in_words(
    solution: MagneticField, bodies: Iterable[tuple[str, Sequence[str]]]
) -> Iterator[tuple[str, Sequence[str], str]]:
    """Each body with its regions and the axial force on it and its error; none on which no force is defined.

    The error is that of a solve with elements of the next order.
    """
    richer, _ = _next_order(solution)
    for name, regions in bodies:
        try:
            force = axial_force(solution, regions, yielding=_yielding(solution))
        except UndefinedForce:
            continue
        stress = force.maxwell_stress + 0.0  # no -0
        if richer is None:
            yield name, regions, f"{stress:.4g} N along z, error not known"
            continue
        error = replace(force, next_order=force_of_weight(richer, force.weight)).error
        doubt = "; not significant: smaller than its error" if abs(stress) <= error else ""
        text = f"{stress:.4g} ± {error:.2g} N along z (twice the change to elements of the next order){doubt}"
        yield name, regions, text


def _next_order(solution: MagneticField) -> tuple[MagneticField | None, str]:
    """The field of elements of the next order, or why there is none."""
    try:
        return next_order_field(solution), ""
    except ConvergenceError as error:
        return None, str(error)


def stress_force(solution: MagneticField, regions: Sequence[str]) -> float | None:
    """Axial force [N] on a body by the Maxwell stress alone; None where none is defined."""
    try:
        return axial_force(solution, regions, yielding=_yielding(solution)).maxwell_stress + 0.0  # no -0
    except UndefinedForce:
        return None


def _yielding(solution: MagneticField) -> list[str]:
    """Powder flows around a body, as a fluid at constant fill."""
    return [name for name in ("powder",) if name in solution.problem.mesh.regions]
