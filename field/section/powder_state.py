"""State of the powder in a section or in 3D: its distribution and magnetisation.

In an element of the solid fraction phi the powder's magnetisation is

    M = phi M_grain(|B|; N) B/|B| + source,

with the grain's law in the demagnetising factor N against H, and a `source` that no law follows: what the moments of
the grains are, beyond their law at the field of the last solve. A fill alone has the factor of the Lorentz cavity and
no source (`field.laws.powder_law`). In 3D it is the same with H instead of B: phi M_grain(|H|; N) H/|H| + source.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class PowderState:
    """Powder on the m elements that `powder_elements` of the problem names.

    Attributes
    ----------
    fill : (m,) float64
        Solid fraction [-].
    factor : (m,) float64 or None
        Demagnetising factor N of a grain against the macroscopic H [-]; None: (1 - phi)/3.
    source : (m, 2, q) or (m, 3, q) float64 or None
        M_r, M_z, in 3D M_x, M_y, M_z, beyond the law's [A/m] at the elements' quadrature points; None: none.
    """

    fill: np.ndarray
    factor: np.ndarray | None = None
    source: np.ndarray | None = None

    @property
    def arguments(self) -> tuple[np.ndarray, np.ndarray | None]:
        """phi and N as columns (m, 1), as `PowderLaw` takes them with B (m, k)."""
        return self.fill[:, None], None if self.factor is None else self.factor[:, None]

    def on_points(self, old: np.ndarray, new: np.ndarray) -> PowderState:
        """The same powder for other quadrature points on the reference triangle, (q, 2) and (k, 2).

        The source is carried over by the polynomial of the highest degree that the old points determine.
        """
        if self.source is None or (old.shape == new.shape and np.array_equal(old, new)):
            return self
        degree = max(n for n in range(4) if (n + 1) * (n + 2) // 2 <= len(old))

        def powers(points: np.ndarray) -> np.ndarray:
            return np.stack([points[:, 0] ** i * points[:, 1] ** j for i, j in np.ndindex(4, 4) if i + j <= degree], 1)

        carry = powers(new) @ np.linalg.pinv(powers(old))
        return PowderState(self.fill, self.factor, np.ascontiguousarray(self.source @ carry.T))


Powder = np.ndarray | PowderState | None
"""What a solve takes: a state, a fill (m,) alone, or no powder."""


def powder_state(powder: Powder) -> PowderState | None:
    """The state that a fill alone means; states and None as they are."""
    return PowderState(powder) if isinstance(powder, np.ndarray) else powder


def checked_powder(powder: Powder, count: int, points: tuple[int, int]) -> PowderState | None:
    """The state that a solve takes on `count` elements with a source of the shape (count, *points).

    Raises ValueError for a fill outside [0, 1) or arrays of the wrong shape.
    """
    state = powder_state(powder)
    if state is None:
        return None
    fill = np.ascontiguousarray(state.fill, dtype=float)
    if fill.shape != (count,):
        raise ValueError(f"`fill` has shape {fill.shape}; the powder has {count} elements")
    if not np.all((fill >= 0.0) & (fill < 1.0)):
        worst = fill[int(np.argmax(np.where(np.isfinite(fill), np.abs(fill - 0.5), np.inf)))]
        raise ValueError(
            f"`fill` holds {worst:g}; a solid fraction is at least 0 and below 1 (random packing: 0.55 to 0.64)"
        )
    if state.factor is not None and not (state.factor.shape == fill.shape and np.all(state.factor > -fill)):
        raise ValueError("`factor` must have the shape of `fill`, and N + phi must be above 0 everywhere")
    expected = (count, *points)
    if state.source is not None and not (state.source.shape == expected and np.all(np.isfinite(state.source))):
        raise ValueError(f"`source` has shape {state.source.shape}: finite numbers of shape {expected} are needed")
    return PowderState(fill.copy(), state.factor, state.source)
