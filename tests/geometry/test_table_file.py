"""Tables as people write them: the same numbers in every notation, or an error with the line and the remedy."""

import numpy as np
import pytest

from geometry.table_file import FileFault, is_unit_of, read_table

LARGE, SMALL = [999.0, 1000.0, 2500.0, 1234567.0], [0.5, 1.25, 1.5, 100.0]
COLUMNS = {"x": "mm", "y": "mm"}
POINTS = {
    "plain": ["999;0.5", "1000;1.25", "2500;1.5", "1234567;100"],
    "commas divide thousands": ["999;0.5", "1,000;1.25", "2,500;1.50", "1,234,567;100"],
    "points divide thousands": ["999;0,5", "1.000;1,25", "2.500;1,50", "1.234.567;100"],
    "blanks divide thousands": ["999;0,5", "1 000;1,25", "2 500;1,5", "1 234 567;100"],
    "apostrophes divide thousands": ["999;.5", "1'000;1.25", "2'500;1.5", "1'234'567;100"],
    "powers of ten": ["9.99e2;5e-1", "1E3;1.25", "2.5e+3;1.5", "1.234567e6;1e2"],
}


def read(tmp_path, text, **options):
    (tmp_path / "table.txt").write_text(text, encoding="utf-8")
    return read_table(tmp_path / "table.txt", lambda place, name, unit: COLUMNS.get(name), **options)


@pytest.mark.parametrize("separator", [";", "\t", ",", " "])
@pytest.mark.parametrize("way", POINTS)
def test_every_notation_gives_the_same_numbers(tmp_path, way, separator):
    if separator == " " and "blanks" in way:
        pytest.skip("blanks cannot divide columns and thousands")
    rows = [row.split(";") for row in POINTS[way]]
    if separator == ",":
        rows = [[f'"{cell}"' for cell in row] for row in rows]
    lines = ["# made by hand", f"x [mm]{separator}y [mm]", "", *(separator.join(row) for row in rows)]
    table = read(tmp_path, "\n".join(lines) + "\n")
    assert np.allclose(table.values, np.array([LARGE, SMALL]).T, rtol=1e-15, atol=0.0)
    assert table.names == ["x", "y"] and table.lines == [4, 5, 6, 7] and not table.unused


@pytest.mark.parametrize("head", ["x [cm]", "x (cm)", "x / cm", "x in cm", "x_cm", "x cm"])
def test_a_unit_stands_behind_the_name(tmp_path, head):
    assert read(tmp_path, f"{head};y [µm]\n1;1\n").values == pytest.approx(np.array([[10.0, 1e-3]]))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x [mm];y [mm]\n1,000;2\n", "line 2: '1,000' may be 1000 or 1.000; write one of them"),
        ("x [mm];y [mm]\n1,000;2,345\n", "line 2: '1,000' may be 1000 or 1.000"),
        ("x [mm];y [mm]\n0.5;2\n1;0,25\n", "line 3 has '0,25', line 2 '0.5'; write all decimals with a point"),
        ("x [mm];y [mm]\n0.5;2\n1;10,00,000\n", "line 3: y = '10,00,000' is not a number"),
        ("x [mm], y [mm]\n1,5, 2\n", "line 2 has 3 entries for 2 columns; .*';' where decimals have a comma"),
        ("1018 steel, annealed\nx [mm];y [mm]\n1;2\n", "line 1 names no column of a table; put # in front of a title"),
        ("x [mm], y\n1, 2\n", "line 1: the column 'y' has no unit; write the unit of your numbers, e.g. y .m."),
        ("# of a bench\nx [mm], y []\n1, 2\n", "line 2: the column 'y' has no unit"),
        ("x [mm], y [furlong]\n1, 2\n", "'y' is in 'furlong', which is unknown or of another quantity; known: m, cm"),
        ("x [mm], y [Mm]\n1, 2\n", "'y' is in 'Mm', which is unknown or of another quantity; did you mean mm"),
        ("x [mm], y [kg]\n1, 2\n", "'y' is in 'kg', which is unknown or of another quantity"),
        ("x [mm], x [cm]\n1, 2\n", "line 1 names 'x' twice"),
        ("x [mm], y [mm]\n1, inf\n", "line 2: y = 'inf' is not a number"),
        ("x [mm], y [mm]\n1, 1_0\n", "line 2: y = '1_0' is not a number"),
        ("x [mm], y [mm]\n1, 2 mm\n", "line 2: y = '2 mm' is not a number"),
        ("x [mm], y [mm]\n1,\n", "line 2: y = '' is not a number"),
        ("1, 2\n3, 4\n", "line 1 has numbers but no header"),
        ("# one, two\n1, 2\n3, 4\n", "line 2 has numbers but no header; begin with a line such as 'x .mm., y"),
        ("x [mm], y [mm]\n# 1, 2\n", "has no table"),
        ('x [mm], y [mm]\n1, "2\n', "line 2: unexpected end of data; look for a quote"),
    ],
)
def test_what_is_not_understood_is_refused_with_its_line(tmp_path, text, words):
    with pytest.raises(FileFault, match=words):
        read(tmp_path, text)


