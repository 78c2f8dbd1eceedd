"""What the sections of a random scene must agree on, so that more of them run: the commonest contradictions removed."""

from __future__ import annotations

from typing import Any

Table = dict[str, Any]


def agreed(scene: Table) -> Table:
    """The scene, changed in place."""
    for settle in (_sector, _field, _moments, _coil, _contact, _packing):
        settle(scene, scene["effects"], scene["particles"], scene["contact"])
    return scene


def _sector(scene: Table, effects: Table, particles: Table, contact: Table) -> None:
    """What turns from sector to sector cannot stand beside one."""
    if "sector" in particles:
        effects.get("gravity", {}).pop("direction", None)
        if scene.get("field", {}).get("direction") in ("x", "y"):
            scene["field"]["direction"] = "z"


def _field(scene: Table, effects: Table, particles: Table, contact: Table) -> None:
    field = scene.get("field", {})
    if field.get("direction") == "radial" and scene["geometry"]["kind"] != "shear_cell":
        field["direction"] = "axial"
    if "surfaces" not in scene and scene["geometry"]["kind"] == "box":
        scene.pop("motion", None)
    if "mine" in scene["geometry"].get("materials", {}).values():
        scene.setdefault("materials", {"mine": {"law": "linear", "relative_permeability": 300}})


def _moments(scene: Table, effects: Table, particles: Table, contact: Table) -> None:
    """Effects that need others, and models that exclude a law."""
    dipoles = effects.get("dipoles")
    if dipoles is None:
        effects.pop("wall_images", None)
        effects.pop("back_reaction", None)
        if "magnetic_force" not in effects:
            effects.pop("saturation", None)
        return
    particles.pop("law", None)
    necks = dipoles.get("model", "near_field") == "near_field"
    dipoles["cutoff"] = max(2.5 if necks else 2.0, dipoles.get("cutoff", 3.0))
    if necks:
        effects["saturation"] = {}
        for key in ("susceptibility", "saturation"):  # the table of pairs is there for the default grains only
            particles.pop(key, None)


def _coil(scene: Table, effects: Table, particles: Table, contact: Table) -> None:
    """Its transients need a voltage and an effect that feels them, and no slots."""
    coil = scene.get("coil", {})
    felt = "dipoles" in effects or "magnetic_force" in effects
    slotted = {"disc_slots", "rotor_slots"} & scene["geometry"].keys()
    if "voltage" not in coil or not felt or slotted:
        effects.pop("coil_circuit", None)
    if not felt or slotted:
        effects.pop("eddy_currents", None)
    if slotted:
        effects.pop("back_reaction", None)
        particles.pop("sector", None)
    if {"turns", "resistance"} <= coil.keys() and "current" in coil:
        del coil["resistance"]


def _contact(scene: Table, effects: Table, particles: Table, contact: Table) -> None:
    """Solvers and what they solve."""
    if contact["law"] == "walton_braun" and "stiffness" not in contact:
        for key in ("unloading_stiffness", "wall_unloading_stiffness", "wall_stiffness"):
            contact.pop(key, None)


def _packing(scene: Table, effects: Table, particles: Table, contact: Table) -> None:
    if particles.get("packing") == "pour":
        effects.setdefault("gravity", {})
        particles |= {"settle_longest": "1 ms", "settle_kinetic": 0.05}
