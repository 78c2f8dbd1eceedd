"""Every test file is in the index of `make laws`, with its law, and in a folder that `make test` runs."""

import tomllib

from laws import TESTS, law, laws


def test_every_file_says_its_law_in_its_first_line():
    silent = [f"{folder}/{name}" for folder, files in laws().items() for name, said in files.items() if not said]
    assert silent == [], "begin them with a docstring whose first line is the law that they test"


def test_the_index_has_every_test_file():
    """None lies beside the folders, or deeper than they are."""
    files = {f"{folder}/{name}" for folder, names in laws().items() for name in names}
    assert files == {path.relative_to(TESTS).as_posix() for path in TESTS.rglob("test_*.py")}


def test_all_folders_but_the_benchmarks_are_run():
    settings = tomllib.loads((TESTS.parent / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]
    assert {f"tests/{folder}" for folder in laws()} - {"tests/benchmarks"} == set(settings["ini_options"]["testpaths"])


def test_the_law_is_the_first_line_of_the_docstring(tmp_path):
    path = tmp_path / "test_ohm.py"
    path.write_text('"""U = R I.\n\nAt any current.\n"""\n', encoding="utf-8")
    assert law(path) == "U = R I."
    path.write_text("# U = R I\n", encoding="utf-8")
    assert law(path) == ""
