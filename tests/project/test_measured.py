"""Pages print the numbers of the table of record, and no others."""

import re

from measured import COLUMNS, TABLE, disagreement, pages, row_of_run, statements, table, write_row
from written_run import written_run

from emclutch.device_model.grain_size import COEFFICIENT, EXPONENT

PAGES = [(path.name, path.read_text(encoding="utf-8")) for path in pages()]


def test_pages_say_what_was_measured():
    rows = table()
    said = [one for name, text in PAGES for one in statements(text, name)]
    assert len(said) > 20
    assert [text for one in said if (text := disagreement(one, rows[one.name]))] == []
    assert {one.name for one in said} == set(rows)  # no row is idle
    markers = sum(len(re.findall(r"(?:<!-- |\()measured:", text)) for _, text in PAGES)
    assert markers == len(said)  # every marker follows a number


def test_another_number_is_found():
    rows = {"a.b": {"value": "17.80", "low": "17.61", "high": "17.99"}}
    for text, wrong in (
        ("17.8 +- 0.2<!-- measured: a.b -->", False),
        ("17.9 +- 0.2<!-- measured: a.b -->", True),
        ("17.8 +- 0.3 (measured: a.b)", True),
        ("# has 18\n#         (measured: a.b)", False),
        ("17.80 N m (measured: a.b)", False),
        ("17.75<!-- measured: a.b -->", True),
    ):
        (said,) = statements(text, "page")
        assert bool(disagreement(said, rows["a.b"])) == wrong, text


def test_every_row_says_where_it_is_from():
    for name, row in table().items():
        assert tuple(row) == COLUMNS and all(row[key] for key in ("value", "quantity", "command", "date", "commit")), (
            name
        )
        assert re.fullmatch(r"2\d{3}-\d\d-\d\d", row["date"]) and re.fullmatch(r"[0-9a-f]{7}", row["commit"]), name
        if row["low"]:
            assert float(row["low"]) <= float(row["value"]) <= float(row["high"]), name


def test_what_results_say_of_the_grain_size_is_the_tables():
    row = table()["grain_size.coefficient"]
    assert tuple(float(row[column]) for column in ("value", "low", "high")) == COEFFICIENT and EXPONENT == 2.0


def test_a_row_is_written_from_a_run(tmp_path):
    folder = written_run(tmp_path / "run")
    row = row_of_run(folder.path, "new.torque", "torque of a toy")
    assert 1.9 < float(row["low"]) < float(row["value"]) < float(row["high"]) < 2.1 and row["unit"] == "N m"
    copy = tmp_path / "measured.csv"
    copy.write_bytes(TABLE.read_bytes())
    write_row(row, copy)
    write_row({**row, "value": "2.5"}, copy)
    assert len(table(copy)) == len(table()) + 1 and table(copy)["new.torque"]["value"] == "2.5"
    assert {name: row for name, row in table(copy).items() if name != "new.torque"} == table()
