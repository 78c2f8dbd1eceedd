"""Every test file is in the index of `make laws`, with its law, and in a folder that `make test` runs."""

import tomllib

from laws import TESTS, laws


def test_every_test_file_has_a_law_and_is_run():
    index = laws()
    files = {f"tests/{folder}/{name}": law for folder, names in index.items() for name, law in names.items()}
    assert [name for name, law in files.items() if not law] == []
    assert set(files) == {path.relative_to(TESTS.parent).as_posix() for path in TESTS.rglob("test_*.py")}
    settings = tomllib.loads((TESTS.parent / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]
    assert {f"tests/{folder}" for folder in index} - {"tests/benchmarks"} == set(settings["ini_options"]["testpaths"])
