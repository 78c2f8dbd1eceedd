"""What each effect of a scene adds to its torque and to its cost, from replicas with it and without it.

The difference of two means of independent replicas has Welch's interval (`Measured`). No scatter is taken from one
scene to another: without an effect it may be a different one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from emclutch.results.fits import Measured
from emclutch.results.text import format_percent

WHOLE = "whole"


@dataclass(frozen=True, slots=True)
class Without:
    """A scene without an effect, or the whole scene, and its replicas.

    Attributes
    ----------
    effect : str
        That is left out; empty: none.
    others : tuple of str
        Effects that need it, and are left out with it.
    torques : tuple of float
        Of its replicas [N m].
    seconds : float
        Processor time of a replica [s].
    reason : str
        Why there are no replicas of it, or fewer.
    was_run : bool
        Whether replicas are run: the scene can be without it.
    """

    effect: str
    others: tuple[str, ...] = ()
    torques: tuple[float, ...] = ()
    seconds: float = math.nan
    reason: str = ""
    was_run: bool = True

    @property
    def values(self) -> dict[str, None]:
        """Return the entries of the scene without them, as `Case.with_values` takes them."""
        return {f"effects.{name}": None for name in (self.effect, *self.others) if name}

    @property
    def folder(self) -> str:
        """Return the folder of its replicas in that of the study."""
        return f"without-{self.effect}" if self.effect else WHOLE

    @property
    def names(self) -> str:
        """Return the effect, and those that are left out with it."""
        return ", ".join((self.effect, *self.others))

    @property
    def torque(self) -> Measured | None:
        """Return the mean torque [N m]; None of less than two replicas."""
        return Measured.of(self.torques) if len(self.torques) > 1 else None


@dataclass(frozen=True, slots=True)
class Contributions:
    """A scene, and the same without each of its effects.

    Attributes
    ----------
    case : str
    whole : Without
        The scene with all of its effects.
    without : tuple of Without
        In the order of the effects.
    absent : tuple of str
        Effects that the scene does not have.
    """

    case: str
    whole: Without
    without: tuple[Without, ...]
    absent: tuple[str, ...]

    def torque(self, one: Without) -> Measured | None:
        """Return what an effect, with those that need it, adds to the torque [N m]; None where it was not measured."""
        whole = self.whole.torque
        return None if one.torque is None or whole is None else whole - one.torque

    def share(self, one: Without) -> Measured | None:
        """Return `torque` over that of the whole scene, 1 - b/a, with the errors of both to first order."""
        whole = self.whole.torque
        if one.torque is None or whole is None or whole.value == 0.0:
            return None
        ratio = one.torque.value / whole.value
        spread = whole.scaled(ratio) - one.torque
        return Measured(1.0 - ratio, spread.error / abs(whole.value), spread.freedom)

    def seconds(self, one: Without) -> float | None:
        """Return what an effect, with those that need it, adds to the processor time of a replica [s]."""
        return None if one.torque is None else self.whole.seconds - one.seconds

    @property
    def measured(self) -> list[Without]:
        """Return the effects without which there are replicas."""
        return [one for one in self.without if one.torque is not None]

    def in_words(self) -> list[str]:
        """Return sentences on the largest contributions to torque and time, and on insignificant effects."""
        torque, measured = self.whole.torque, self.measured
        assert torque is not None
        lines = [f"Torque: {torque.text()} N m for {self.whole.seconds:.3g} s of processor time a replica."]
        added = {one: found for one in measured if (found := self.torque(one)) is not None}
        significant = [one for one in measured if added[one].is_significant()]
        if significant:
            most = max(significant, key=lambda one: abs(added[one].value))
            lines.append(f"Largest part of the torque: {_with(most)}, {added[most].text('+')} N m.")
        if measured:
            dearest = max(measured, key=lambda one: self.whole.seconds - one.seconds)
            saved = self.whole.seconds - dearest.seconds
            if saved > 0.0:
                fraction = format_percent(saved / self.whole.seconds)
                lines.append(f"Most expensive: {_with(dearest)}, {fraction} of the time.")
        if others := [one.effect for one in measured if not added[one].is_significant()]:
            lines.append(f"Not significant with so many replicas: {', '.join(others)}.")
        return lines


def _with(one: Without) -> str:
    return one.effect + (f" (with {' and '.join(one.others)})" if one.others else "")
