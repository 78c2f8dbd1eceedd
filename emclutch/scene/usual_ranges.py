"""Usual ranges of a scene's entries; one outside is allowed, but warned of: unit or decimal point is likely wrong.

The ranges are those of dry metal powders, shot and coils of clutches: handbook values, unless a source is named.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
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
    """

    low: float
    high: float
    unit: str
    why: str
    ask: str

    def remark(self, name: str, value: float) -> str | None:
        """Remark on a value in `unit`; None within the range."""
        if self.low <= value <= self.high:
            return None
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"{name} = {value:.4g}{unit} is outside the usual range of {self.low:g} to {self.high:g}{unit} "
            f"({self.why}); {self.ask}"
        )


USUAL_FRICTION = 0.3
"""Coulomb coefficient where none is given, also of `emclutch shear-cell`: rough grains of metal."""
FRICTION = UsualRange(0.05, 1.0, "", "lubricated steel to rough grains; dry steel on steel 0.1 to 0.6",
                      "is a decimal point missing?")  # fmt: skip
RESTITUTION = UsualRange(0.05, 0.98, "", "plastic impacts to bearing balls on glass; W. Goldsmith, Impact, 1960",
                         "1 loses nothing, and such a powder never comes to rest")  # fmt: skip
DENSITY = UsualRange(2000.0, 9000.0, "kg/m^3", "glass 2500, ferrite 5000, steel 7700, nickel 8900",
                     "it is that of the grains, not of the heap; is g/cm^3 meant, as in '7.7 g/cm^3'?")  # fmt: skip
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
        entries.append((DENSITY, "particles.density", scene.particles.density))
    entries += [
        (FRICTION, f"contact.{key}", value)
        for key in ("friction", "wall_friction")
        if (value := getattr(contact, key))  # neither left out nor 0
    ]
    for one in scene.effects.present:
        entries += [(usual, f"effects.{one.name}.{key}", getattr(one, key)) for key, usual in one.USUAL.items()]
    if scene.field is not None:
        entries += scene.field.usual_entries()
    yield from (text for usual, key, value in entries if value is not None and (text := usual.remark(key, value)))
    yield from _of_the_shafts(scene)
    yield from _of_the_winding(scene)


def _of_the_shafts(scene: Any) -> Iterator[str]:
    if not scene.geometry.has_axis:
        return
    radius = scene.shape().largest_radius
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
        yield text
