"""Bounds of the hard scenes that are derived: what they allow is reached by the worst, and left by none."""

from types import SimpleNamespace

import numpy as np
import pytest
from hard_scene import hard_scenes
from invariants import field_torque, step_error


def impact_error(n: float, begin: float) -> float:
    """Energy that an elastic impact on a spring gains by velocity Verlet, over what it had.

    `n` steps of 1 are half a period; at first the spring is touched after the fraction `begin` of a step.
    """
    stiffness, x, v = (np.pi / n) ** 2, -begin, 1.0
    while v > 0.0 or x > 0.0:
        v -= 0.5 * stiffness * max(x, 0.0)
        x += v
        v -= 0.5 * stiffness * max(x, 0.0)
    return v**2 - 1.0


@pytest.mark.parametrize("steps", [10.0, 20.0, 100.0])
def test_an_impact_misses_at_most_the_share_of_a_step_and_some_nearly_that(steps):
    run = SimpleNamespace(case=SimpleNamespace(scene=SimpleNamespace(time=SimpleNamespace(steps_per_contact=steps))))
    found = [abs(impact_error(n, at)) for n in np.linspace(steps, steps + 1.0, 11) for at in np.linspace(0, 1, 11)]
    assert 0.8 * step_error(run) < max(found) < 1.05 * step_error(run)


@pytest.mark.slow
def test_what_is_left_of_the_fields_torque_is_the_tolerance_of_the_moments(tmp_path):
    """Blocks that touch exactly: pulls along the ring cancel, and what does not is what the moments miss."""
    scene = next(one for one in hard_scenes() if one.name == "touching_grains")
    left = [
        field_torque(scene.run(tmp_path / f"{one:g}", scene.short | {"effects.dipoles.tolerance": one}), 1.0)
        for one in (1e-3, 1e-5)
    ]
    assert left[1] < 0.25 * left[0] < 0.25 * scene.bounds["field_torque"]
