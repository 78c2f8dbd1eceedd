"""Every scene of cases/hard in its short form: the invariants hold, and each is seen to fail where it is broken."""

import pytest
from hard_scene import FOLDER, hard_scenes
from invariants import INVARIANTS, margins
from spoiled_run import WAYS, spoiled

pytestmark = pytest.mark.hard

SCENES = hard_scenes()


@pytest.mark.parametrize("scene", [scene for scene in SCENES if scene.stops is None], ids=lambda scene: scene.name)
def test_invariants_hold_and_can_be_broken(scene, tmp_path):
    run = scene.run(tmp_path / "run", scene.short)
    found = scene.margins(run)
    assert all(margin < 1.0 for margin in found.values()), found
    for name, bound in scene.bounds.items():
        assert not margins(spoiled(run, name), {name: bound})[name] < 1.0, name


@pytest.mark.parametrize("scene", [scene for scene in SCENES if scene.stops is not None], ids=lambda scene: scene.name)
def test_what_cannot_be_computed_is_explained(scene, tmp_path):
    words = scene.explanation(tmp_path / "run", scene.short)
    assert scene.is_explained(words), words


def test_every_scene_has_invariants_and_every_invariant_a_scene():
    files = {path.stem for path in FOLDER.glob("*.toml")} - {"invariants"}
    assert files == {scene.name for scene in SCENES} and len(files) >= 40
    assert set(WAYS) == set(INVARIANTS) == {name for scene in SCENES for name in scene.bounds}


def test_headers_say_why_and_what_to_expect():
    for scene in SCENES:
        header = (FOLDER / f"{scene.name}.toml").read_text(encoding="utf-8").split("\n[")[0]
        why = header.split("# Run:")[0]
        assert len(why) > 80 and all(word in header for word in ("# Expect:", "# Takes:")), scene.name
