"""Samples of a study's ranges fill them evenly, follow from their seed alone, and are refused without sense."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.scene.errors import SceneError
from emclutch.scene.study import read_study

GOOD = Path(__file__).parent / "broken" / "good.toml"
RANGES = '"coil.voltage" = { from = "10 V", to = "26 V" }\n"contact.friction" = { from = 0.0, to = 0.8 }\n'


def study(folder, values, sample=""):
    path = folder / "study.toml"
    path.write_text(f'[study]\ncase = "{GOOD}"\n{values}' if "[study" in values else
                    f'[study]\ncase = "{GOOD}"\n[study.values]\n{values}[study.sample]\n{sample}'
                    if sample else f'[study]\ncase = "{GOOD}"\n[study.values]\n{values}')  # fmt: skip
    return read_study(path)


def in_cube(points):
    """The fractions of both ranges, shape (n, 2)."""
    volts = [float(point["coil.voltage"].split()[0]) for point in points]
    return np.array([volts, [point["contact.friction"] for point in points]]).T / [16.0, 0.8] - [10.0 / 16.0, 0.0]


def layers(fractions, count):
    """How many lie in each of so many equal layers."""
    return np.bincount(np.floor(fractions * count).astype(int), minlength=count)


def test_each_layer_of_a_latin_hypercube_has_one_point(tmp_path):
    cube = in_cube(study(tmp_path, RANGES, 'method = "latin_hypercube"\ncount = 13\nseed = 4').points())
    assert cube.shape == (13, 2)
    assert all((layers(cube[:, k], 13) == 1).all() for k in (0, 1))


def test_each_elementary_interval_of_sobols_points_has_one(tmp_path):
    """A (0, m, 2)-net in base 2: of 16 points one in each of the rectangles 1/16 x 1, 1/8 x 1/2, ... 1 x 1/16."""
    cube = in_cube(study(tmp_path, RANGES, 'method = "sobol"\ncount = 16\nseed = 4').points())
    for k in range(5):
        cells = np.floor(cube * [2**k, 2 ** (4 - k)]).astype(int)
        assert len({tuple(cell) for cell in cells}) == 16
    assert len({tuple(point) for point in cube}) == 16


def test_a_sample_follows_from_its_seed_and_more_of_sobols_begin_with_the_same(tmp_path):
    def points(count, seed, method="sobol"):
        return study(tmp_path, RANGES, f'method = "{method}"\ncount = {count}\nseed = {seed}').points()

    assert points(8, 1) == points(8, 1) == points(32, 1)[:8] and points(8, 1) != points(8, 2)
    assert points(8, 1, "latin_hypercube") == points(8, 1, "latin_hypercube") != points(8, 2, "latin_hypercube")


def test_listed_values_are_combined_with_each_point_of_a_sample(tmp_path):
    values = RANGES + '"scene.seed" = [1, 2, 3]\n'
    values += '"geometry.cover_thickness" = { from = "2 mm", to = "3 mm", count = 2 }\n'
    read = study(tmp_path, values, 'method = "sobol"\ncount = 4')
    points = read.points()
    assert len(points) == 24 == len({repr(point) for point in points}) == read.sample.size(read.values)
    assert [point["scene.seed"] for point in points[:6]] == [1, 1, 2, 2, 3, 3]
    assert len({repr(in_cube([point])) for point in points[:6]}) == 1
    assert list(points[0]) == ["coil.voltage", "contact.friction", "scene.seed", "geometry.cover_thickness"]
    assert len(list(read.cases())) == 24


def test_one_at_a_time_changes_one_key_from_the_first_values(tmp_path):
    values = '"coil.voltage" = ["10 V", "20 V", "24 V"]\n"contact.friction" = { from = 0.2, to = 0.4, count = 2 }\n'
    read = study(tmp_path, values + '"scene.seed" = [1, 2]\n', 'method = "one_at_a_time"')
    expected = [("10 V", 0.2), ("20 V", 0.2), ("24 V", 0.2), ("10 V", 0.4)]
    assert [tuple(point.values()) for point in read.points()] == [(*one, seed) for one in expected for seed in (1, 2)]
    assert read.sample.size(read.values) == 8


def test_a_range_is_a_list_of_values(tmp_path):
    """Linear or geometric, both ends included; a dotted key may be written as tables."""
    values = 'coil.voltage = { from = "1 V", to = "16 V", count = 5, spacing = "log" }\n'
    values += '"contact.friction" = { from = 0, to = 0.3, count = 4 }\n'
    values += '"scene.seed" = { from = 1, to = 3, count = 3, whole = true }\n'
    read = study(tmp_path, values)
    assert read.values == {"coil.voltage": ["1 V", "2 V", "4 V", "8 V", "16 V"],
                           "contact.friction": [0.0, 0.1, 0.2, 0.3], "scene.seed": [1, 2, 3]}  # fmt: skip
    assert len(read.points()) == 60


@pytest.mark.parametrize(
    ("values", "sample", "faults"),
    [
        (RANGES, 'method = "sobol"\ncount = 12', {"study.sample.count": "no power of two, .*take 8 or 16"}),
        (RANGES, 'method = "sobol"', {"study.sample.count": "is missing; allowed: 1 to 10000"}),
        (RANGES, 'method = "random"\ncount = 3', {"study.sample.method": "latin_hypercube.*sobol.*one_at_a_time"}),
        (RANGES, 'method = "adaptive"', {"study.sample.method": "no method any more; emclutch map .*latin_hypercube"}),
        (RANGES, "", {"study.values.coil.voltage": r"has no count; give it a count, or sample it: \[study.sample\]",
                      "study.values.contact.friction": "has no count"}),
        (RANGES, 'method = "one_at_a_time"\nseed = 1',
         {"study.sample.seed": "no meaning", "study.values.coil.voltage": "has no count",
          "study.values.contact.friction": "has no count; give it a count"}),
        ('"contact.friction" = [0.1]\n', 'method = "sobol"\ncount = 4',
         {"study.sample.method": "study.values has none"}),
        ('"coil.voltage" = { from = "3 V", to = "200 mV", steps = 4 }\n', "",
         {"study.values.coil.voltage.steps": "may have: from, to, count", "study.values.coil.voltage.to": "same unit"}),
        ('"contact.friction" = { from = 0.3, to = 0.1, count = 1 }\n', "",
         {"study.values.contact.friction.to": "not above from = 0.3",
          "study.values.contact.friction.count": "allowed: 2 to 10000"}),
        ('"contact.friction" = { from = 0, to = 1, count = 3, spacing = "log" }\n', "",
         {"study.values.contact.friction.from": "allowed: above 0"}),
        ('"contact.friction" = { from = 0.5, count = 3 }\n', "", {"study.values.contact.friction.to": "is missing"}),
        ('"scene.seed" = { from = 0.5, to = 3, count = 3, whole = true }\n', "",
         {"study.values.scene.seed.whole": "needs whole numbers"}),
        ('"contact.friction" = { from = 0.1, to = 20 }\n', 'method = "sobol"\ncount = 2',
         {"contact.friction": r"at contact\.friction = "}),
        (RANGES, 'method = "sobol"\ncount = 16384', {"study.sample.count": "10000"}),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_with_its_remedy(values, sample, faults, tmp_path):
    with pytest.raises(SceneError) as refused:
        study(tmp_path, values, sample)
    found = {fault.key: fault.message for fault in refused.value.faults}
    assert set(found) == set(faults), found
    for key, message in faults.items():
        with pytest.raises(AssertionError, match=message):
            raise AssertionError(found[key])


def test_a_dry_run_lists_the_points_of_a_study(tmp_path):
    study(tmp_path, '"contact.friction" = { from = 0.1, to = 0.5, count = 5 }\n')
    ask = ["sweep", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--dry-run"]
    answer = CliRunner().invoke(app, ask)
    assert answer.exit_code == 0
    assert answer.stdout.splitlines() == ["point,contact.friction", "0,0.1", "1,0.2", "2,0.3", "3,0.4", "4,0.5"]
    assert not (tmp_path / "out").exists()
