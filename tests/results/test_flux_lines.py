"""Level lines of a function that is linear on triangles are straight, and lie where the function has the level."""

import numpy as np
import pytest

from emclutch.results.vtk.flux_lines import level_segments


def test_lines_of_a_linear_function_are_straight_and_whole():
    n = 12
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0.0, 1.0, n + 1), np.linspace(0.0, 1.0, n + 1)))
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    triangles = np.concatenate(
        [np.column_stack([corner, corner + end, corner + other]) for end, other in ((1, n + 2), (n + 2, n + 1))]
    )
    segments = level_segments(np.column_stack([x, y]), triangles, 2.0 * x + y, 1.3)
    assert np.allclose(segments @ (2.0, 1.0), 1.3, rtol=0.0, atol=1e-14)
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum()
    assert length == pytest.approx(np.hypot(1.0, 0.5))  # from (0.15, 1) to (0.65, 0)
    assert len(level_segments(np.column_stack([x, y]), triangles, x, 2.0)) == 0


def test_circles_of_a_subdivided_section_converge_with_the_square_of_its_edges():
    """x^2 + y^2 = 1/4: chords of linear triangles lie O(h^2) off the circle."""
    errors = []
    for n in (8, 16, 32):
        x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0.0, 1.0, n + 1), np.linspace(0.0, 1.0, n + 1)))
        corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
        triangles = np.column_stack([corner, corner + 1, corner + n + 2])
        lines = level_segments(np.column_stack([x, y]), triangles, x * x + y * y, 0.25)
        errors.append(np.abs(np.linalg.norm(lines.mean(axis=1), axis=1) - 0.5).max())
    assert errors[0] / errors[1] > 3.0 and errors[1] / errors[2] > 3.0
