"""Usual ranges of a scene's entries; one outside is allowed, but warned of: unit or decimal point is likely wrong.

The ranges are those of dry metal powders, shot and coils of clutches: handbook values, unless a source is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class UsualRange:
    """Usual range of a quantity.

    Attributes
    ----------
    low, high : float
        In `unit`.
    unit : str
        Unit of the message; empty for a pure number.
    why : str
        Examples at the ends, with their source.
    ask : str
        Likely mistake behind a value outside.
    bare : float
        Number without a unit of a value of 1 in `unit`: 1e6 for 1 MA/m, since bare numbers are SI.
    meant : dict of str to float
        Units in which the bare number may have been meant, with their values in `unit`.
    """

    low: float
    high: float
    unit: str
    why: str
    ask: str
    bare: float = 1.0
    meant: Mapping[str, float] = field(default_factory=dict)

    def remark(self, name: str, value: float) -> str | None:
        """Remark on a value in `unit`; None within the range."""
        if self.low <= value <= self.high:
            return None
        unit, number = f" {self.unit}" if self.unit else "", value * self.bare
        meant = next((one for one, size in self.meant.items() if self.low <= number * size <= self.high), None)
        ask = self.ask if meant is None else f"{number:.4g} is usual in {meant}: if that is meant, write "
        return (
            f"{name} = {value:.4g}{unit} is outside the usual range of {self.low:g} to {self.high:g}{unit} "
            f"({self.why}); {ask}" + ("" if meant is None else f"'{number:.4g} {meant}'")
        )


USUAL_FRICTION = 0.3
"""Coulomb coefficient where none is given: rough grains of metal."""
FRICTION = UsualRange(0.05, 1.0, "", "lubricated steel to rough grains; dry steel on steel 0.1 to 0.6",
                      "is a decimal point missing?")  # fmt: skip
RESTITUTION = UsualRange(0.05, 0.98, "", "plastic impacts to bearing balls on glass; W. Goldsmith, Impact, 1960",
                         "1 loses nothing, and such a powder never comes to rest")  # fmt: skip
DENSITY = UsualRange(2000.0, 9000.0, "kg/m^3", "glass 2500, ferrite 5000, steel 7700, nickel 8900",
                     "it is that of the grains, not of the heap; is g/cm^3 meant, as in '7.7 g/cm^3'?",
                     meant={"g/cm^3": 1000.0})  # fmt: skip
SATURATION = UsualRange(0.1, 2.5, "MA/m", "ferrite 0.3, nickel 0.5, iron 1.7, iron-cobalt 1.9",
                        "is the unit right, as in '1.7 MA/m'?", 1e6, {"MA/m": 1.0, "kA/m": 1e-3})  # fmt: skip
SIZE = UsualRange(1e-3, 20.0, "mm", "carbonyl iron 0.001 to 0.01, powder of brakes 0.02 to 0.2, shot 0.2 to 5",
                  "a bare number is in metres; is the unit right, as in '60 um'?", 1e-3,
                  {"mm": 1.0, "um": 1e-3})  # fmt: skip
RADIUS = UsualRange(1.0, 2000.0, "mm", "small brakes 10, large clutches 500",
                    "bare numbers are in metres; are the units right, as in '20 mm'?", 1e-3, {"mm": 1.0})  # fmt: skip
GAP = UsualRange(0.05, 12.0, "mm", "powder clutches 0.3 to 3, shot 5", "is the unit right, as in '1 mm'?", 1e-3,
                 {"mm": 1.0})  # fmt: skip
STIFFNESS = UsualRange(10.0, 1e9, "N/m", "light loads at 60 um to shot of 5 mm",
                       "is the unit right, as in '50 kN/m'?", meant={"kN/m": 1e3, "MN/m": 1e6})  # fmt: skip
MODULUS = UsualRange(1e-4, 1000.0, "GPa", "softened grains 0.001 to 0.1, glass 70, steel 210, tungsten carbide 650",
                     "is the unit right, as in '10 MPa'?", 1e9, {"GPa": 1.0, "MPa": 1e-3})  # fmt: skip
ACCELERATION = UsualRange(0.0, 1000.0, "m/s^2", "Moon 1.6, Earth 9.81",
                          "is the unit right, as in '9.81 m/s^2'?", meant={"mm/s^2": 1e-3})  # fmt: skip
WORK_OF_ADHESION = UsualRange(0.0, 10.0, "J/m^2", "dry steel some 0.05, clean metals 1 to 4",
                              "is the unit right, as in '50 mJ/m^2'?", meant={"mJ/m^2": 1e-3})  # fmt: skip
SPEED = UsualRange(0.0, 100.0, "m/s", "rims of steel wheels; grinding wheels run at 30 to 100",
                   "a bare number is in rad/s; is rpm meant, as in '1000 rpm'?")  # fmt: skip
FLUX_DENSITY = UsualRange(0.0, 2.5, "T", "iron saturates at 2.2 T; more takes superconductors or pulses",
                          "are current, turns and gap, or field strength, in the units that were meant?")  # fmt: skip
CURRENT_DENSITY = UsualRange(0.0, 30.0, "A/mm^2", "3 to 6 for long without forced cooling, 10 with it, 30 for seconds",
                             "are current, turns and window in the units that were meant?")  # fmt: skip


def unusual_entries(scene: Any) -> Iterator[str]:
    """Yield a remark for each entry of a scene that is outside its usual range; a friction of 0 is asked for."""
    contact = scene.contact
    entries: list[tuple[UsualRange, str, float | None]] = [
        (RESTITUTION, "contact.restitution", contact.restitution),
        (RESTITUTION, "contact.wall_restitution", contact.wall_restitution),
    ]
    if scene.particles is not None:
        entries += [
            (DENSITY, "particles.density", scene.particles.density),
            (SATURATION, "particles.saturation", 1e-6 * scene.particles.saturation),
            (SIZE, _size_key(scene.particles), 1e3 * scene.particles.mean_diameter),
        ]
        if (real := scene.particles.real_diameter) is not None:
            entries.append((SIZE, "particles.stands_for", 1e3 * real))
    for name, own in scene.materials.items():
        entries.append((DENSITY, f"materials.{name}.density", own.density))
        if (saturation := getattr(own, "saturation", None)) is not None:
            entries.append((SATURATION, f"materials.{name}.saturation", 1e-6 * saturation))
    moduli = ("youngs_modulus", 1e-9, MODULUS), ("shear_modulus", 1e-9, MODULUS), ("stiffness", 1.0, STIFFNESS)
    entries += [
        (usual, f"contact.{key}", factor * value)
        for name, factor, usual in moduli
        for key in (name, f"wall_{name}")
        if (value := getattr(contact, key)) is not None
    ]
    entries += [
        (FRICTION, f"contact.{key}", value)
        for key in ("friction", "wall_friction")
        if (value := getattr(contact, key))  # neither left out nor 0
    ]
    for key in ("gap", "face_gap"):
        if value := getattr(scene.geometry, key, None):
            entries.append((GAP, f"geometry.{key}", 1e3 * value))
    for one in scene.effects.present:
        entries += [(usual, f"effects.{one.name}.{key}", getattr(one, key)) for key, usual in one.USUAL.items()]
    if scene.field is not None:
        entries += scene.field.usual_entries()
    yield from (text for usual, key, value in entries if value is not None and (text := usual.remark(key, value)))
    yield from _of_the_shafts(scene)
    yield from _of_the_winding(scene)


def _size_key(particles: Any) -> str:
    if particles.diameter is not None:
        return "particles.diameter"
    return f"particles.{'packing_file' if particles.sizes is None else 'sizes'}: the mean diameter"


def _of_the_shafts(scene: Any) -> Iterator[str]:
    if not scene.geometry.has_axis:
        return
    radius = scene.shape().largest_radius
    text = RADIUS.remark("[geometry]: the largest radius", 1e3 * radius) if radius else None  # 0: nothing turns
    if text:
        yield text
    for shaft in ("rotor", "disc"):
        speed = getattr(scene.motion, shaft).largest_speed
        text = SPEED.remark(f"motion.{shaft}: the speed at r = {1e3 * radius:.3g} mm", speed * radius)
        if text:
            yield text


def _of_the_winding(scene: Any) -> Iterator[str]:
    if scene.coil is None or not scene.geometry.has_coil:
        return
    shape = scene.shape()
    window = shape.coil_area, shape.coil_mean_radius
    current = scene.coil.currents_in(*window).largest
    density = 1e-6 * scene.coil.winding_in(*window).current_density(current)
    text = CURRENT_DENSITY.remark("[coil]: the current density in the copper", density)
    if text:
        drive = "voltage" if scene.coil.is_at_voltage else "current"
        own = "geometry.coil_width or coil_height" if hasattr(scene.geometry, "coil_width") else "the coil's window"
        # at a voltage the density in so many turns of copper depends on nothing else
        of_turns = scene.coil.is_at_voltage and scene.coil.resistance is None
        share = CURRENT_DENSITY.high / density
        yield f"{text} Lower coil.{drive} to {share:.2g} of it, or raise {'coil.turns' if of_turns else own}"
