"""The step of rigid grains, and the reason for it.

Nothing vibrates between rigid grains; what a step must resolve is the motion itself:

* **travel**: no grain moves more than a tenth of its diameter, v h <= d/10. Contacts are looked for at the middle of a
  step, with the normals of that place; beyond it grains pass through the edges of vanes, and normals are those of
  other neighbours;
* **attraction**: h <= 0.1 sqrt(m W)/F, F being the attraction of two grains that touch and W the work that parts them.
  Constant during a step, it adds v_h = 2 h F/m to the relative speed, and grains that touch part for good at
  v_e = 2 sqrt(W/m), both of the effective mass m/2: the rule is v_h <= v_e/10. An impact is met within a step, without
  what the pull adds in it. So one that is slower than v_h, from a gap of about h^2 F/m or less, does not rebound, and
  a faster one is taken to be slower by up to v_h. At the rule's step that gap is 1 % of the range W/F of the pull;
  it grows with h^2, and larger steps stick more (Abramian et al., see `particles.dvi.adhesion`). One packing of the
  quickstart, strains of 9 to 18: 0.749 +- 0.014 N m by DEM, 0.758 +- 0.007 at the rule's step, 0.84 +- 0.03 at
  1.95 times it.

  Two dipoles have W = F d/3, h = 0.08 sqrt(m a/F); the pull of necks reaches less far. A pull-off force has no range,
  and is taken to act over a radius, h = 0.1 sqrt(m a/F). Two grains alone are meant: in chains F and W are up to
  twice as large, and v_h then is up to a seventh of v_e.
* **pressure**: h <= 0.05 d sqrt(rho/P). In the time d sqrt(rho/P) an imposed pressure moves a free grain by about its
  size (GDR MiDi, Eur. Phys. J. E 14 (2004) 341): so long grains rearrange that a flow has pushed together, and a step
  that is no shorter lets their impacts fall into one. Two packings of 300 grains, friction 0.5, inertial number 0.03,
  strain 3, had tau/P = 0.378 +- 0.007 by DEM; 0.370 +- 0.006 at 0.05 of that time, 0.401 +- 0.004 at 0.17, and
  0.428 +- 0.006 at 0.5.

These are rules of accuracy. The scheme itself is stable at any step, so that a longer one may be allowed. The
step that is chosen is no longer than the interval that the caller gives, of a coupling window or of a whole run.
"""

from __future__ import annotations

import math

import numpy as np

from particles.dem.time_step import AS_LONG_AS_A_WINDOW, TimeStep, smallest_grain

TRAVEL = 0.1  # largest fraction of a diameter that a grain may move in one step
PRESSURE = 0.05  # of the time d sqrt(rho/P)
ATTRACTION = 0.1  # largest speed that an attraction adds in a step, over that which parts grains for good


def choose_dvi_step(
    mass: float | np.ndarray,
    radius: float | np.ndarray,
    *,
    speed: float = 0.0,
    attraction: float = 0.0,
    work: float | None = None,
    source: str = "an attraction",
    pressure: float = 0.0,
    longest: float = math.inf,
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
    work : float, optional
        Of parting two grains that touch against it [J]; by default over a radius.
    source : str
        What attracts, for the reason.
    pressure : float
        Imposed on the grains [Pa]; 0: none is.
    longest : float
        Length [s] of the interval that a chosen step does not exceed.
    dt : float, optional
        A step wished for [s].
    allow_long_step : bool
        Take ``dt`` although it is longer than the rules allow.

    Raises
    ------
    ValueError
        If a number is out of range, the wished step is too long, or nothing moves grains and none is wished for.
    """
    lightest, smallest = smallest_grain(
        mass, radius, speed=(speed, "m/s"), attraction=(attraction, "N"), pressure=(pressure, "Pa")
    )
    if work is not None and not 0.0 < work < math.inf:
        raise ValueError(f"work against the attraction = {work:g} J; allowed: more than 0")
    limits = []
    if speed > 0.0:
        limits.append((TRAVEL * 2.0 * smallest / speed, f"a tenth of a diameter of travel at {speed:.3g} m/s"))
    if attraction > 0.0:
        range_ = smallest if work is None else work / attraction
        time = parting_time(lightest, attraction, attraction * range_)
        why = f"{attraction:.3g} N from {source}, over {range_ / smallest:.2g} radii, stop grains that part"
        limits.append((ATTRACTION * time, f"a tenth of the {time:.3g} s in which {why}"))
    if pressure > 0.0:
        time = math.sqrt(3.0 * lightest / (math.pi * smallest * pressure))
        why = f"{pressure:.3g} Pa move a grain by its diameter"
        limits.append((PRESSURE * time, f"a twentieth of the {time:.3g} s in which {why}"))
    if dt is None:
        if not limits:
            raise ValueError("nothing moves the grains, so no step follows; give contact.dvi.step, e.g. '1 ms'")
        chosen, why = min((*limits, (longest, AS_LONG_AS_A_WINDOW)))
        return TimeStep(chosen, f"dt = {chosen:.3g} s: {why}, rigid grains")
    if not 0.0 < dt < math.inf:
        raise ValueError(f"dt = {dt:g} s; allowed: more than 0")
    if not limits or dt <= min(limits)[0] * (1.0 + 1e-9):
        return TimeStep(
            dt,
            f"dt = {dt:.3g} s as asked" + (f": {min(limits)[1]} would allow {min(limits)[0]:.3g} s" if limits else ""),
        )
    allowed, why = min(limits)
    if not allow_long_step:
        raise ValueError(
            f"dt = {dt:g} s; allowed: at most {allowed:.3g} s ({why}); leave it out, or allow it "
            "(contact.dvi.allow_long_step = true)"
        )
    return TimeStep(dt, f"dt = {dt:.3g} s as forced: {dt / allowed:.3g} times what the rule allows ({why})")


def parting_time(mass: float, attraction: float, work: float) -> float:
    """Time sqrt(m W)/F [s] in which the pull F [N] at contact stops two grains that just come free of it.

    They part with the relative speed 2 sqrt(W/m), W the ``work`` [J] of the pull over all gaps, slowed by 2 F/m.
    """
    return math.sqrt(mass * work) / attraction
