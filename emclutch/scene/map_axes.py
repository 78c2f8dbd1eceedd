"""Axes of a torque map: which quantity of a scene is varied, and its values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass
from typing import Any

import numpy as np

from emclutch.scene.case import Case
from emclutch.scene.errors import Fault, SceneError, entry_at, shown
from emclutch.scene.fault_report import key_fault, quantity_at
from emclutch.scene.model import Scene
from emclutch.scene.units import Quantity, in_unit_of, unit_of
from emclutch.scene.value_list import RANGE_POINTS, read_list, values_of

CURRENT = "coil.current"
KEYS: dict[str, tuple[str, tuple[str, ...], str]] = {
    "current": (CURRENT, ("coil.voltage", "effects.coil_circuit"), "coil current"),
    "voltage": ("coil.voltage", (CURRENT,), "coil voltage"),
    "gap": ("", (), "gap"),
    "speed": ("motion.rotor.speed", ("motion.rotor.free",), "speed of the rotor"),
    "fill": ("particles.solid_fraction", ("particles.mass", "particles.count"), "solid fraction"),
    "repose": ("particles.repose", ("contact.friction", "effects.rolling_friction.coefficient"), "angle of repose"),
    "temperature": ("field.temperature", (), "temperature"),
}
"""Name of an axis: its key (that of the gap is the device's), the keys that it replaces, and its name for people."""
COUNTS = ((RANGE_POINTS,), (12, 4))
"""Points of a range without a count, on one axis and on two."""
MAX_POINTS = 1000
LOGARITHMIC = 30.0
"""Last over first value from which on a range is divided in equal factors, and the axes are logarithmic."""
FRICTION = ("particles.repose", "contact.", "effects.rolling_friction.")
GAPS = ("geometry.gap", "geometry.face_gap")
SHARE_A_MESH = ("coil.", "motion.", "particles.solid_fraction", *FRICTION)


@dataclass(frozen=True, slots=True)
class Axis:
    """A quantity that is varied.

    Attributes
    ----------
    name, key : str
        Name for people, and the dotted key.
    quantity : Quantity
    values : tuple of float
        Ascending [SI].
    entry : object
        A value as it was given, with the unit in which values are shown.
    replaces : tuple of str
        Keys of the scene that it replaces.
    follows : tuple of str
        Keys that have its values too.
    """

    name: str
    key: str
    quantity: Quantity
    values: tuple[float, ...]
    entry: object
    replaces: tuple[str, ...] = ()
    follows: tuple[str, ...] = ()

    @property
    def keeps_mesh(self) -> bool:
        """Whether its values have one mesh."""
        return self.key.startswith(SHARE_A_MESH)

    @property
    def is_of_friction(self) -> bool:
        """Whether it is the friction of the powder, which is then not unknown."""
        return self.key.startswith(FRICTION)

    @property
    def is_logarithmic(self) -> bool:
        """Whether its values span so much that their logarithms are drawn."""
        return _spans(self.values, self.quantity)

    @property
    def label(self) -> str:
        """Name with the unit in which it is shown."""
        unit, _ = unit_of(self.entry, self.quantity)
        return f"{self.name} [{unit}]" if unit else self.name

    def shown(self, value: float) -> str:
        """Return a value [SI] with its unit."""
        return in_unit_of(self.entry, value, self.quantity)

    def changes(self, value: float) -> dict[str, float | None]:
        """Return what a value changes in a scene, as `Case.with_values` takes it."""
        return {**dict.fromkeys(self.replaces), **dict.fromkeys((self.key, *self.follows), value)}


def axes_of(case: Case, given: Mapping[str, str | Sequence[Any]], prefix: str = "") -> tuple[Axis, ...]:
    """Return the axes that are given by names or keys; SceneError with all faults, their names after a `prefix`."""
    case.need_grains()
    if len(given) not in (1, 2):
        options = ", ".join(f"{prefix}{name}" for name in KEYS) + f", {prefix}vary" * bool(prefix)
        message = f"needs one or two axes, e.g. {prefix}current '0.1 A:1.5 A'; possible are {options}"
        raise SceneError([Fault("map", "", message)], "torque map")
    faults: list[Fault] = []
    axes: list[Axis] = []
    for (name, entry), count in zip(given.items(), COUNTS[len(given) - 1], strict=True):
        try:
            option = prefix + ("vary" if prefix and name not in KEYS else name)
            axes.append(_axis(case, name, entry, option, count))
        except SceneError as error:
            faults += error.faults
    total = int(np.prod([len(one.values) for one in axes]))
    if total > MAX_POINTS:
        faults.append(Fault("map", "", f"has {total} points; allowed: 2 to {MAX_POINTS}; lower a count"))
    if len(axes) == 2:
        for one, other in (axes, axes[::-1]):
            if other.key in (*one.replaces, *one.follows, one.key):
                message = f"cannot be varied together with {one.key}, which replaces it; remove one of the two"
                faults.append(Fault(other.key, "", message))
                break
    if faults:
        raise SceneError(faults, "torque map")
    return tuple(axes)


def sheared_gap_hint(case: Case, key: str) -> str:
    """Say which gap is sheared where a key is that of the other one; else empty."""
    sheared = case.scene.geometry.gap_key(case.scene.shape(), case.scene.grains.region)
    if sheared is None or key not in GAPS or key == sheared:
        return ""
    return f"The sheared gap of this scene is {sheared}, not {key}."


def _axis(case: Case, name: str, entry: str | Sequence[Any], option: str, count: int) -> Axis:
    """Return an axis by its name or key; SceneError with its faults."""
    key, replaces, words = KEYS.get(name, (name, (), name))
    if name == "speed" and (shaft := case.scene.geometry.shaft_at_powder) != "rotor":
        key, replaces, words = f"motion.{shaft}.speed", (f"motion.{shaft}.free",), f"speed of the {shaft}"
    if name == "gap":
        key = case.scene.geometry.gap_key(case.scene.shape(), case.scene.grains.region) or ""
        if not key:
            kind = entry_at(case.data, ("geometry", "kind"))
            message = f"is no single key of geometry.kind = '{kind}'; vary a length of [geometry] by its key, as in "
            message += "--vary KEY='1 mm:2 mm', or map(case, **{'geometry.KEY': '1 mm:2 mm'})"
            raise SceneError([Fault(option, shown(entry), message)], "torque map")
    if reason := key_fault(key, Scene):
        raise SceneError([Fault(option, "" if option == key else shown(key), reason)], "torque map")
    quantity = quantity_at(key, Scene, case.data)
    if quantity is None:
        message = "is not a continuous quantity; vary a length, a current, a fraction"
        raise SceneError([Fault(option, shown(key), message)], "torque map")
    if entry is None or isinstance(entry, Mapping) or (isinstance(entry, Sized) and not len(entry)):
        what = "is no value" if entry is None else "is a dictionary" if isinstance(entry, Mapping) else "is empty"
        message = f"{what}; give a range A:B, or a list such as '{quantity.example}, ...'"
        raise SceneError([Fault(option, shown(entry), message)], "torque map")
    if isinstance(entry, str):
        values = read_list(entry, quantity, option, count)
        if entry.count(":") == 1 and _spans(sorted(values), quantity):
            values = np.geomspace(values[0], values[-1], len(values)).tolist()
        texts: Sequence[Any] = [text.strip() for text in entry.replace(":", ",").split(",")]
    else:
        texts = list(entry) if isinstance(entry, Iterable) else [entry]
        values = values_of(texts, quantity, option)
    ascending = tuple(sorted({float(f"{value:.15g}") for value in values}))  # 0.2 of a range is not 0.19999999999999998
    if len(ascending) < 2:
        message = f"is one value; an axis has 2 or more; give a range A:B, or set {key} in the scene"
        raise SceneError([Fault(option, shown(entry), message)], "torque map")
    replaced = tuple(one for one in replaces if entry_at(case.data, one.split(".")) is not None)
    units = (text for text in texts if isinstance(text, str) and unit_of(text, quantity) != (quantity.unit, 1.0))
    follows = ("coil.temperature",) if name == "temperature" and case.scene.coil is not None else ()
    return Axis(words, key, quantity, ascending, next(units, ascending[-1]), replaced, follows)


def _spans(values: Sequence[float], quantity: Quantity) -> bool:
    return values[0] > 0.0 and values[-1] > LOGARITHMIC * values[0] and quantity.unit != "degC"  # which has no zero
