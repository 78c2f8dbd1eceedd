"""What each effect of a scene adds to its torque and to its cost, from replicas with it and without it.

The difference of two means of independent replicas has Welch's interval (B. L. Welch, Biometrika 34 (1947) 28-35):
Student's t of f = (a + b)^2 / (a^2/(n_a - 1) + b^2/(n_b - 1)) degrees of freedom, a and b being the squared standard
errors of the means. No scatter is taken from one scene to another: without an effect it may be a different one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from emclutch.results.accuracy_study import student
from emclutch.results.text import format_percent


@dataclass(frozen=True, slots=True)
class Without:
    """The replicas of a scene without an effect, or of the whole scene.

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
        Why there are no replicas of it.
    was_run : bool
        Whether any was begun.
    """

    effect: str
    others: tuple[str, ...] = ()
    torques: tuple[float, ...] = ()
    seconds: float = math.nan
    reason: str = ""
    was_run: bool = True

    @property
    def names(self) -> str:
        """Return the effect, and those that are left out with it."""
        return ", ".join((self.effect, *self.others))

    @property
    def torque(self) -> Interval | None:
        """Return the mean torque [N m] with its 95 % interval; None of less than two replicas."""
        if len(self.torques) < 2:
            return None
        error, freedom = _standard_error(self.torques), len(self.torques) - 1.0
        return Interval(float(np.mean(self.torques)), student(freedom) * error)


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean and half its 95 % interval, in the same unit."""

    mean: float
    half_width: float

    @property
    def is_significant(self) -> bool:
        """Return whether it is known to differ from zero."""
        return abs(self.mean) > self.half_width

    def text(self, sign: str = "") -> str:
        """Return both with as many decimals as two digits of the half width have; `sign` "+" shows that of the mean."""
        digits = max(0, 1 - math.floor(math.log10(self.half_width))) if self.half_width > 0.0 else 3
        return f"{self.mean:{sign}.{digits}f} ± {self.half_width:.{digits}f}"

    def scaled(self, factor: float) -> Interval:
        """Return the interval of a multiple."""
        return Interval(factor * self.mean, abs(factor) * self.half_width)


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

    def torque(self, one: Without) -> Interval | None:
        """Return what an effect, with those that need it, adds to the torque [N m]; None where it was not measured."""
        return None if one.torque is None else difference(self.whole.torques, one.torques)

    def share(self, one: Without) -> Interval | None:
        """Return `torque` over that of the whole scene, 1 - b/a, with the errors of both to first order."""
        whole = self.whole.torque
        if one.torque is None or whole is None or whole.mean == 0.0:
            return None
        ratio = one.torque.mean / whole.mean
        spread = difference([ratio * a for a in self.whole.torques], one.torques)
        return Interval(1.0 - ratio, spread.half_width / abs(whole.mean))

    def seconds(self, one: Without) -> float | None:
        """Return what an effect, with those that need it, adds to the processor time of a replica [s]."""
        return None if one.torque is None else self.whole.seconds - one.seconds

    @property
    def measured(self) -> list[Without]:
        """Return the effects without which there are replicas."""
        return [one for one in self.without if one.torque is not None]

    def in_words(self) -> str:
        """Say in one sentence what carries the torque, what costs the time, and what is open."""
        torque, measured = self.whole.torque, self.measured
        assert torque is not None
        head = f"{self.case}: {torque.text()} N m for {self.whole.seconds:.3g} s of processor time a replica"
        added = {one: found for one in measured if (found := self.torque(one)) is not None}
        significant = [one for one in measured if added[one].is_significant]
        parts = []
        if significant:
            most = max(significant, key=lambda one: abs(added[one].mean))
            parts.append(f"the largest part of the torque is by {_with(most)}: {added[most].text('+')} N m")
        if measured:
            dearest = max(measured, key=lambda one: self.whole.seconds - one.seconds)
            saved = self.whole.seconds - dearest.seconds
            if saved > 0.0:
                share = format_percent(saved / self.whole.seconds)
                parts.append(f"the most expensive is {_with(dearest)}, {share} of the time")
        open_effects = [one.effect for one in measured if not added[one].is_significant]
        if open_effects:
            parts.append(f"not significant with so many replicas: {', '.join(open_effects)}")
        return "; ".join([head, *parts]) + "."


def difference(a: Sequence[float], b: Sequence[float]) -> Interval:
    """Return mean(a) - mean(b) of independent samples, two of each at the least, with Welch's 95 % interval."""
    squares = [_standard_error(one) ** 2 for one in (a, b)]
    spread = sum(squares)
    mean = float(np.mean(a) - np.mean(b))
    if spread == 0.0:
        return Interval(mean, 0.0)
    freedom = spread**2 / sum(one**2 / (len(sample) - 1) for one, sample in zip(squares, (a, b), strict=True))
    return Interval(mean, student(freedom) * math.sqrt(spread))


def _standard_error(sample: Sequence[float]) -> float:
    return float(np.std(sample, ddof=1)) / math.sqrt(len(sample))


def _with(one: Without) -> str:
    return one.effect + (f" (with {' and '.join(one.others)})" if one.others else "")
