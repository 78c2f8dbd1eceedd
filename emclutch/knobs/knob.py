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
"""Where a knob is measured: on the squared moments of grains that stand still, which have no noise; on the mean torque
of several packings; on the histories of the packings at the scene's own settings."""


class Knob(ABC):
    """One numerical setting of a scene.

    Its error, relative to the result without it, is c (h^p - h_0^p): h is `step_size` of the setting, p the order, and
    h_0 the `limit`, which is 0 but for what physics itself limits (the real size of grains).
    """

    name: ClassVar[str]
    """Of the knob, also its key in ``[accuracy.ladders]``: ``contact_step``."""
    key: ClassVar[str]
    """Of the scene, that it sets; for what the program chooses itself, too."""
    theory: ClassVar[str]
    """What it trades, with order and sign of its error, in one sentence."""
    order: ClassVar[float | None]
    """p above; None: no law, or one of unknown order."""
    measured_on: ClassVar[str] = TORQUE
    finer_is_larger: ClassVar[bool] = False
    unit: ClassVar[str] = ""
    is_whole: ClassVar[bool] = False
    in_contacts: ClassVar[bool] = False
    """Setting that counts in durations of a contact: there is none, and so no known error, with a given time.step."""
    is_large: ClassVar[bool] = False
    """Error that is large in most scenes that have the knob: measured before knobs that cost less."""
    settings: ClassVar[Sequence[float]] = ()
    """That are tried where the scene lists none; or `factors` of its own setting."""
    factors: ClassVar[Sequence[float]] = ()
    entry: ClassVar[Any]
    """Mark of a setting's type, with its range: `emclutch.scene.units.number`, or the metadata of `Time`."""

    @classmethod
    @abstractmethod
    def applies(cls, scene: Scene) -> bool:
        """Return whether the scene has this knob."""

    @classmethod
    @abstractmethod
    def own(cls, scene: Scene, plan: Plan) -> float:
        """Return the scene's own setting, also where the program has chosen it."""

    @classmethod
    def usual(cls, scene: Scene, plan: Plan) -> Sequence[float]:
        """Return the settings that are tried where the scene lists none; its own need not be among them."""
        return cls.settings or [factor * cls.own(scene, plan) for factor in cls.factors]

    @classmethod
    def keys(cls, scene: Scene) -> tuple[str, ...]:
        """Return the dotted keys that give a scene its setting: those of `values`, and what else may say it."""
        return (cls.key,)

    @classmethod
    def values(cls, scene: Scene, plan: Plan, setting: float) -> dict[str, Any]:
        """Return the entries of a scene, by dotted key, that give it a setting."""
        return {cls.key: round(setting) if cls.is_whole else setting}

    @classmethod
    def ladder(cls, scene: Scene, plan: Plan) -> tuple[float, ...]:
        """Return the settings, the scene's own among them, from coarse to fine."""
        asked = getattr(scene.accuracy.ladders, cls.name)
        own = cls.own(scene, plan)
        others = [one for one in asked or cls.usual(scene, plan) if not math.isclose(one, own, rel_tol=1e-3)]
        return tuple(sorted({own, *others}, reverse=not cls.finer_is_larger))

    @classmethod
    def step_size(cls, setting: float) -> float:
        """Return h, which falls as the setting becomes finer."""
        return 1.0 / setting if cls.finer_is_larger else setting

    @classmethod
    def limit(cls, scene: Scene, plan: Plan) -> float:
        """Return the step size at which there is no error."""
        return 0.0
