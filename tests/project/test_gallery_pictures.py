"""A picture of the gallery shows the scene that ships: the scene has the hash that it had when the picture was made."""

from pathlib import Path

from pictures import ROOT, gallery, outdated, scene_hash

TO_BE_MADE = {"thesis_torque.png", "thesis_electromagnetic_overload.png"}
"""Older than their scenes: studies of an hour and more."""


def test_no_picture_is_older_than_its_scene_but_those_that_are_named():
    assert all((ROOT / "docs" / picture).is_file() for picture in gallery())
    assert set(outdated()) == TO_BE_MADE, "make it again, then: python tests/project/pictures.py PICTURE"


def test_a_changed_value_is_found_and_a_changed_comment_is_not():
    text = (Path(ROOT) / "cases" / "quickstart.toml").read_text(encoding="utf-8")
    assert scene_hash("# a remark\n" + text) == scene_hash(text)
    assert scene_hash(text.replace('gap = "1 mm"', 'gap = "1.1 mm"')) != scene_hash(text)
