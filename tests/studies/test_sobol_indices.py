"""Sobol' indices of Ishigami's function are those of its closed form, whatever noise the outputs have."""

from pathlib import Path

import numpy as np
import pandas
import pytest

import emclutch
from emclutch.scene.sampling import SampleSection, read_ranges
from emclutch.studies.sobol_indices import indices_of

pytest.importorskip("SALib", reason="the extra sensitivity is not installed")
GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
# Ishigami, Homma, ISUMA 1990: f = sin x1 + a sin^2 x2 + b x3^4 sin x1, x uniform in (-pi, pi)
A, B = 7.0, 0.1
V1, V2, V13 = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2, A**2 / 8.0, 8.0 * B**2 * np.pi**8 / 225.0
V = V1 + V2 + V13
FIRST, TOTAL = np.array([V1, V2, 0.0]) / V, np.array([V1 + V13, V2, V13]) / V


def ishigami(count):
    """Outputs at the points of a sample, as a study has them."""
    names = ["x1", "x2", "x3"]
    sample = SampleSection(method="saltelli", count=count, seed=3)
    values, sample, faults = read_ranges({key: {"from": -np.pi, "to": np.pi} for key in names}, sample)
    assert not faults and sample.size(values) == 5 * count
    x = np.array([[point[name] for name in names] for point in sample.points(values)]).T
    return names, np.sin(x[0]) + A * np.sin(x[1]) ** 2 + B * x[2] ** 4 * np.sin(x[0])


@pytest.mark.physics
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_indices_of_ishigamis_function(share):
    """With noise that differs from point to point, here of 30 % of all variance, too: without its subtraction x3,
    which does nothing alone, would have a total index of 0.4 in place of 0.24."""
    names, clean = ishigami(2048)
    random = np.random.default_rng(1)
    noise = np.sqrt(share / (1.0 - share) * V) * np.sqrt(random.uniform(0.5, 1.5, clean.size))
    found = pandas.DataFrame(indices_of(names, clean + noise * random.standard_normal(clean.size), noise))
    assert found["noise"].to_numpy() == pytest.approx(share, abs=0.02)
    for column, bar, exact in (("first", "first_bar", FIRST), ("total", "total_bar", TOTAL)):
        off = np.abs(found[column].to_numpy() - exact)
        assert (off < 1.5 * found[bar].to_numpy()).all() and off.max() < 0.06
    quiet = pandas.DataFrame(indices_of(names, clean, np.zeros_like(clean)))
    if share:
        assert (found["first_bar"] > 1.1 * quiet["first_bar"]).all()  # the bars know the noise


def test_bars_hold_what_they_say():
    """Of 40 samples with noise, the exact index is in the bar of about 95 %."""
    names, clean = ishigami(128)
    held = []
    for seed in range(40):
        random = np.random.default_rng(seed)
        sigma = 0.5 * np.sqrt(V)
        found = indices_of(names, clean + sigma * random.standard_normal(clean.size), np.full(clean.size, sigma))
        held += [abs(one["total"] - exact) < one["total_bar"] for one, exact in zip(found, TOTAL, strict=True)]
    assert 0.85 < np.mean(held) <= 1.0  # 120 draws of 95 %: a standard deviation of 2 %, of which five


def study_in(folder, seeds="[1, 2]"):
    path = folder / "study.toml"
    path.write_text(
        f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = {{ from = 0.1, to = 0.5 }}\n'
        f'"motion.rotor.speed" = {{ from = "10 rpm", to = "20 rpm" }}\n"scene.seed" = {seeds}\n'
        '[study.sample]\nmethod = "saltelli"\ncount = 4\n'
    )
    return emclutch.read_study(path)


def test_a_studys_torque_that_follows_one_value_has_no_index_of_the_other(tmp_path):
    study = study_in(tmp_path)
    points = study.points()
    assert len(points) == 4 * 4 * 2
    rows = [
        {**point, "end_time": 1.0, "torque": 3.0 * point["contact.friction"], "standard_error": 0.1, "folder": "a"}
        for point in points
    ]
    pandas.DataFrame(rows).sample(frac=1.0, random_state=1).to_csv(tmp_path / "study.csv", index=False)
    found = emclutch.sobol_indices(study, tmp_path)
    assert found["value"].tolist() == ["contact.friction", "motion.rotor.speed"]
    assert found["noise"].tolist() == [0.0, 0.0]  # by the replicas, which are alike
    assert found["total"][1] == found["first"][1] == 0.0 and found["total"][0] > 0.3
    pandas.DataFrame(rows[:-1]).to_csv(tmp_path / "study.csv", index=False)
    with pytest.raises(emclutch.OutputError, match=r"1 runs of .* are not done: continue the study with --resume"):
        emclutch.sobol_indices(study, tmp_path)


def test_what_runs_of_one_seed_have_in_common_is_no_noise(tmp_path):
    """It is in no difference of two points. Of two replicas the noise follows from their difference alone."""
    study, random = study_in(tmp_path), np.random.default_rng(2)
    rows = [
        {**point, "end_time": 1.0, "torque": 3.0 * point["contact.friction"] + 5.0 * point["scene.seed"]
         + 0.2 * random.standard_normal(), "standard_error": 0.1, "folder": "a"}
        for point in study.points()
    ]  # fmt: skip
    table = pandas.DataFrame(rows)
    table.sample(frac=1.0, random_state=1).to_csv(tmp_path / "study.csv", index=False)
    found = emclutch.sobol_indices(study, tmp_path)
    first, second = (table["torque"][table["scene.seed"] == seed].to_numpy() for seed in (1, 2))
    means = 0.5 * (first + second).reshape(4, 4)[:, [0, 3]]  # of A and B
    assert found["noise"].to_numpy() == pytest.approx(0.25 * (second - first).var(ddof=1) / means.var(), rel=1e-6)
    assert found["total"][0] > 0.3 and abs(found["total"][1]) < 0.2


def test_noise_that_is_all_is_told(tmp_path):
    random = np.random.default_rng(0)
    with pytest.raises(emclutch.OutputError, match=r"the replicas' noise is .* % of the torques' variance"):
        indices_of(["a", "b"], random.standard_normal(32), np.full(32, 2.0))
    study = study_in(tmp_path).model_copy(update={"sample": None})
    with pytest.raises(emclutch.OutputError, match="method = 'saltelli'"):
        emclutch.sobol_indices(study, tmp_path)
