"""The step of rigid grains, and the reason for it.

Nothing vibrates between rigid grains; what a step must resolve is the motion itself:

* **travel**: no grain moves more than a tenth of its diameter, v h <= d/10. Contacts are looked for at the middle of a
  step, with the normals of that place; beyond it grains pass through the edges of vanes, and normals are those of
  other neighbours;
* **attraction**: h <= 0.1 sqrt(m a/F). Two free grains of radius a that attract each other with F close a gap of a
  radius in about sqrt(m a/F): magnetic forces, held during a step, change by their own size in that time, and adhesion
  that holds grains back for a step (`particles.dvi.adhesion`) takes a tenth of the speed sqrt(F a/m).

These are rules of accuracy. The scheme itself is stable at any step, so that a longer one may be allowed.
"""

from __future__ import annotations

import math

import numpy as np

from particles.dem.time_step import TimeStep, smallest_grain

TRAVEL = 0.1  # largest fraction of a diameter that a grain may move in one step
ATTRACTION = 0.1  # fraction of the time sqrt(m a/F)


def choose_dvi_step(
    mass: float | np.ndarray,
    radius: float | np.ndarray,
    *,
    speed: float = 0.0,
    attraction: float = 0.0,
    dt: float | None = None,
    allow_long_step: bool = False,
) -> TimeStep:
    """Choose the step, or check the user's.

    Parameters
    ----------
    mass, radius
        Of the grains, [kg] and [m]; the smallest count.
    speed : float
        The largest speed to be expected [m/s], walls included.
    attraction : float
        The largest magnetic force between two grains, or on one, or pull-off force, to be expected [N].
    dt : float, optional
        A step wished for [s].
    allow_long_step : bool
        Take ``dt`` although it is longer than the rules allow.

    Raises
    ------
    ValueError
        If a number is out of range, the wished step is too long, or nothing moves grains and none is wished for.
    """
    lightest, smallest = smallest_grain(mass, radius, speed=(speed, "m/s"), attraction=(attraction, "N"))
    limits = []
    if speed > 0.0:
        limits.append((TRAVEL * 2.0 * smallest / speed, f"a tenth of a diameter of travel at {speed:.3g} m/s"))
    if attraction > 0.0:
        time = math.sqrt(lightest * smallest / attraction)
        limits.append((ATTRACTION * time, f"a tenth of the {time:.3g} s in which {attraction:.3g} N close a gap"))
    if dt is None:
        if not limits:
            raise ValueError("nothing moves the grains, so no step follows; give contact.dvi.step, e.g. '1 ms'")
        longest, why = min(limits)
        return TimeStep(longest, f"dt = {longest:.3g} s: {why}, rigid grains")
    if not 0.0 < dt < math.inf:
        raise ValueError(f"dt = {dt:g} s; allowed: more than 0")
    if not limits or dt <= min(limits)[0] * (1.0 + 1e-9):
        return TimeStep(
            dt,
            f"dt = {dt:.3g} s as asked" + (f": {min(limits)[1]} would allow {min(limits)[0]:.3g} s" if limits else ""),
        )
    longest, why = min(limits)
    if not allow_long_step:
        raise ValueError(
            f"dt = {dt:g} s; allowed: at most {longest:.3g} s ({why}); leave it out, or allow it "
            "(contact.dvi.allow_long_step = true)"
        )
    return TimeStep(dt, f"dt = {dt:.3g} s as forced: {dt / longest:.3g} times what the rule allows ({why})")
