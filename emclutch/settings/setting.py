"""Base of the numerical settings of a scene that trade time for accuracy."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from emclutch.scene.model import Scene
    from emclutch.simulation.plan import Plan

FROZEN, TORQUE, HISTORIES = "frozen", "torque", "histories"
"""What a setting is measured on: the squared moments of a frozen packing, which have no noise; the mean torque of
several replicas; the histories of the replicas at the scene's own settings."""


class Setting(ABC):
    """One numerical setting of a scene.

    Its error, relative to the result without it, is c (h^p - h_0^p): h is the `step_size` of its value, p the order of
    convergence, and h_0 the `limit`, which is 0 but for what physics itself limits (the real size of grains).
    """

    name: ClassVar[str]
    """Name of the setting, also its key in ``[accuracy.values]``: ``contact_step``."""
    key: ClassVar[str]
    """Key of the scene that it sets, also where the program chooses the value."""
    theory: ClassVar[str]
    """What it trades, with order and sign of its error, in one sentence."""
    order: ClassVar[float | None]
    """p above; None: no law, or one of unknown order."""
    measured_on: ClassVar[str] = TORQUE
    finer_is_larger: ClassVar[bool] = False
    unit: ClassVar[str] = ""
    is_whole: ClassVar[bool] = False
    in_contacts: ClassVar[bool] = False
    """Whether its unit is the duration of a contact: with a given time.step it has no value and no known error."""
    is_large: ClassVar[bool] = False
    """Whether its error is large in most scenes; then it is measured before settings that cost less."""
    tried: ClassVar[Sequence[float]] = ()
    """Values that are measured where the scene lists none; or `factors` of its own value."""
    factors: ClassVar[Sequence[float]] = ()
    entry: ClassVar[Any]
    """Type of a value, with its range: `emclutch.scene.units.number`, or the metadata of `Time`."""

    @classmethod
    @abstractmethod
    def applies(cls, scene: Scene) -> bool:
        """Return whether the scene has this setting."""

    @classmethod
    @abstractmethod
    def own(cls, scene: Scene, plan: Plan) -> float:
        """Return the scene's own value, also where the program has chosen it."""

    @classmethod
    def usual(cls, scene: Scene, plan: Plan) -> Sequence[float]:
        """Return the values that are measured where the scene lists none; its own need not be among them."""
        return cls.tried or [factor * cls.own(scene, plan) for factor in cls.factors]

    @classmethod
    def keys(cls, scene: Scene) -> tuple[str, ...]:
        """Return the dotted keys that give a scene its value: those of `entries`, and others that may set it."""
        return (cls.key,)

    @classmethod
    def entries(cls, scene: Scene, plan: Plan, value: float) -> dict[str, Any]:
        """Return the entries of a scene, by dotted key, that give it a value."""
        return {cls.key: round(value) if cls.is_whole else value}

    @classmethod
    def values(cls, scene: Scene, plan: Plan) -> tuple[float, ...]:
        """Return the values to measure, the scene's own among them, from coarse to fine."""
        asked = getattr(scene.accuracy.values, cls.name)
        own = cls.own(scene, plan)
        others = [one for one in asked or cls.usual(scene, plan) if not math.isclose(one, own, rel_tol=1e-3)]
        return tuple(sorted({own, *others}, reverse=not cls.finer_is_larger))

    @classmethod
    def step_size(cls, value: float) -> float:
        """Return h, which falls as the value becomes finer."""
        return 1.0 / value if cls.finer_is_larger else value

    @classmethod
    def limit(cls, scene: Scene, plan: Plan) -> float:
        """Return the step size at which there is no error."""
        return 0.0
