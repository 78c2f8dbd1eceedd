"""A macroscopic field across a flat gap between steel faces, changed by the layers that its grains stand in.

A field of one dimension is known from the magnetisation. Across flat faces div B = 0 makes H_z + M_z the same at every
height, and the magnetomotive force between them is fixed by the circuit outside:

    h(z) + b(z) = C,      <h> = h_0,      h = H_z,   b = M_z,   < > the mean over the gap.

M_z is that of the grains' moments, each spread with the line integral of the kernel of `coupling.smeared_grains` over
both directions along the faces,

    K1(t) = 35/(32 a) (1 - t^2/a^2)^3,      b(z) = sum K1(z - z_i) m_z,i/area,

folded back at the faces as its images in ideal steel are, so that nothing is lost. So near pairs without their smear
(`coupling.pair_fields`) and this field count each pair once, as with a solved field.

The plain iteration M -> H grows where a layer's susceptibility exceeds 1. With chi = b/h' of the field h' in which the
moments were solved, h = C/(1 + chi) has the same fixed point, is never reversed, and leaves (chi - s)/(1 + chi) of an
error, s = db/dh: nothing where a layer is linear and far wider than the kernel, chi/(1 + chi) where it is saturated.
Where chi is at its bounds h = (C - (b - chi h'))/(1 + chi): the fixed point is that of the moments, whatever chi is.

Neglected: changes along the faces, and steel that is not ideal.
"""

from __future__ import annotations

from math import ceil
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import CubicSpline

NODES_A_WIDTH = 24
"""A grain is shared by two nodes before it is spread: that widens the kernel by 0.1 %."""
MAX_CHI = 100.0
"""Of a layer: b/h has no bound where h is near 0, and a step would then change nothing."""


class LayeredField:
    """Source of the field, which is its own sampler; even until the first moments are given.

    Parameters
    ----------
    given : float
        The field of even powder along z [A/m].
    gap : float
        Height of the gap, whose lower face is at z = 0 [m].
    area : float
        Of a face [m^2].
    width : float
        a [m], at most the gap.

    Attributes
    ----------
    height, strength : (k,) float64
        From face to face [m], H_z there [A/m].
    magnetisation : (k,) float64
        M_z there of the last moments [A/m].
    """

    solution: ClassVar[None] = None
    solves: ClassVar[int] = 0
    carrier: ClassVar[None] = None
    feedback: ClassVar[None] = None

    def __init__(self, given: float, gap: float, area: float, width: float) -> None:
        if not 0.0 < width <= gap:
            raise ValueError(f"`width` = {width} m of the smear; allowed: above 0, at most the gap {gap} m")
        self.given, self.height = given, np.linspace(0.0, gap, ceil(gap / width * NODES_A_WIDTH) + 1)
        z, step = self.height, np.full(len(self.height), self.height[1])
        step[[0, -1]] *= 0.5
        distances = (z - z[:, None], -z - z[:, None], 2.0 * gap - z - z[:, None])
        spread = sum(35.0 / (32.0 * width) * np.maximum(1.0 - (t / width) ** 2, 0.0) ** 3 for t in distances)
        self._spread = spread / (step @ spread) / area
        self._weight = step / gap
        self._set_strength(np.full(len(z), given))
        self.magnetisation = np.zeros(len(z))

    @property
    def sampler(self) -> LayeredField:
        """Itself."""
        return self

    def refresh(self, time: float) -> bool:
        """Nothing to solve at a window's end: the field goes with the moments."""
        return False

    def sample(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H (n, 3) [A/m] and grad H (n, 3, 3) [A/m^2] at positions (n, 3) [m]; beyond a face that of the face."""
        at = np.clip(position[:, 2], 0.0, self.height[-1])
        field, gradient = np.zeros((len(at), 3)), np.zeros((len(at), 3, 3))
        field[:, 2], gradient[:, 2, 2] = self._line(at), self._line(at, 1)
        return field, gradient

    def follow(self, position: np.ndarray, moment: np.ndarray) -> float:
        """Set the field of moments (n, 3) [A m^2] that were solved in the present one, at positions (n, 3) [m].

        Returns
        -------
        float
            Root mean square of the change over that of the field [-].
        """
        last = len(self.height) - 1
        place = np.clip(position[:, 2] / self.height[-1] * last, 0.0, last)
        node = np.minimum(place.astype(np.int64), last - 1)
        far, along = place - node, moment[:, 2]
        self.magnetisation = b = self._spread @ (
            np.bincount(node, along * (1.0 - far), last + 1) + np.bincount(node + 1, along * far, last + 1)
        )
        before = self.strength
        chi = np.clip(np.divide(b, before, out=np.zeros(last + 1), where=before != 0.0), 0.0, MAX_CHI)
        response, rest = 1.0 / (1.0 + chi), b - chi * before
        flux = (self.given + self._weight @ (response * rest)) / (self._weight @ response)
        self._set_strength(response * (flux - rest))
        size = self._weight @ self.strength**2
        change = self._weight @ (self.strength - before) ** 2
        return 0.0 if size == 0.0 else float(np.sqrt(change / size))  # a NaN stays one

    def window_part(self) -> None:
        """Return nothing: there is no coil."""

    def state(self) -> dict[str, Any]:
        """State for a bit-exact continuation."""
        return {"h": self.strength}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the state of a checkpoint."""
        self._set_strength(saved["h"])

    def _set_strength(self, strength: np.ndarray) -> None:
        self.strength, self._line = strength, CubicSpline(self.height, strength)
