"""Estimated number of elements of a mesh from its sizes: far too large ones are refused before meshing.

A size field is s inside a shape and s + g d at a distance d from it, as in `geometry.meshing`. An equilateral triangle
of side h has the area sqrt(3)/4 h^2, so that a shape of area A and perimeter P asks for

    A/(sqrt(3)/4 s^2) + integral of P dd/(sqrt(3)/4 (s + g d)^2) = (A/s^2 + P/(g s))/(sqrt(3)/4)

triangles. The least of several sizes rules, so that the sum over the shapes counts some places twice; corners and the
air around the device are left out. It is the number within a factor of two.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

MAX_TRIANGLES = 3e5
"""Of a section; of order 2 their field takes 2.4 GB."""
MAX_TETRAHEDRA = 1e6
"""Of a sector in 3D; of order 2 their field takes some 7 GB."""

_TRIANGLE = math.sqrt(3.0) / 4.0  # area over the side squared

Shape = tuple[float, float, float]
"""Size inside [m], width and height [m] of a rectangle; a line or a point has no height, or neither."""


def expected_triangles(shapes: Iterable[Shape], growth: float) -> float:
    """Triangles of a mesh whose size is the least of those of some shapes; see the module."""
    return sum((w * h / s**2 + 2.0 * (w + h) / (growth * s)) / _TRIANGLE for s, w, h in shapes)


def refuse_too_many(count: float, most: float, kind: str) -> None:
    """ValueError with a remedy where a mesh would have more than `most` elements of a `kind`, as "triangles"."""
    if count > most:
        raise ValueError(
            f"the mesh would have about {count:.2g} {kind}; allowed: at most {most:.2g}; raise field.size_factor, "
            "lower field.gap_layers, or check the units of the gaps and of all other lengths"
        )
