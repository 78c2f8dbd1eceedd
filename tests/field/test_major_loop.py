"""A fit to a major loop gives back the law that made it; of a measured loop it has coercivity and remanence."""

from pathlib import Path

import numpy as np
import pytest
from test_hysteresis_law import along, follow

from field import material
from field.laws.magnetisation_table import TableFault, read_loop
from field.laws.major_loop import MajorLoopLaw, _curve
from field.laws.pinning import Pinning

STEEL = material("steel_1010")
SHEET = Path(__file__).with_name("m330_50a_loop.csv")


def loop_of(pinning, law, B_m, n=400):
    """H, B of the falling and the rising branch."""
    path = along(0.0, B_m, -B_m, B_m, n=n)
    H, _, _ = follow(path, pinning, law)
    return H[n - 1 :, 0], path[n - 1 :, 0]


def test_the_loop_of_the_law_gives_back_the_law():
    """Curve, cells' sum and minor loops within 3 % of the coercivity."""
    pinning = Pinning.of(STEEL, 143.0)
    found = MajorLoopLaw(*loop_of(pinning, STEEL, 1.7), "back")
    assert found.fitted.coercivity == pytest.approx(143.0, rel=2e-3) == found.measured.coercivity
    assert found.fitted.remanence == pytest.approx(found.measured.remanence, rel=5e-3)
    assert found.fitted.loss == pytest.approx(found.measured.loss, rel=1e-2) and found.misfit < 0.02
    path = along(0.0, 1.2, -0.3, 0.6, -0.9)
    exact, loss, _ = follow(path, pinning)
    fitted, of_fit, _ = follow(path, found.pinning, found)
    assert np.abs(fitted - exact).max() < 0.03 * np.abs(exact).max()
    assert of_fit.sum() == pytest.approx(loss.sum(), rel=0.05)


def test_one_branch_is_as_good_as_both():
    H, B = loop_of(Pinning.of(STEEL, 143.0), STEEL, 1.7)
    both, one = MajorLoopLaw(H, B), MajorLoopLaw(H[:401], B[:401])
    assert one.fitted == both.fitted or one.fitted.coercivity == pytest.approx(both.fitted.coercivity, rel=1e-6)


def test_a_measured_loop_has_its_coercivity_and_remanence():
    """Sheet M330-50A: both within 1 %. Its loop is wider at the remanence than at B = 0, which the law cannot be."""
    H, B = read_loop(SHEET)
    found = MajorLoopLaw(H, B, "sheet")
    assert found.measured.coercivity == pytest.approx(38.0, abs=0.5)
    assert found.measured.remanence == pytest.approx(1.155, abs=2e-3)
    assert found.fitted.coercivity == pytest.approx(found.measured.coercivity, rel=0.01)
    assert found.fitted.remanence == pytest.approx(found.measured.remanence, rel=0.01)
    assert 0.65 < found.fitted.loss / found.measured.loss < 0.75
    assert "table 38" in found.in_words()
    # the law itself, step by step, has what the fit says
    path = along(0.0, 1.7, -1.7, n=1700)
    falling = follow(path, found.pinning, found)[0][1699:, 0]
    at = path[1699:, 0]
    assert -np.interp(0.0, at[::-1], falling[::-1]) == pytest.approx(found.fitted.coercivity, rel=0.01)
    assert np.interp(0.0, falling[::-1], at[::-1]) == pytest.approx(found.fitted.remanence, rel=0.01)


@pytest.mark.parametrize("of", ["law", "sheet"])
def test_every_step_is_convex(of):
    """The slope of H_0 is above that of the cells' sum everywhere: Newton's steps stay those of a convex energy."""
    table = read_loop(SHEET) if of == "sheet" else loop_of(Pinning.of(STEEL, 143.0), STEEL, 1.7)
    found = MajorLoopLaw(*table)
    B = np.linspace(0.0, 2.2, 20001)
    slope = found.H_of_B(B)[1]
    of_cells = (found.pinning.stiffness * (B[:, None] < found.pinning.reach)).sum(axis=1)
    assert (slope >= of_cells * (1.0 - 1e-12)).all() and (slope > 0.0).all()
    assert found.energy_density(B[1:]) == pytest.approx(np.cumsum(np.diff(B) * 0.5 * (
        found.H_of_B(B)[0][1:] + found.H_of_B(B)[0][:-1])), rel=1e-3, abs=1e-3)  # fmt: skip


def test_a_curve_that_begins_flat_is_continuous_and_rises():
    """A first slope of a tenth of the next ones: through its nodes from both sides, and no slope below 0 or at 0."""
    nodes, slopes = np.linspace(0.0, 1.5, 4), np.array([10.0, 100.0, 100.0])
    curve = _curve(nodes, slopes, Pinning(np.zeros(0), np.zeros(0)))
    H = np.append(0.0, np.cumsum(slopes * np.diff(nodes)))
    for side in (-1e-9, 0.0):
        assert curve.H_of_B(nodes[1:-1] + side)[0] == pytest.approx(H[1:-1], rel=1e-6)
    assert (curve.H_of_B(np.linspace(0.0, 1.5, 3001))[1] > 0.0).all()
    assert curve.H_of_B(np.zeros(1))[1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda H, B: (H[:4], B[:4]), "has 4 points"),
        (lambda H, B: (H[::-1], B[::-1]), "rising branch|falling branch"),
        (lambda H, B: (np.abs(H), B), "falling branch"),
        (lambda H, B: (H, 0.0 * B), "B goes from 0 to 0 T"),
        (lambda H, B: (H - 300.0, B), "at one above"),
        (lambda H, B: (H[:300], B[:300]), "may differ by a tenth|pass 0"),
    ],
)
def test_what_is_no_loop_is_explained(change, words):
    with pytest.raises(ValueError, match=words):
        MajorLoopLaw(*change(*loop_of(Pinning.of(STEEL, 143.0), STEEL, 1.7)))


def test_a_file_without_header_is_explained(tmp_path):
    path = tmp_path / "loop.csv"
    path.write_text("5, 1\n-5, -1\n")
    with pytest.raises(TableFault, match="no header"):
        read_loop(path)
