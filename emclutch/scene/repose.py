"""particles.repose: friction and rolling friction of the grains from the angle of repose of their powder.

The bulk friction tau/P of the sheared powder has two readings, between which a heap alone does not decide.

- **Sine** (taken): loosely heaped, powder rests at the angle of friction of its critical state (M. D. Bolton,
  Geotechnique 36 (1986) 65), and in plane strain tau/sigma on the plane that is sheared is the sine of that angle: it
  is not the plane on which tau/sigma is largest (P. W. Rowe, Geotechnique 19 (1969) 75; R. A. Jewell, Geotechnique 39
  (1989) 309).
- **Tangent**: a layer that flows down an endless slope is sheared on planes along it, on which tau/sigma is the tangent
  of its angle by equilibrium alone. The angle at which the flow stops is that of such a slope (Y. Forterre and O.
  Pouliquen, J. Fluid Mech. 486 (2003) 21).

For glass beads both agree within 1.5 degrees, at 30 degrees they are 0.50 and 0.58. tau/P of a shear tester needs
neither. The pairs of coefficients that give one bulk
friction are a line (`particles.bulk_friction.friction_table`). A scene takes the pair of the line that has the sliding
friction of dry steel, or the nearest to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene

if TYPE_CHECKING:
    from emclutch.scene.model import Scene
    from particles.bulk_friction.friction_table import FrictionPair

DRY_STEEL = 0.6
"""Sliding friction of dry mild steel on itself: 0.62 in J. R. Davis, Concise Metals Data Handbook (1997), table 14.1.

Tables have 0.42 (hard steel, sliding) to 0.78 (clean, at rest), and 0.27 under a thick film of oxide.
"""

HEAPS_REPEAT = math.radians(1.0)
"""Error of an angle of repose [rad] that is not said: the option --uncertainty has another."""

REL_TOL = 1e-6
"""Relative tolerance of coefficients: a resolved scene has both the angle of repose and what follows from it."""


def angle_in_words(angle: float) -> str:
    """Return an angle [rad] in degrees."""
    return f"{math.degrees(angle):.4g} deg"


def pair_by_tangent(angle: float) -> FrictionPair | None:
    """Return the pair for an angle of repose [rad] that is of a slope which flows, tau/P = tan; None: none gives it."""
    try:
        return pair_of_bulk_friction(math.tan(angle))
    except ValueError:
        return None


def tangent_in_words(angle: float) -> str:
    """Return what the other reading of an angle of repose [rad] would give."""
    pair = pair_by_tangent(angle)
    taken = (
        f"friction {pair.friction:.3g} and rolling friction {pair.rolling:.2g}"
        if pair is not None
        else "a bulk friction above that of all pairs"
    )
    return (
        f"the sine of the angle is taken as tau/P (a heap at rest). The tangent, {math.tan(angle):.3f} (a flowing "
        f"slope), gives {taken}. A measured tau/P avoids this choice: emclutch powder --internal-friction"
    )


def spread_of_bulk_friction(bulk: float, angle: float) -> float:
    """Return the error of tau/P with that of its angle of repose [rad]: d sin(a) = cos(a) da."""
    return angle * math.sqrt(1.0 - bulk**2)


def pair_of_bulk_friction(bulk: float, spread: float = 0.0) -> FrictionPair:
    """Return the pair that stands for a bulk friction tau/P +- spread: the one nearest to `DRY_STEEL`.

    Raises
    ------
    ValueError
        No pair of the table gives it.
    """
    from particles.bulk_friction.friction_table import measured_table  # local: it needs scipy, most scenes do not

    table = measured_table()
    friction = table.nearest_friction(bulk, DRY_STEEL)
    if friction is None:
        low, high = float(table.mean.min()), float(table.mean.max())
        advice = (
            "not even spheres without friction flow at a smaller one: measure it again"
            if bulk < low
            else "a steeper heap means a cohesive or interlocking powder: give contact.friction itself, and add a "
            "cohesion"
        )
        raise ValueError(
            f"cannot be reached by friction and rolling friction of spheres; allowed: bulk frictions of {low:.3f} to "
            f"{high:.3f}, angles of repose of {angle_in_words(math.asin(low))} to {angle_in_words(math.asin(high))}; "
            f"{advice}"
        )
    pair = table.pair(bulk, friction, spread)
    assert pair is not None  # on the line
    return pair


def repose_agrees(partial: PartialScene) -> Iterator[Fault]:
    """Yield what contradicts particles.repose."""
    scene, repose = partial.scene, partial.scene.particles.repose
    if repose is None:
        return
    try:
        pair = pair_of_bulk_friction(math.sin(repose))
    except ValueError as error:
        yield partial.fault("particles.repose", str(error))
        return
    rolling = scene.effects.rolling
    given = {}
    if "friction" in scene.contact.model_fields_set:
        given["contact.friction"] = scene.contact.friction, pair.friction
    if rolling is not None and "coefficient" in rolling.model_fields_set:
        given[f"effects.{rolling.name}.coefficient"] = rolling.coefficient, pair.rolling
    for key, (value, wanted) in given.items():
        if not math.isclose(value, wanted, rel_tol=REL_TOL, abs_tol=REL_TOL):
            yield partial.fault(
                key,
                f"conflicts with particles.repose, which says {wanted:.3g}; remove one of the two (emclutch powder "
                f"--repose '{angle_in_words(repose)}' lists the other pairs with this angle)",
            )


def with_friction_of_repose(scene: Scene) -> Scene:
    """Return the scene with the coefficients that its angle of repose says; one without an angle as it is."""
    if scene.particles is None or scene.particles.repose is None:
        return scene
    pair, effects = pair_of_bulk_friction(math.sin(scene.particles.repose)), scene.effects
    contact = scene.contact.model_copy(update={"friction": pair.friction})
    if pair.rolling > 0.0 or effects.rolling is not None:
        (kind,) = (one for one in effects.kinds() if one.role == "rolling")
        table = (effects.rolling or kind()).model_copy(update={"coefficient": pair.rolling})
        effects = effects.model_copy(update={kind.name: table})
    return scene.model_copy(update={"contact": contact, "effects": effects})


def friction_in_words(repose: float) -> str:
    """Return which friction follows from an angle of repose [rad], and with what interval."""
    bulk = math.sin(repose)
    pair = pair_of_bulk_friction(bulk, spread_of_bulk_friction(bulk, HEAPS_REPEAT))
    above = "any larger one" if math.isinf(pair.highest) else f"{pair.highest:.2g}"
    return (
        f"{pair.friction:.3g}, rolling friction {pair.rolling:.3g} (from {pair.lowest:.2g} to {above} by "
        f"{angle_in_words(HEAPS_REPEAT)} of the angle, the error of the table and the softness of its contacts): one "
        f"pair with the angle of repose of {angle_in_words(repose)}; emclutch powder --repose lists the others; "
        f"{tangent_in_words(repose)}"
    )
