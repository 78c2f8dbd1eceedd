"""A curve from a text file: every way of writing it gives the same numbers; every fault has its line."""

import numpy as np
import pytest

from field import MU_0, TableLaw, material
from field.laws.magnetisation_table import TableFault, file_law, read_table, table_law
from field.laws.materials import _STEEL_1010, _TEAM_STEEL

H = np.array([0.0, 120.0, 1500.0, 20000.0])
B = np.array([0.0, 0.25, 1.25, 1.875])  # exact in binary, so that 1000 * B / 1000 is too
J = B - MU_0 * H
POINTS = list(zip(H.tolist(), B.tolist(), strict=True))
IN_COMMAS = [f"{h},{b}" for h, b in POINTS]
WRITTEN = {
    "commas": ["H [A/m],B [T]", *IN_COMMAS],
    "the other way round, in other units": ["B [mT], H [kA/m]", *(f"{1e3 * b}, {h / 1e3}" for h, b in POINTS)],
    "semicolons and decimal commas": ["H (A/m);B (T)", *(f"{h};{b}".replace(".", ",") for h, b in POINTS)],
    "tabs": ["H / A/m\tB / T", *(f"{h}\t{b}" for h, b in POINTS)],
    "blanks": ["H [A/m]   B [T]", *(f"  {h}   {b}" for h, b in POINTS)],
    "polarisation": ["H [A/m],J [T]", *(f"{h},{j}" for h, j in zip(H.tolist(), J.tolist(), strict=True))],
    "with remarks": ["# ring core", "", "H [A/m],B [T]", *IN_COMMAS, "# end"],
    "thousands divided by commas": ["H [A/m]\tB [T]", *(f"{h:,}\t{b}" for h, b in POINTS)],
    "thousands divided by points": ["H [A/m];B [T]", *(f"{h:,};{b}".translate({44: ".", 46: ","}) for h, b in POINTS)],
    "decimal commas between blanks": ["H [A/m]  B [T]", *(f"{h} {b}".replace(".", ",") for h, b in POINTS)],
    "quoted": ['"H [A/m]","B [T]"', *(f'"{h}","{b}"' for h, b in POINTS)],
    "byte order mark": ["\ufeffH [A/m],B [T]", *IN_COMMAS],
    "FEMM's points below a line of names": ["B [T]\tH [A/m]", *(f"{b:.18f}\t{h:.18f}" for h, b in POINTS)],
    "a block of FEMM's": [
        "<BlockName> = \"core\"", f"  <BHPoints> = {len(POINTS)}", *(f"      {b:.15f}\t{h:.15f}" for h, b in POINTS),
        "<EndBlock>"
    ],
    "Maxwell 2023, .tab": ['"H (A_per_meter)" \t"B (tesla)"', *(f"{h:.8f}\t{b:.8f}" for h, b in POINTS)],
    "Maxwell, without quotes": ["H (A_per_meter)\tB (tesla)", *(f"{h}\t{b}" for h, b in POINTS)],
    "COMSOL 6": ["% Model: core.mph", "% H (A/m)               B (T)", *(f"{h}   {b}" for h, b in POINTS)],
    "numpy.savetxt": ["# H [A/m], B [T]", *(f"{h:.18e},{b:.18e}" for h, b in POINTS)],
    "a row of units": ["H\tB", "kA/m\tT", *(f"{h / 1e3}\t{b}" for h, b in POINTS)],
    "a row of units in brackets, Excel in German": [
        "sep=;", "H;B;Bemerkung", "[A/m];[mT];", *(f"{h};{1e3 * b};-".replace(".", ",") for h, b in POINTS)
    ],
    "a maker's, kilogauss and kilooersted": ["H (kOe)\tB (kG)", *(f"{h * 4e-6 * np.pi}\t{10 * b}" for h, b in POINTS)],
    "names in words, as catalogues have them": [
        "Magnetizing Force H (Oe),Flux Density B (kG)", *(f"{h * 4e-3 * np.pi},{10 * b}" for h, b in POINTS)
    ],
    "German": ["Feldstärke H [A/m];Induktion B [T]", *(f"{h};{b}".replace(".", ",") for h, b in POINTS)],
    "small letters": ["h [oe], b [kgauss]", *(f"{h * 4e-3 * np.pi},{10 * b}" for h, b in POINTS)],
    "intrinsic induction": ["H [A/m],Bi [T]", *(f"{h},{j}" for h, j in zip(H.tolist(), J.tolist(), strict=True))],
    "4 pi M": ["H [kA/m],4πM [G]", *(f"{h / 1e3},{1e4 * j}" for h, j in zip(H.tolist(), J.tolist(), strict=True))],
    "B - H in gauss": ["H [A/m],B-H [kG]", *(f"{h},{10 * j}" for h, j in zip(H.tolist(), J.tolist(), strict=True))],
    "polarisation as a difference": [
        "H [A/m];B-µ0H [T]", *(f"{h};{j}" for h, j in zip(H.tolist(), J.tolist(), strict=True))
    ],
    "words for units": ["H, Oersted\tB, Gauss", *(f"{h * 4e-3 * np.pi}\t{1e4 * b}" for h, b in POINTS)],
    "from saturation down": ["H [A/m],B [T]", *reversed(IN_COMMAS)],
    "oersted and gauss": ["H [Oe],B [G]", *(f"{h * 4e-3 * np.pi},{1e4 * b}" for h, b in POINTS)],
}


