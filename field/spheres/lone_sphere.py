"""Magnetisation of a lone sphere of any bulk law in a uniform field h.

A sphere in a uniform field is magnetised evenly, whatever its law (Maxwell 1873, art. 437), and its own field inside
is -M/3:

    H_in = h - M/3,    B = mu_0 (H_in + M),    so that    h = (2 H(B) + B/mu_0)/3.

The right side grows with B, by 1/(3 mu_0) at least, and B lies between mu_0 h and 3 mu_0 h: one scalar equation for B,
solved by Newton inside that bracket, and M = (3/2)(B/mu_0 - h).
"""

from __future__ import annotations

import numpy as np

from field.laws.froehlich import FroehlichLaw
from field.laws.powder_law import GrainLaw, ThesisLaw
from field.laws.reluctivity import MU_0, NU_0, Law, LinearLaw

# Newton in a bracket: 5 to 12 steps for the laws of the library; halving alone reaches round-off in 53.
_MAX_STEPS = 80
# Flux density [T] at which a law without a stated saturation is evaluated for it; every law that saturates has the
# slope of vacuum there.
_FAR = 100.0
# A slope this close to that of vacuum is saturation.
_VACUUM_SLOPE = 0.999


def bulk_law(law: Law | GrainLaw) -> Law:
    """The bulk law H(B) of a grain's material; a law of that kind is returned as it is.

    Raises
    ------
    ValueError
        The law of the thesis, whose chi is that of a sphere and of no material.
    """
    if isinstance(law, ThesisLaw):
        raise ValueError(
            "M = chi H of the thesis has no bulk material behind it, so that two grains cannot be solved for; "
            "give susceptibility and saturation of the grain's material"
        )
    if not isinstance(law, GrainLaw):
        return law
    if law.Ms is None:
        return LinearLaw(1.0 + law.chi, "grains", "linear grains")
    return FroehlichLaw(law.chi, law.Ms, "grains", "Froehlich-Kennelly")


def saturation(law: Law | GrainLaw) -> float:
    """Saturation magnetisation Ms [A/m] of a law: stated by it, or B/mu_0 - H far in saturation.

    Raises
    ------
    ValueError
        A law that does not saturate.
    """
    law = bulk_law(law)
    stated = getattr(law, "Ms", None)
    if stated is not None:
        return float(stated)
    H, slope = law.H_of_B(np.array([_FAR]))
    if MU_0 * slope[0] < _VACUUM_SLOPE or NU_0 * _FAR - H[0] <= 0.0:
        raise ValueError(
            f"{law.name!r} has no saturation magnetisation: at {_FAR:g} T it is not saturated, or it is not magnetic; "
            "give the grains a material that saturates"
        )
    return float(NU_0 * _FAR - H[0])


def sphere_flux_density(law: Law | GrainLaw, h: np.ndarray | float) -> np.ndarray:
    """B [T] inside a lone sphere in the uniform field h >= 0 [A/m], any shape."""
    law = bulk_law(law)
    h = np.asarray(h, dtype=float)
    if not np.all(np.isfinite(h) & (h >= 0.0)):
        raise ValueError("`h` holds a value that is not a finite number of at least 0: it is a magnitude [A/m]")
    low, high = MU_0 * h, 3.0 * MU_0 * h
    slope = (2.0 * law.H_of_B(np.zeros_like(h))[1] + NU_0) / 3.0
    B = np.clip(h / slope, low, high)
    for _ in range(_MAX_STEPS):
        H, dH_dB = law.H_of_B(B)
        excess = (2.0 * H + NU_0 * B) / 3.0 - h
        high, low = np.where(excess > 0.0, B, high), np.where(excess > 0.0, low, B)
        new = B - 3.0 * excess / (2.0 * dH_dB + NU_0)
        # outside the bracket only where the law's slope changes fast (the toe of a steel)
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        moved, B = np.abs(new - B), new
        if np.all(moved <= 4e-16 * B):
            break
    return B


def sphere_magnetisation(law: Law | GrainLaw, h: np.ndarray | float) -> np.ndarray:
    """M_sph [A/m] of a lone sphere in the uniform field h >= 0 [A/m], any shape."""
    h = np.asarray(h, dtype=float)
    return 1.5 * (NU_0 * sphere_flux_density(law, h) - h)
