"""The contacts of a plan in words: their stiffness and what it follows from, the step, the solver of rigid grains."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from coupling.expected_load import NECK_MARGIN
from emclutch.device_model.decision import Decision
from emclutch.effects.effect import Load
from emclutch.simulation.dvi_plan import TOLERANCE, RigidContacts
from emclutch.simulation.stiffness import Stiffness
from particles.dem.overlap_limits import SOFT

if TYPE_CHECKING:
    from emclutch.scene.contact import DviSection
    from emclutch.scene.model import Scene
    from emclutch.simulation.contact_plan import ElasticContacts

FRICTION = {"coulomb": "exact Coulomb friction", "convex": "the convex cone"}


def contacts_in_words(scene: Scene, contacts: ElasticContacts | RigidContacts) -> Iterator[tuple[str, str]]:
    """Stiffness, kind of contact, step and solver: label and text."""
    if contacts.stiffness is not None:
        yield "stiffness", stiffness_in_words(contacts.stiffness)
    if not isinstance(contacts, RigidContacts):
        yield "time step", contacts.step.reason
        return
    yield "contact", rigidity_in_words(scene.contact.dvi, contacts)
    yield "time step", contacts.step.reason
    yield "solver", solver_in_words(scene.contact.dvi, contacts)


def stiffness_in_words(stiffness: Stiffness) -> str:
    """Stiffness of contacts between grains, its reason, and objections to it."""
    why = load_in_words(stiffness.load, stiffness.speed)
    kind = "" if stiffness.law == "linear" else f"law {stiffness.law}, at that overlap "
    text = (
        f"{kind}k_n = {stiffness.value:.3g} N/m{' as asked' if stiffness.asked else ''}: "
        f"overlap {100 * stiffness.overlap:.2g} % of the diameter" + (f" under {why}" if why else "")
    )
    if stiffness.snap is not None:
        text += f"; for a short time {100 * stiffness.snap:.2g} % when attracted grains collide"
    warnings = []
    if stiffness.is_below_necks:
        warnings.append(
            f"k_n is less than {NECK_MARGIN:g} times the negative stiffness of saturated necks, "
            f"{stiffness.neck:.3g} N/m: contacts close by more than their overlap"
        )
    if stiffness.is_soft:
        size = f"{100 * stiffness.overlap:.2g} % of the diameter, above {100 * SOFT:g} %"
        warnings.append(f"the overlap is {size}: grains are too soft: peak torques are unreliable")
    return Decision(text, *warnings)


def load_in_words(load: Load, speed: float) -> str:
    """Text of the loads that press grains in: a load, and impacts at a speed [m/s]; empty without any."""
    loaded = f"{load.force:.3g} N from {load.text}" if load.force > 0.0 else ""
    hit = f"impacts at {speed:.3g} m/s" if speed > 0.0 else ""
    return " and ".join(filter(None, (loaded, hit)))


def rigidity_in_words(section: DviSection, contacts: RigidContacts) -> str:
    """The friction of grains by DVI, and whether they are rigid or on springs."""
    text = FRICTION[section.friction_law]
    if contacts.springs is None:
        return f"rigid grains, {text}; stiffness and contact law are not used"
    between, at_walls = contacts.springs[:, 0]
    walls = "" if between == at_walls else f", {at_walls:.3g} N/m at walls"
    return f"grains on springs of {between:.3g} N/m{walls}, taken implicitly; {text}"


def solver_in_words(section: DviSection, contacts: RigidContacts) -> str:
    """Tolerance of the contacts of rigid grains, and the speed from which they rebound."""
    share = "" if section.tolerance is not None else f", {TOLERANCE:g} of the slip speed"
    return (
        f"{section.solver}: violation of Coulomb's law at most {contacts.tolerance:.3g} m/s{share}, at most "
        f"{section.max_sweeps} sweeps a step; impacts below {contacts.contact.threshold:.3g} m/s do not rebound"
    )
