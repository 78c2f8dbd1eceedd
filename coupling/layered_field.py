"""A macroscopic field across an annulus between steel cylinders, changed by the layers that its grains stand in.

A field of one dimension is known from the magnetisation. Across coaxial faces div B = 0 makes r (H_r + M_r) the same at
every radius, and the magnetomotive force between them is fixed by the circuit outside, the integral of H_r dr:

    h(r) + b(r) = C,      <h> = h_0,      h = r H_r,   b = r M_r,   < > = integral dr/r over that of the gap;

for a narrow gap H_n = H - (M_n - mean M_n). M_r is that of the grains' moments, each spread with the line integral of
the kernel of `coupling.smeared_grains` over both directions along the faces,

    K1(t) = 35/(32 a) (1 - t^2/a^2)^3,      b(r) = sum K1(r - r_i) m_r,i/(angle height),

folded back at the faces as its images in ideal steel are, so that nothing is lost. So near pairs without their smear
(`coupling.pair_fields`) and this field count each pair once, as with a solved field. Dividing by r alone, where the
section's kernel divides by sqrt(r r_i), leaves b of even powder even up to the faces; in both cases the field has no
torque about the axis.

The plain iteration M -> H grows where a layer's susceptibility exceeds 1. With chi = b/h' of the field h' in which the
moments were found, h = C/(1 + chi) has the same fixed point, is never reversed, and leaves (chi - s)/(1 + chi) of an
error, s = db/dh: nothing where a layer is linear and far wider than the kernel, chi/(1 + chi) where it is saturated.
Where chi is at its bounds h = (C - (b - chi h'))/(1 + chi): the fixed point is that of the moments, whatever chi is.

Neglected: changes along the faces, and steel that is not ideal.
"""

from __future__ import annotations

from math import ceil
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import CubicSpline

from field import RadialField
from geometry import ShearCell

NODES_A_WIDTH = 24
"""A grain is shared by two nodes before it is spread: that widens the kernel by 0.1 %."""
MAX_CHI = 100.0
"""Of a layer: b/h has no bound where h is near 0, and a step would then change nothing."""


class LayeredField:
    """Source of the field, which is its own sampler; even until the first moments are taken.

    Parameters
    ----------
    imposed : RadialField
        The field of even powder.
    cell : ShearCell
        With faces of steel.
    angle : float
        Of the simulated sector [rad].
    width : float
        a [m], at most the gap.

    Attributes
    ----------
    radius, strength : (k,) float64
        From face to face [m], H_r there [A/m].
    magnetisation : (k,) float64
        M_r there of the moments last taken [A/m].
    """

    solution: ClassVar[None] = None
    solves: ClassVar[int] = 0
    carrier: ClassVar[None] = None
    feedback: ClassVar[None] = None

    def __init__(self, imposed: RadialField, cell: ShearCell, angle: float, width: float) -> None:
        inner, outer = cell.inner_radius, cell.outer_radius
        if not 0.0 < width <= outer - inner:
            raise ValueError(f"`width` = {width} m of the smear; allowed: above 0, at most the gap {outer - inner} m")
        self.radius = r = np.linspace(inner, outer, ceil((outer - inner) / width * NODES_A_WIDTH) + 1)
        step = np.full(len(r), r[1] - r[0])
        step[[0, -1]] *= 0.5
        distances = (r - r[:, None], 2.0 * inner - r - r[:, None], 2.0 * outer - r - r[:, None])
        spread = sum(35.0 / (32.0 * width) * np.maximum(1.0 - (t / width) ** 2, 0.0) ** 3 for t in distances)
        self._spread = spread / (step @ spread) / (angle * cell.height)
        self._weight = step / r / (step / r).sum()
        self._given = imposed.H0 * imposed.R0
        self._take(np.full(len(r), self._given))
        self.magnetisation = np.zeros(len(r))

    @property
    def sampler(self) -> LayeredField:
        """Itself."""
        return self

    @property
    def strength(self) -> np.ndarray:
        """H_r at the nodes [A/m]."""
        return self._h / self.radius

    def refresh(self, time: float) -> bool:
        """Nothing to solve at a window's end: the field goes with the moments."""
        return False

    def sample(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H (n, 3) [A/m] and grad H (n, 3, 3) [A/m^2] at positions (n, 3) [m]; beyond a face that of the face."""
        r, e = _radii(position)
        at = np.clip(r, self.radius[0], self.radius[-1])
        H, slope = self._line(at) / r, self._line(at, 1) / r
        field, gradient = np.zeros((len(r), 3)), np.zeros((len(r), 3, 3))
        field[:, :2] = H[:, None] * e
        around = (H / r)[:, None, None]
        gradient[:, :2, :2] = around * np.eye(2) + (slope[:, None, None] - 2.0 * around) * e[:, :, None] * e[:, None, :]
        return field, gradient

    def follow(self, position: np.ndarray, moment: np.ndarray) -> float:
        """Take the field of moments (n, 3) [A m^2] that were found in the present one, at positions (n, 3) [m].

        Returns
        -------
        float
            Root mean square of the change over that of the field [-].
        """
        r, e = _radii(position)
        radial = (e * moment[:, :2]).sum(axis=1)
        last = len(self.radius) - 1
        place = np.clip((r - self.radius[0]) / (self.radius[-1] - self.radius[0]) * last, 0.0, last)
        node = np.minimum(place.astype(np.int64), last - 1)
        far = place - node
        b = self._spread @ (
            np.bincount(node, radial * (1.0 - far), last + 1) + np.bincount(node + 1, radial * far, last + 1)
        )
        self.magnetisation = b / self.radius
        before = self._h
        chi = np.clip(np.divide(b, before, out=np.zeros(last + 1), where=before != 0.0), 0.0, MAX_CHI)
        answer, rest = 1.0 / (1.0 + chi), b - chi * before
        flux = (self._given + self._weight @ (answer * rest)) / (self._weight @ answer)
        self._take(answer * (flux - rest))
        size = self._weight @ self._h**2
        return 0.0 if size == 0.0 else float(np.sqrt(self._weight @ (self._h - before) ** 2 / size))  # a NaN stays one

    def window_part(self) -> None:
        """Return nothing: there is no coil."""

    def state(self) -> dict[str, Any]:
        """State for a bit-exact continuation."""
        return {"h": self._h}

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up the state of a checkpoint."""
        self._take(saved["h"])

    def _take(self, h: np.ndarray) -> None:
        self._h, self._line = h, CubicSpline(self.radius, h)


def _radii(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """r (n,) [m] and the unit vectors e_r (n, 2)."""
    r = np.hypot(position[:, 0], position[:, 1])
    return r, position[:, :2] / r[:, None]