def written(tmp_path, lines):
    path = tmp_path / "curve.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.filterwarnings("ignore:.*not used. Bemerkung")
@pytest.mark.parametrize("way", WRITTEN)
def test_every_way_of_writing_gives_the_same_curve(way, tmp_path):
    read_H, read_B = read_table(written(tmp_path, WRITTEN[way]))
    assert np.allclose(read_H, H, rtol=1e-14) and np.allclose(read_B, B, rtol=1e-14)


def test_a_column_that_is_not_used_is_named(tmp_path):
    lines = ["no,H [A/m],mu_r,B [T]", *(f"{k},{h},?,{b}" for k, (h, b) in enumerate(POINTS))]
    with pytest.warns(UserWarning, match="not used: no, mu_r"):
        assert np.array_equal(read_table(written(tmp_path, lines)), [H, B])


def test_steel_1010_through_a_file_is_steel_1010(tmp_path):
    """With its inflection, and without the origin, which is added."""
    lines = ["H [A/m],B [T]", *(f"{h},{b}" for h, b in _STEEL_1010[1:])]
    law = table_law(written(tmp_path, lines))
    assert law.name == "curve"
    points = np.linspace(0.0, law.B[-1], 501)  # beyond, the library has its J_s
    assert np.array_equal(law.H_of_B(points)[0], material("steel_1010").H_of_B(points)[0])


GOOD = ["0,0", "100,1", "1000,1.5", "5000,1.7"]
FAULTS = {
    "nothing": ([], "has no table"),
    "only remarks": (["# nothing"], "has no table"),
    "no header": (GOOD, "line 1 has numbers but no header"),
    "no unit": (["H,B [T]", *GOOD], "write the unit of your numbers, e.g. H [A/m], H [kA/m], H [Oe]"),
    "unknown unit": (["H [A/m],B [Teslas]", *GOOD], "another quantity; known: T, mT, G"),
    "FEMM's points alone": (["0\t0", "0.5\t100", "1\t900"], "begin with a line such as 'H [A/m], B [T]', or, over"),
    "a loop from above": (["H [A/m],B [T]", "900,1.5", "100,1", "9,0.8", "0,0.5"], "line 5: the curve starts at H = 0"),
    "a row of unknown units": (["H\tB", "A/m\tTe", *GOOD], "line 1: the column 'H' has no unit"),
    "another quantity": (["H [A],B [T]", *GOOD], "'H' is in 'A', which is unknown or"),
    "unknown columns": (["x,y", *GOOD], "has the columns x, y; needed are H and either B or"),
    "no flux": (["H [A/m],M [A/m]", *GOOD], "has the columns H, M; needed are H and either B or"),
    "mega or milli": (["H [mA/m],B [T]", *GOOD], "'H' is in 'mA/m', which is unknown or of another quantity; did"),
    "a difference of more": (["H [A/m],B - H [T]", *GOOD], "has the columns H, B - H; needed are H and either B or"),
    "H in two words": (["H [A/m],Field [A/m],B [T]", "0,0,0"], "has the columns H, Field, B; needed are H and either"),
    "H twice": (["H [A/m],H [kA/m]", *GOOD], "line 1 names 'H' twice"),
    "B and J": (["H [A/m],B [T],J [T]", "0,0,0"], "has the columns H, B, J, so both B and J; remove"),
    "thousands or decimals": (["H [A/m];B [T]", "0;0", "1,000;1", "9,000;2"], "line 3: '1,000' may be 1000 or 1.000"),
    "two decimal marks": (["H [A/m];B [T]", "0;0", "100,5;1", "900;1.5"], "line 3 has '100,5', line 4 '1.5'; write"),
    "no number": (["H [A/m],B [T]", "0,0", "100,x", *GOOD[2:]], "line 3: B = 'x' is not a number"),
    "nan": (["H [A/m],B [T]", "0,0", "100,nan", *GOOD[2:]], "line 3: B = 'nan' is not a number"),
    "decimal comma between commas": (["H [A/m],B [T]", "0,0", "100,1,5"], "line 3 has 3 entries for 2 columns"),
    "short row": (["# x", "H [A/m],B [T]", "0,0", "100"], "line 4 has 1 entries"),
    "too few points": (["H [A/m],B [T]", "0,0", "100,1", "1000,1.5"], "2 points besides the origin"),
    "header alone": (["H [A/m],B [T]"], "has no table"),
    "H goes back": (["H [A/m],B [T]", "0,0", "100,1", "90,1.1", "5000,1.7"], "line 4: not monotone, H goes"),
    "B goes back": (["H [A/m],B [T]", "0,0", "100,1", "", "1000,0.9", "5000,1.7"], "100 to 1000 A/m: correct the"),
    "a loop": (["H [A/m],B [T]", "-100,-1", "0,0.5", "100,1", "900,2"], "line 2: the curve starts at H = -100"),
    "remanence": (["H [A/m],B [T]", "0,0.5", "100,1", "900,1.5", "2000,1.6"], "must start at the origin"),
    "M as B": (["H [A/m],B [T]", "0,0", "100,1", "1000,1.0001", "5000,1.7"], "line 4: dB/dH = 1.11e-07 H/m is"),
    "J that falls": (["H [A/m],J [T]", "0,0", "100,1", "1000,0.9995", "5000,1.7"], "J must not fall"),
    "exchanged": (["B [kG],H [Oe]", *(f"{h},{b}" for h, b in POINTS)], "whether H and B are exchanged"),
    "first slope": (["H [A/m],B [T]", "10000,0.001", "20000,1", "30000,2"], "line 2: dB/dH"),
}  # fmt: skip


