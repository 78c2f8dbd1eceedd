"""A numerical setting of a scene that trades time for accuracy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from emclutch.scene.model import Scene
    from emclutch.simulation.plan import Plan

FROZEN, TORQUE, HISTORIES = "frozen", "torque", "histories"
"""What a setting is measured on: the squared moments of a frozen packing, which have no noise; the mean torque of
several replicas; the histories of the replicas at the scene's own settings."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setting:
    """One numerical setting of a scene.

    Its error, relative to the result without it, is c (h^p - h_0^p): h is the `step_size` of its value, p the order of
    convergence, and h_0 the `limit`, which is 0 but for what physics itself limits (the real size of grains).

    Attributes
    ----------
    name : str
        Also its key in ``[accuracy.values]``: ``contact_step``.
    key : str
        Key of the scene that it sets, also where the program chooses the value.
    summary : str
        What it is, in one sentence.
    theory : str
        What it trades, with order and sign of its error, in one sentence.
    entry : Any
        Type of a value, with its range: `emclutch.scene.units.number`, or the metadata of `Time`.
    order : float or None
        p above; None: no law, or one of unknown order.
    applies : callable
        Of a scene: whether it has this setting.
    own : callable
        Of scene and plan: the scene's own value, also where the program has chosen it.
    tried, factors : sequence of float
        Values that are measured where the scene lists none, or factors of its own value.
    usual_of : callable or None
        Of scene and plan, in place of both; its own need not be among them.
    keys_of : callable or None
        Of a scene: all dotted keys that may give it its value; default: `key`.
    entries_of : callable or None
        Of scene, plan and value: the entries of a scene, by dotted key, that give it the value; default: `key`.
    limit_of : callable or None
        Of scene and plan: the step size at which there is no error; default: 0.
    measured_on, unit : str
    finer_is_larger, is_whole : bool
    in_contacts : bool
        Whether its unit is the duration of a contact: with a given time.step it has no value and no known error.
    is_large : bool
        Whether its error is large in most scenes; then it is measured before settings that cost less.
    """

    name: str
    key: str
    summary: str
    theory: str
    entry: Any
    order: float | None
    applies: Callable[[Any], bool]  # of a scene and a plan; those of which a setting applies have what it reads
    own: Callable[[Any, Any], float]
    tried: Sequence[float] = ()
    factors: Sequence[float] = ()
    usual_of: Callable[[Any, Any], Sequence[float]] | None = None
    keys_of: Callable[[Any], tuple[str, ...]] | None = None
    entries_of: Callable[[Any, Any, float], dict[str, Any]] | None = None
    limit_of: Callable[[Any, Any], float] | None = None
    measured_on: str = TORQUE
    unit: str = ""
    finer_is_larger: bool = False
    is_whole: bool = False
    in_contacts: bool = False
    is_large: bool = False

    def usual(self, scene: Scene, plan: Plan) -> Sequence[float]:
        """Return the values that are measured where the scene lists none."""
        if self.usual_of is not None:
            return self.usual_of(scene, plan)
        return self.tried or [factor * self.own(scene, plan) for factor in self.factors]

    def keys(self, scene: Scene) -> tuple[str, ...]:
        """Return the dotted keys that give a scene its value: those of `entries`, and others that may set it."""
        return (self.key,) if self.keys_of is None else self.keys_of(scene)

    def entries(self, scene: Scene, plan: Plan, value: float) -> dict[str, Any]:
        """Return the entries of a scene, by dotted key, that give it a value."""
        if self.entries_of is not None:
            return self.entries_of(scene, plan, value)
        return {self.key: round(value) if self.is_whole else value}

    def values(self, scene: Scene, plan: Plan) -> tuple[float, ...]:
        """Return the values to measure, the scene's own among them, from coarse to fine."""
        asked = getattr(scene.accuracy.values, self.name)
        own = self.own(scene, plan)
        others = [one for one in asked or self.usual(scene, plan) if not math.isclose(one, own, rel_tol=1e-3)]
        return tuple(sorted({own, *others}, reverse=not self.finer_is_larger))

    def step_size(self, value: float) -> float:
        """Return h, which falls as the value becomes finer."""
        return 1.0 / value if self.finer_is_larger else value

    def limit(self, scene: Scene, plan: Plan) -> float:
        """Return the step size at which there is no error."""
        return 0.0 if self.limit_of is None else self.limit_of(scene, plan)
