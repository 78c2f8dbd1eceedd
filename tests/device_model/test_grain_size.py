"""Grains that stand for finer ones: numbers of grains, what a scene is warned of, and that stresses have no size."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emclutch
from coupling import magnetised_cluster
from emclutch.device_model.device import build_device
from emclutch.device_model.grain_size import COEFFICIENT, EXPONENT, grain_size
from emclutch.scene.errors import SceneError
from field import GrainLaw

CASE = emclutch.load_case(Path(__file__).resolve().parents[2] / "cases" / "powder_clutch.toml").with_values(
    {"particles.diameter": "0.2 mm"}
)


def size_of(**particles):
    values = {f"particles.{key}": value for key, value in particles.items()} | {"effects.back_reaction": None}
    scene = CASE.with_values(values).scene
    return grain_size(scene, build_device(scene))


def test_numbers_of_real_grains():
    """20 g of 7700 kg/m^3 in grains of 60 um, in a gap of 1 mm, simulated with grains of 0.2 mm."""
    size = size_of(stands_for="60 um")
    real = 20e-3 / 7700.0 / (math.pi / 6.0 * 60e-6**3)
    assert size.across == pytest.approx(5.0) and size.real_count == pytest.approx(real, rel=1e-3)
    assert size.count == pytest.approx(real * 0.3**3, rel=1e-3)
    summary = size.as_dict()
    assert summary["coarse_graining"] == pytest.approx(1.0 / 0.3)
    assert summary["real_across"] == pytest.approx(1.0 / 0.06)
    assert "5 simulated grains span the gap; the real powder has 17 (60 µm)" in summary["note"]


def test_coarse_grains_add_what_the_law_of_their_size_says():
    """(1 + a/n^p) over that of the real ones, rising with a; a warning above a tenth, nothing of real grains."""
    excess = []
    for real in ("0.19 mm", "60 um", "20 um"):
        size = size_of(stands_for=real)
        n, value, low, high = size.gap / size.real_diameter, *size.torque_excess()
        for one, a in zip((value, low, high), COEFFICIENT, strict=True):
            assert (1.0 + one) * (1.0 + a / n**EXPONENT) == pytest.approx(1.0 + a / 5.0**EXPONENT)
        assert 0.0 < low < value < high and size.as_dict()["torque_excess"] == value
        assert f"{100.0 * value:.2g} % (95 %" in " ".join([size.in_words(), *size.warnings()])
        assert [f"the torque by {100.0 * value:.2g} %" in text for text in size.warnings()] == [True] * (value > 0.1)
        excess.append(value)
    assert excess[0] < 0.1 < excess[1] < excess[2] < COEFFICIENT[0] / 5.0**EXPONENT
    real = size_of(stands_for="0.2 mm")
    assert real.torque_excess() is None and "torque_excess" not in real.as_dict()


def test_the_law_of_the_powder_takes_the_place_of_the_general_one():
    general, by_law = size_of(stands_for="60 um"), replace(size_of(stands_for="60 um"), by_law=(0.2, 0.15, 0.25))
    assert by_law.torque_excess() == (0.2, 0.15, 0.25) != general.torque_excess()
    assert by_law.as_dict()["torque_excess_low"] == 0.15 and "by the law of the powder" in by_law.as_dict()["note"]
    assert replace(size_of(stands_for="0.2 mm"), by_law=(0.2, 0.15, 0.25)).torque_excess() is None


def test_an_accuracy_study_of_the_device_silences_the_general_law():
    """Its error of the size is the one that is told; a summary names the correction in its note, not as a warning."""
    size = size_of(stands_for="60 um")
    value = f"{100.0 * size.torque_excess()[0]:.2g} %"
    assert value in size.as_dict()["note"] and "warnings" not in size.as_dict()
    assert value not in size.as_dict(measured=True)["note"] + size.in_words(measured=True)
    assert size.warnings(measured=True) == [] and len(size.warnings()) == 1


def test_a_real_powder_of_many_sizes_is_counted_by_its_mean_volume():
    """By mass: n = (V/(pi/6)) sum q (a^-3 - b^-3)/(3 ln(b/a)), each section's integral of d^-3 over its mass."""
    percentiles = {"d10": "40 um", "d50": "60 um", "d90": "90 um"}
    size = size_of(stands_for=percentiles)
    edges, shares = np.array([80.0 / 3.0, 40.0, 60.0, 90.0, 135.0]) * 1e-6, np.array([0.1, 0.4, 0.4, 0.1])
    a, b = edges[:-1], edges[1:]
    per_volume = np.sum(shares * (a**-3 - b**-3) / (3.0 * np.log(b / a))) * 6.0 / math.pi
    assert size.real_count == pytest.approx(20e-3 / 7700.0 * per_volume, rel=1e-3)
    assert size.real_diameter == pytest.approx(np.sum(shares * (b - a) / np.log(b / a)), rel=1e-12)


def test_few_grains_of_real_size_are_a_warning():
    assert "set particles.stands_for" in size_of(stands_for=None).warnings()[0]
    assert size_of(stands_for="0.2 mm").warnings() == []  # shot, and the scene says so
    assert "of real size" in size_of(stands_for="0.2 mm").in_words()


def test_pulls_that_depend_on_the_size_are_a_warning():
    case = CASE.with_values({"effects.cohesion": {"force": "1 uN"}, "effects.back_reaction": None})
    *_, warning = grain_size(case.scene, build_device(case.scene)).warnings()
    assert "effects.cohesion" in warning and "1/d^2" in warning


@pytest.mark.parametrize(
    "value, words",
    [
        ("0.3 mm", "is larger than the grains that stand for it, of 0.2 mm"),
        ("3 kg", "is a mass; a length is needed"),
        ({"d10": "40 um", "d50": "60 um", "d90": "50 um"}, "d90 = '50 um' is not above d50 = 0.06 mm"),
        ({"d10": "40 um", "d50": "60 um"}, "d90 is missing"),
    ],
)
def test_wrong_real_sizes_are_refused(value, words):
    with pytest.raises(SceneError, match=words):
        CASE.with_values({"particles.stands_for": value})


def test_magnetic_stress_has_no_size():
    """Spheres of four times the size in the same arrangement: the same magnetisation, forces 16 times as large."""
    x = np.array([[0.0, 0.0, 0.0], [2.02, 0.0, 0.1], [1.0, 1.9, 0.0]])
    fine, coarse = (
        magnetised_cluster(size * x, size, GrainLaw(999.0, 1.7e6), [80e3, 0.0, 0.0]) for size in (30e-6, 120e-6)
    )
    assert coarse.magnetisation == pytest.approx(fine.magnetisation, rel=1e-9)
    scale = np.abs(fine.force).max()
    assert np.abs(coarse.force / 16.0 - fine.force).max() < 1e-9 * scale
