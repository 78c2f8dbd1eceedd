"""The picture of cost against error has a line for each setting that was measured, the frontier below them, targets."""

import dataclasses
import re

import numpy as np
import pytest
from made_up_ladder import contact_step, ladder

from emclutch.results.ladder import Basis, KnobLadder, Rung
from emclutch.results.pictures import accuracy
from emclutch.results.recommended import Obstacle, own_choice, recommended


@pytest.fixture
def drawn(monkeypatch):
    """Figures that were drawn, in place of files."""
    found = []
    monkeypatch.setattr(accuracy, "save_picture", lambda figure, path: found.append(figure) or path)
    return found


def whole(**values):
    step = contact_step(0.05, 0.01)
    step = dataclasses.replace(
        step, rungs=tuple(dataclasses.replace(r, cost=n / 20.0) for r, n in zip(step.rungs, (10, 20, 40), strict=True))
    )
    failing = (Rung(0.01, 0.01, 1.02, 0.0, 1, 0.1, 0.9), Rung(1e-3, 1e-3, 1.0, 0.0, 1, 0.1),
               Rung(1e-4, 1e-4, None, 0.0, 0, 0.1, 1.5, "no convergence"))  # fmt: skip
    moments = KnobLadder("moment_tolerance", "effects.dipoles.tolerance", Basis.MOMENTS, 1e-3, 1.0, 0.0, failing)
    return ladder("abc", step, moments, **({"scatter": 0.02} | values))


def test_the_frontier_lies_below_every_line_and_targets_are_marked(drawn):
    of = whole()
    found = recommended(of, 0.05)
    far = recommended(of, 0.001)
    assert isinstance(far, Obstacle)
    accuracy.accuracy_picture("x.png", of, [(0.05, found), (0.001, far)])
    cost, parts = drawn[0].axes
    seconds, half = next(line for line in cost.lines if line.get_drawstyle() == "steps-post").get_data()
    star = next(line for line in cost.lines if line.get_gid() == "this scene")
    own = own_choice(of, accuracy.PACKINGS)
    assert star.get_xydata()[0] == pytest.approx([own.seconds, 100.0 * own.half_width])
    for line in cost.lines:
        points = line.get_xydata()
        if len(points) in (2, 3) and line.get_marker() not in ("x", "None") and points[0, 0] > 1.0:
            for x, y in points:
                assert half[seconds <= x * (1.0 + 1e-9)].min() <= 1.01 * y  # of knobs without noise some are left out
    words = [text.get_text() for text in cost.texts]
    assert any(one.startswith("5 %: ") for one in words)
    assert any(re.match(r"contact step \d", one) for one in words)  # one label: name and number do not overlap
    assert any("0.1 %: not reached, to lower first" in one for one in words)
    assert sum(line.get_marker() == "x" and len(line.get_xdata()) == 1 for line in cost.lines) == 1
    labels = [label.get_text() for label in parts.get_yticklabels()]
    assert labels[-1] == "total"
    assert set(labels[:-1]) == {"contact step 20", "moment tolerance 0.001", f"{accuracy.PACKINGS} packings"}


def test_what_was_not_measured_is_said(drawn):
    accuracy.accuracy_picture("x.png", whole(unknown={"sector": "about 3 min more"}), [])
    cost, parts = drawn[0].axes
    labels = [label.get_text() for label in parts.get_yticklabels()]
    assert labels[-2:] == ["sector", "total of what was measured"]
    assert [text.get_text() for text in parts.texts] == ["not measured"]
    assert np.isfinite(cost.get_ylim()).all()
