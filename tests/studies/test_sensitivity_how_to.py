"""Sobol' indices by the page on sensitivity are those of Ishigami's function, also of runs with noise."""

import tomllib

import numpy as np
import pandas
import pytest
from test_documentation import DOCS, blocks

from emclutch.scene.sampling import SampleSection, read_ranges

pytest.importorskip("SALib", reason="the extra sensitivity is not installed")
PAGE = list(blocks(DOCS / "how_to" / "sensitivity.md"))
# Ishigami, Homma, ISUMA 1990: f = sin x1 + a sin^2 x2 + b x3^4 sin x1, x uniform in (-pi, pi)
A, B = 7.0, 0.1
V1, V2, V13 = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2, A**2 / 8.0, 8.0 * B**2 * np.pi**8 / 225.0
V = V1 + V2 + V13
FIRST, TOTAL = np.array([V1, V2, 0.0]) / V, np.array([V1 + V13, V2, V13]) / V
COUNT = 1024  # of points in place of those of the page
SHARE = 0.3  # of the noise in the variance of the torques


@pytest.fixture
def table(tmp_path, monkeypatch):
    """The table of the page's study in its folder: torques are Ishigami's function, and larger by 5 with seed 2."""
    monkeypatch.chdir(tmp_path)
    study = tomllib.loads(next(text for _, caption, text in PAGE if caption == "sensitivity.toml"))["study"]
    sample = SampleSection(**{**study["sample"], "count": COUNT})
    values, sample, faults = read_ranges(study["values"], sample)
    points = pandas.DataFrame(sample.points(values))
    ends = np.array([[study["values"][key][end] for key in sample.over] for end in ("from", "to")])
    x = np.pi * (2.0 * (points[list(sample.over)].to_numpy() - ends[0]) / (ends[1] - ends[0]) - 1.0).T
    torque = np.sin(x[0]) + A * np.sin(x[1]) ** 2 + B * x[2] ** 4 * np.sin(x[0]) + 5.0 * (points["scene.seed"] == 2)
    (tmp_path / "sensitivity" / "point-000").mkdir(parents=True)
    (tmp_path / "sensitivity" / "point-000" / "history.csv").touch()
    assert not faults and len(points) == 2 * 5 * COUNT
    return points.assign(end_time=1.0, torque=torque, folder="point-000")


def by_the_page(table):
    """Its indices before and after the subtraction of the noise, and the share of the noise."""
    table.to_csv("sensitivity/study.csv", index=False)
    first, second = (text for language, _, text in PAGE if language == "python")
    assert "count, seeds = 64, 2" in first
    names = {}
    exec(first.replace("count, seeds = 64, 2", f"count, seeds = {COUNT}, 2"), names)
    raw = names["indices"].copy()
    exec(second, names)
    return raw, names["indices"], names["share"]


@pytest.mark.physics
def test_indices_of_ishigamis_function(table):
    """What all runs of one seed have in common is no noise."""
    raw, indices, share = by_the_page(table)
    assert share == pytest.approx(0.0, abs=1e-12) and np.allclose(raw, indices)
    for column, exact in (("S1", FIRST), ("ST", TOTAL)):
        off = np.abs(indices[column] - exact)
        assert (off < indices[f"{column}_conf"]).all() and off.max() < 0.03


@pytest.mark.physics
def test_noise_is_subtracted(table):
    """Noise differs from point to point. x3 does nothing alone: its total index would be 0.47 in place of 0.24."""
    quiet = by_the_page(table)[1]
    random = np.random.default_rng(1)
    square = 2.0 * SHARE / (1.0 - SHARE) * V * random.uniform(0.5, 1.5, len(table))
    noise = np.sqrt(square) * random.standard_normal(len(table))
    raw, indices, share = by_the_page(table.assign(torque=table["torque"] + noise))
    assert share == pytest.approx(SHARE, abs=0.02) and raw["ST"].iloc[2] > 0.4
    for column, exact in (("S1", FIRST), ("ST", TOTAL)):
        bar = indices[f"{column}_conf"]
        assert (np.abs(indices[column] - exact) < 1.5 * bar).all()
        assert np.abs(indices[column] - quiet[column]).max() < 0.08
        assert (bar > 1.1 * quiet[f"{column}_conf"]).all()  # the bars contain the noise


def test_a_table_with_a_run_missing_is_refused(table):
    with pytest.raises(ValueError, match="cannot reshape"):
        by_the_page(table.drop(index=7))