@pytest.mark.parametrize(("unit", "warns"), [("Oe", False), ("A/m", True)])
def test_oersted_taken_for_amperes_per_metre_are_doubted(unit, warns, tmp_path):
    points = [(0.5, 2000.0), (2.0, 10000.0), (10.0, 14000.0), (1000.0, 17100.0)]
    law = table_law(written(tmp_path, [f"H [{unit}],B [G]", *(f"{h},{b}" for h, b in points)]))
    assert ("is H in Oe?" in law.warning) == warns


def test_one_negative_row_is_no_loop(tmp_path):
    with pytest.raises(TableFault, match=r"line 2: H = -5 A/m makes the table a hysteresis loop, .* remove the rows"):
        file_law(written(tmp_path, ["H [A/m],B [T]", "-5,-0.1", *GOOD]))


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_has_its_line(name, tmp_path):
    lines, words = FAULTS[name]
    with pytest.raises(TableFault) as fault:
        table_law(written(tmp_path, lines))
    assert words in str(fault.value)


# A soft iron up to saturation, then measured points of which the first rises by 0.9 mu_0 H and the next by more, yet
# not to the polarisation of 2.2 T again: the tail as published tables have it.
UP_TO_SATURATION = [(0.0, 0.0), (100.0, 1.0), (1e3, 1.5), (1e4, 1.9), (1e5, 2.2)]
TAIL = [(2e5, 2.2 + 0.9 * MU_0 * 1e5), (3e5, 2.2 + 1.92 * MU_0 * 1e5)]


def test_a_tail_below_vacuum_is_replaced_by_vacuum_and_reported(tmp_path):
    lines = ["H [A/m],B [T]", *(f"{h!r},{b!r}" for h, b in UP_TO_SATURATION + TAIL)]
    law, without = table_law(written(tmp_path, lines)), TableLaw(*np.array(UP_TO_SATURATION).T)
    points = np.linspace(0.0, 4.0, 401)
    for ours, theirs in zip(law.H_of_B(points), without.H_of_B(points), strict=True):
        assert np.array_equal(ours, theirs)
    beyond = points > 2.2
    assert np.allclose(law.H_of_B(points)[0][beyond], 1e5 + (points[beyond] - 2.2) / MU_0, rtol=1e-12)
    assert law.warning.startswith("the last 2 points of the table, from H = 200000 A/m on")
    assert without.warning == ""


@pytest.mark.parametrize("after", [(4e5, 2.2 + 1.5 * MU_0 * 3e5), (4e5, 2.2)])
def test_a_curve_that_rises_or_falls_after_its_flat_part_is_refused(after, tmp_path):
    """The polarisation goes above what would be its saturation, or B itself falls: wrong, not saturated."""
    lines = ["H [A/m],B [T]", *(f"{h!r},{b!r}" for h, b in [*UP_TO_SATURATION, *TAIL, after])]
    with pytest.raises(TableFault, match=r"line 7: dB/dH|line 9: not monotone"):
        read_table(written(tmp_path, lines))
    with pytest.raises(ValueError, match=r"below mu_0|not monotone"):
        TableLaw(*np.array([*UP_TO_SATURATION, *TAIL, after]).T)


def test_a_published_table_that_stays_above_vacuum_is_used_whole(tmp_path):
    """The last slope of the workshop's steel, from 2.25 T to 2.3 T, is 1.6 mu_0."""
    law = table_law(written(tmp_path, ["B [T],H [A/m]", *(f"{b},{h}" for b, h in _TEAM_STEEL)]))
    assert law.warning == "" and np.array_equal(law.B, _TEAM_STEEL[:, 0])


def test_a_column_of_kilogauss_as_tesla_is_refused_with_its_file(tmp_path):
    lines = ["H [A/m],B [T]", *(f"{h},{10 * b}" for h, b in POINTS)]
    with pytest.raises(TableFault, match=r"curve.csv: has B - mu_0 H = 18.7 T"):
        table_law(written(tmp_path, lines))


def test_what_is_no_text_is_reported(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_bytes(b"\xff\x00\xfeH")
    with pytest.raises(TableFault, match="UTF-8"):
        read_table(path)
    with pytest.raises(TableFault, match=r"cannot be read \(No such file"):
        read_table(tmp_path / "none.csv")
