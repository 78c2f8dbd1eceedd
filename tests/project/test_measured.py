"""Pages print the numbers of the table of record, and no others."""

import re

import numpy as np
import pytest
from measured import COLUMNS, TABLE, disagreement, pages, row_of_run, statements, table, write_row
from scipy.optimize import least_squares
from scipy.stats import t as t_distribution
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


def test_coefficient_of_the_grain_size_follows_from_the_torques_that_the_page_prints():
    """One a for both devices by least squares, each torque by its error and 1.5 % of scatter about the law."""
    row = table()["grain_size.coefficient"]
    assert tuple(float(row[column]) for column in ("value", "low", "high")) == COEFFICIENT and EXPONENT == 2.0

    page = (TABLE.parent / "explanation" / "brake.md").read_text(encoding="utf-8").partition("## Grains across")[2]
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line[:3] != "|--"]
    torque = re.compile(r"(\d+\.\d+)(?:<!-- .*? -->)? ± (\d+\.\d+)")
    points = [(float(cells[0]), device, *map(float, found.groups()))
              for cells in lines if len(cells) == 6 for device in (0, 1)
              if (found := torque.fullmatch(cells[3 + 2 * device]))]  # fmt: skip
    across, device, value, half = np.array(points).T
    assert len(points) == 10
    relative = np.hypot(half / 1.96 / value, 0.015)

    def misfit(unknowns):
        a, *limits = unknowns
        return (np.log(value / np.take(limits, device.astype(int))) - np.log1p(a / across**2)) / relative

    found = least_squares(misfit, [1.0, 12.0, 0.6])
    freedom = len(points) - 3
    error = np.sqrt(np.linalg.inv(found.jac.T @ found.jac)[0, 0] * max(1.0, 2.0 * found.cost / freedom))
    half_width = t_distribution.ppf(0.975, freedom) * error
    assert COEFFICIENT == pytest.approx((found.x[0], found.x[0] - half_width, found.x[0] + half_width), abs=0.05)


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