def test_columns_that_are_not_wanted_are_named(tmp_path):
    table = read(tmp_path, "no; x [mm]; mass [g]; y [mm]\nfirst; 1; ?; 2\n;;;\nsecond; 3; 1,000; 4;;\n")
    assert table.values.tolist() == [[1.0, 2.0], [3.0, 4.0]] and table.unused == [("no", ""), ("mass", "g")]
    with pytest.warns(UserWarning, match=r"table.txt: not used: no, mass"):
        table.warn_of_unused()


def test_gaps_are_read_where_they_are_allowed(tmp_path):
    table = read(tmp_path, "x [mm]; y [mm]\n1;\n2; 3\n", gaps=True)
    np.testing.assert_array_equal(table.values, [[1.0, np.nan], [2.0, 3.0]])
    with pytest.raises(FileFault, match="line 2: x = '' is not a number"):
        read(tmp_path, "x [mm]; y [mm]\n; 1\n", gaps=True)


def test_what_is_no_file_of_text_is_refused(tmp_path):
    for path, words in (
        (tmp_path / "none", "cannot be read .No such file"),
        (tmp_path, "is a device, a pipe or a folder"),
        ("/dev/zero", "is a device, a pipe or a folder"),
    ):
        with pytest.raises(FileFault, match=words):
            read_table(path, lambda place, name, unit: None)
    (tmp_path / "binary").write_bytes(b"\xff\x00\xfeH")
    with pytest.raises(FileFault, match="UTF-8"):
        read_table(tmp_path / "binary", lambda place, name, unit: None)


@pytest.mark.parametrize(
    "head",
    ["x\ty\nmm\tmm", "x\ty\n(mm)\t[mm]", "# by hand\n# x [mm]\ty [mm]", "% x (mm)\ty (mm)", '"x (mm)" \t"y (mm)"',
     "x, mm\ty, mm", "sep=\t\nx [mm]\ty [mm]"],
)  # fmt: skip
def test_names_and_units_stand_where_other_programs_put_them(tmp_path, head):
    """A row of units, the last comment above numbers, quotes followed by a blank, Excel's line of the separator."""
    table = read(tmp_path, head + "\n1.5\t0.5\n2.5\t\n", gaps=True)
    np.testing.assert_array_equal(table.values, [[1.5, 0.5], [2.5, np.nan]])
    assert table.names == ["x", "y"] and table.units == ["mm", "mm"]


def test_unicode_text_of_a_spreadsheet_is_read(tmp_path):
    (tmp_path / "table.txt").write_text("x [mm]\ty [mm]\n1,5\t2\n", encoding="utf-16")
    table = read_table(tmp_path / "table.txt", lambda place, name, unit: COLUMNS.get(name))
    assert table.values.tolist() == [[1.5, 2.0]]


def test_an_empty_column_of_a_spreadsheet_is_no_column(tmp_path):
    table = read(tmp_path, "x [mm],y [mm],\n1.5,0.5,\n2.5,0.25,\n")
    assert table.values.tolist() == [[1.5, 0.5], [2.5, 0.25]] and not table.unused


def test_newton_metres_are_no_nanometres():
    assert is_unit_of("N m", "N m") and not is_unit_of("N m", "m") and not is_unit_of("Nm", "mm")
    assert is_unit_of("OE", "Oe") and not is_unit_of("MA", "mA")
