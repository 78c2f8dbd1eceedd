"""A picture of the docs shows the scenes and tables that ship: they have the hash that they had when it was drawn."""

from pathlib import Path

import pictures
import pytest
from pictures import (
    ROOT,
    commands,
    draw,
    gallery,
    outdated,
    output_folder,
    recorded,
    refuse_unknown,
    scene_hash,
    source_hash,
)

TO_BE_MADE = {
    "thesis_methods.png",
}
"""Older than their scenes: a study of nine minutes."""


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


def test_the_comments_of_a_table_do_not_matter_and_its_rows_do(tmp_path):
    table = tmp_path / "table.csv"
    found = []
    for text in ("# one\na,b\n1,2\n", "# two\n# lines\na,b\n1,2\n", "# one\na,b\n1,3\n"):
        table.write_text(text)
        found.append(source_hash(str(table)))
    assert found[0] == found[1] != found[2]


def test_no_folder_is_written_by_two_different_commands():
    """What is complete is not run again, so that the second one would not be run."""
    written = {(output_folder(one), one) for name in recorded() for one in commands(name)}
    folders = [folder for folder, _ in written if folder is not None]
    assert len(folders) > 5 and len(folders) == len(set(folders))


def test_all_reuses_no_run_of_an_earlier_call_and_an_unknown_picture_is_refused(tmp_path, monkeypatch):
    """Two pictures of one run: it is made once a call with `all`, and never again without."""
    sources = "cases/quickstart.toml"
    rows = {
        name: {"sources": sources, "command": f"emclutch run {sources} --out RUN && cp RUN/{name} PICTURE"}
        for name in ("grains.png", "section.png")
    }
    ran = []

    class Done:
        returncode = 0

    def run(command, **_):
        ran.append(command.split()[0])
        if (folder := output_folder(command)) is not None:
            (tmp_path / folder).mkdir(parents=True)
        return Done

    monkeypatch.setattr(pictures, "recorded", lambda: rows)
    monkeypatch.setattr(pictures, "source_hash", lambda sources: "0")
    monkeypatch.setattr(pictures, "record", lambda name: None)
    monkeypatch.setattr(pictures.subprocess, "run", run)
    monkeypatch.setattr(pictures, "ROOT", tmp_path)
    for reuse, times in ((True, 1), (True, 1), (False, 2), (False, 3)):
        assert draw(sorted(rows), reuse) == 0 and ran.count("emclutch") == times
    with pytest.raises(SystemExit, match=r"no picture nothing.png; it has grains.png, section.png; or take: all"):
        refuse_unknown(["nothing.png"])
