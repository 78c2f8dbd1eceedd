"""A picture of the docs shows the scenes and tables that ship: they have the hash that they had when it was drawn."""

import re

from pictures import ROOT, commands, gallery, outdated, output_folder, recorded, source_hash


def test_no_picture_is_older_than_what_it_shows():
    rows = recorded()
    assert set(rows) == {path.name for path in (ROOT / "docs").glob("*.png")}
    assert [one for one, scene in gallery().items() if f"cases/{scene}" not in rows[one]["sources"].split()] == []
    assert outdated() == [], "draw them: make pictures"
    written = {one: output_folder(one) for name in rows for one in commands(name) if output_folder(one)}
    assert len(written) == len(set(written.values()))  # what is complete is not run again: one command a folder


def test_the_table_of_the_gallery_has_each_shipped_scene_once():
    rows = re.findall(r"^\| \[`(.+?)`\]", (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8"), re.M)
    cases = ROOT / "cases"
    shipped = [path.relative_to(cases).as_posix() for path in (*cases.glob("*.toml"), *cases.glob("thesis/*.toml"))]
    assert sorted(rows) == sorted(shipped)


def test_the_hash_changes_with_values_and_not_with_comments(tmp_path):
    """Of a table, and of a study with the scene that it varies."""
    study, table = tmp_path / "study.toml", tmp_path / "table.csv"
    study.write_text('[study]\ncase = "scene.toml"\n')
    found = []
    for remark, value in (("one", 1), ("two", 1), ("one", 2)):
        (tmp_path / "scene.toml").write_text(f"# {remark}\ngap = {value}\n")
        table.write_text(f"# {remark}\na,b\n1,{value}\n")
        found.append((source_hash(str(study)), source_hash(str(table))))
    assert found[0] == found[1] and found[0][0] != found[2][0] and found[0][1] != found[2][1]
