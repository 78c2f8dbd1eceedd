"""Whatever a scene says, the program answers as it promises: 50 random scenes here, 1 000 in `make stability`.

Which scenes a seed draws differs from one version of hypothesis, or of the project, to the next: hypothesis mixes in
constants that it finds in the sources. So scenes are drawn until some of each kind were among them.
"""

from __future__ import annotations

from collections import Counter

import pandas
import pytest
from random_faults import drawn
from random_scenes import RandomScene, beside
from scene_verdict import judge


@pytest.mark.filterwarnings("ignore:Glyph")  # of a title in letters that matplotlib's font lacks
def test_promises_are_kept_whatever_a_scene_says(tmp_path):
    became: Counter[str] = Counter()
    for number, scene in enumerate(drawn(500, 1)):
        if number >= 50 and became["ran"] >= 5 and became["refused"] >= 10:
            break
        folder = tmp_path / str(number)
        folder.mkdir()
        verdict = judge(scene, folder)
        assert not verdict.broken, f"{verdict.broken}\n{scene.breaks}\n{scene.data}"
        became[verdict.outcome] += 1
    else:
        pytest.fail(f"of 500 scenes hardly any ran, or was refused: {became}")


ONE_SHAFT = {
    "scene": {"title": "one shaft"},
    "geometry": {"kind": "box", "size": [0.01, 0.01, 0.005]},
    "particles": {"diameter": "1.4 mm", "count": 5},
    "surfaces": {"tile": {"file": "tile.stl", "scale": 1e-3, "body": "rotor"}},
    "effects": {"gravity": {}},
    "time": {"end": "0.2 ms"},
    "output": {"formats": []},
}


def test_a_free_shaft_without_the_other_one_has_no_lock_up(tmp_path):
    """Walls of a box from a file on the rotor alone: there is no disc whose speed it could reach."""
    free = {"rotor": {"free": {"inertia": 1e-5, "initial_speed": "10 rpm"}}}
    verdict = judge(RandomScene(ONE_SHAFT | {"motion": free}, beside()), tmp_path)
    assert (verdict.outcome, verdict.broken) == ("ran", "")


def test_a_study_of_scenes_without_a_disc_has_no_torque(tmp_path):
    study = {"study": {"case": "scene.toml", "values": {"motion.rotor.speed": ["10 rpm", "20 rpm"]}}}
    verdict = judge(RandomScene(ONE_SHAFT | {"motion": {"rotor": {"speed": 1.0}}}, beside(), study), tmp_path)
    assert (verdict.outcome, verdict.broken) == ("ran", "")
    table = pandas.read_csv(tmp_path / "study" / "study.csv")
    assert table["torque"].isna().all() and set(table["reason"]) == {"the scene has no disc"}
