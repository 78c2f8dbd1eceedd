"""Whatever a scene says, the program answers as it promises: 50 random scenes here, 1 000 in `make stability`."""

from __future__ import annotations

from collections import Counter

import pytest
from random_faults import drawn
from scene_verdict import judge


@pytest.mark.filterwarnings("ignore:Glyph")  # of a title in letters that matplotlib's font lacks
def test_promises_are_kept_whatever_a_scene_says(tmp_path):
    became: Counter[str] = Counter()
    for number, scene in enumerate(drawn(50, 1)):
        folder = tmp_path / str(number)
        folder.mkdir()
        verdict = judge(scene, folder)
        assert not verdict.broken, f"{verdict.broken}\n{scene.breaks}\n{scene.data}"
        became[verdict.outcome] += 1
    assert became["ran"] >= 5 and became["refused"] >= 10  # scenes of all kinds
