"""Pages print the numbers of the table of record, and no others."""

import re

import numpy as np
import pytest
from measured import ROOT, TABLE, disagreement, in_header, pages, statements, table
from scipy.optimize import least_squares
from scipy.stats import t as t_distribution

from emclutch.device_model.grain_size import COEFFICIENT, EXPONENT


def test_pages_say_what_was_measured():
    """Every number with a marker is that of its row, rounded; every row is used, and says where it is from."""
    rows, texts = table(), {path.name: path.read_text(encoding="utf-8") for path in pages()}
    said = [one for name, text in texts.items() for one in statements(text, name)]
    assert sum(text.count("<!-- measured:") for text in texts.values()) == len(said)
    said += [one for row in rows.values() if (one := in_header(row)) is not None]
    assert [text for one in said if (text := disagreement(one, rows[one.name]))] == []
    assert {one.name for one in said} == set(rows) and len(said) > 20
    for name, row in rows.items():
        assert all(row[key] for key in ("value", "quantity", "command", "date", "commit")), name
        assert not row["low"] or float(row["low"]) <= float(row["value"]) <= float(row["high"]), name
    row = {"value": "17.80", "low": "17.61", "high": "17.99"}
    for text, right in (("17.8 +- 0.2", True), ("17.9 +- 0.2", False), ("17.8 +- 0.3", False), ("17.75", False)):
        (one,) = statements(f"{text}<!-- measured: a.b -->", "page")
        assert (disagreement(one, row) == "") == right, text


def test_no_reader_sees_a_marker():
    """Markers stand in comments of Markdown, which are not shown, and in no scene, whose header the gallery prints."""
    shown = {path: re.sub(r"<!--.*?-->", "", path.read_text(encoding="utf-8"), flags=re.S) for path in pages()}
    shown |= {path: path.read_text(encoding="utf-8") for path in (ROOT / "cases").rglob("*.toml")}
    assert [path.name for path, text in shown.items() if re.search(r"\(measured: [\w.]+\)|<!-- measured", text)] == []


def test_coefficient_of_the_grain_size_follows_from_the_torques_that_the_page_prints():
    """One a for both devices by least squares, each torque by its error and 1.5 % of scatter about the law."""
    row = table()["grain_size.coefficient"]
    assert tuple(float(row[column]) for column in ("value", "low", "high")) == COEFFICIENT and EXPONENT == 2.0

    page = (TABLE.parent / "explanation" / "brake.md").read_text(encoding="utf-8").partition("## Grains per gap")[2]
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
