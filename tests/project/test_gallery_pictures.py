"""A picture of the docs shows the scenes and tables that ship: they have the hash that they had when it was drawn."""

from pathlib import Path

from pictures import ROOT, gallery, outdated, recorded, scene_hash, source_hash

TO_BE_MADE = {
    "friction_from_repose.png",
    "thesis_methods.png",
    "thesis_electromagnetic.png",
    "thesis_electromagnetic_overload.png",
}
"""Older than their scenes: two studies of nine minutes, and a run whose header has the numbers of the old scene."""


def test_every_picture_has_a_row_and_that_of_a_scene_of_the_gallery_names_it():
    rows = recorded()
    assert set(rows) == {path.name for path in (ROOT / "docs").glob("*.png")}
    assert [] == [one for one, scene in gallery().items() if f"cases/{scene}" not in rows[one]["sources"].split()]
    assert [] == [one for one, row in rows.items() if "PICTURE" not in row["command"]]


def test_no_picture_is_older_than_what_it_shows_but_those_that_are_named():
    assert set(outdated()) == TO_BE_MADE, "draw it: make pictures"


def test_a_changed_value_is_found_and_a_changed_comment_is_not():
    text = (Path(ROOT) / "cases" / "quickstart.toml").read_text(encoding="utf-8")
    assert scene_hash("# a remark\n" + text) == scene_hash(text)
    assert scene_hash(text.replace('gap = "1 mm"', 'gap = "1.1 mm"')) != scene_hash(text)


def test_a_study_has_the_hash_of_the_scene_that_it_varies_too(tmp_path):
    (tmp_path / "study.toml").write_text('[study]\ncase = "scene.toml"\n')
    found = []
    for gap in ("1 mm", "2 mm", "1 mm"):
        (tmp_path / "scene.toml").write_text(f'gap = "{gap}"\n')
        found.append(source_hash(str(tmp_path / "study.toml")))
    assert found[0] == found[2] != found[1]
