"""`emclutch new`: scenes of every kind, right as they are, with every key of their sections."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.cli.new import STARTERS, new_scene, starter_kinds
from emclutch.device_model.device import build_device
from emclutch.devices import GEOMETRIES
from emclutch.scene.errors import SceneError
from emclutch.scene.schema_walk import is_table
from geometry.annular_cell import ShearCell
from geometry.clutch import Clutch
from geometry.dimensioned_views import cell_views, clutch_views
from geometry.fault import millimetres
from geometry.slots import Slots

KEY = re.compile(r"^(?:# )?(\w+) = ", re.MULTILINE)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("new")
    return {kind: new_scene(folder / f"{kind}.toml", kind)[0] for kind in starter_kinds()}


def test_there_is_one_of_every_kind_of_device():
    assert set(starter_kinds()) >= {one.name() for one in GEOMETRIES}


@pytest.mark.parametrize("kind", starter_kinds())
def test_it_is_right_and_its_comments_are_what_is_so_without_them(kind, written):
    """Every key that stands in a comment with its default changes nothing where the comment is taken away."""
    case = emclutch.load_case(written[kind])
    assert not case.warnings
    given, is_default = [], False
    for line in written[kind].read_text(encoding="utf-8").splitlines():
        is_default = is_default or line.endswith("(default)")
        given.append(line.removeprefix("# ") if is_default and KEY.match(line) else line)
        is_default = is_default and not KEY.match(line)
    beside = written[kind].with_name(f"{kind}-with-defaults.toml")
    beside.write_text("\n".join(given), encoding="utf-8")
    assert len(tomllib.loads("\n".join(given))["scene"]) == 3
    assert emclutch.load_case(beside).scene == case.scene


@pytest.mark.parametrize("kind", starter_kinds())
def test_every_key_of_its_sections_stands_in_it(kind, written):
    parts = dict(re.findall(r"^\[([\w.]+)\]\n(.*?)(?=^\[|\Z)", written[kind].read_text(), re.MULTILINE | re.DOTALL))
    scene = emclutch.load_case(written[kind]).scene
    for path, text in parts.items():
        model = scene
        for step in path.split("."):
            model = getattr(model, step)
        wanted = {name for name, field in type(model).model_fields.items() if not is_table(field)}
        assert wanted <= set(KEY.findall(text)), path
    required = {name for name, field in type(scene).model_fields.items() if field.is_required()}
    assert required <= {path.partition(".")[0] for path in parts}


@pytest.mark.parametrize(
    ("word", "kind", "title"),
    [("disc", "clutch", "clutch"), ("Disk", "clutch", "clutch"), ("brake", "clutch", "brake"), ("Drum", "drum", "")],
)  # fmt: skip
def test_the_words_for_a_shape_write_its_kind(word, kind, title, tmp_path):
    scene = emclutch.load_case(new_scene(tmp_path / "mine.toml", word)[0]).scene
    assert scene.geometry.kind == kind and title in scene.scene.title and scene.motion.disc.speed(0.0) == 0.0


@pytest.mark.parametrize("kind", ["cad", "clutch", "drum", "shear_cell"])
def test_sectors_are_in_diameters_and_no_inertia_is_scaled_unasked(kind, written):
    data = tomllib.loads(written[kind].read_text(encoding="utf-8"))
    assert data["particles"]["sector"].endswith(" diameters") and "accuracy" not in data
    assert data["contact"] == {}  # its keys are listed


DRAWN = [STARTERS / f"{one}.toml" for one in starter_kinds() if one not in ("cad", "field")]
CASES = Path(__file__).parents[2] / "cases"


@pytest.mark.parametrize("case", [*DRAWN, CASES / "slotted_disc.toml", CASES / "thesis" / "centrifugal_held.toml"],
                         ids=lambda case: case.stem)  # fmt: skip
def test_a_drawing_has_each_dimension_with_its_value_and_no_text_lies_on_another(case, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    drawn, picture = [], tmp_path / "drawn.png"
    monkeypatch.setattr(Figure, "savefig", lambda figure, file, **_: drawn.append(figure) or file.write(b"drawn"))
    given = ["--kind", case.stem] if case in DRAWN else [str(case)]
    answer = CliRunner().invoke(app, ["new", *given, "--drawing", str(picture)])
    assert answer.exit_code == 0 and picture.read_bytes() == b"drawn" and list(tmp_path.iterdir()) == [picture]
    (figure,) = drawn
    figure.canvas.draw()
    texts = [text for panel in figure.axes for text in panel.texts if text.get_text()]
    boxes = [text.get_window_extent() for text in texts]
    for number, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:number]), texts[number]
        assert figure.bbox.padded(1.0).containsx(box.x0) and figure.bbox.padded(1.0).containsx(box.x1)
    words = " ".join([text.get_text() for text in texts] + [panel.get_title(loc="left") for panel in figure.axes])
    sizes = emclutch.load_case(case).scene.geometry
    others = {"kind", "materials", "air_factor", "walls", "inertial_number", "shear_rate", "solid_fraction", "pressure"}
    for name in set(type(sizes).model_fields) - others:
        value = getattr(sizes, name)
        told = f"{name} = {millimetres(value) if isinstance(value, float) else value}"
        if name in ("disc_slots", "rotor_slots"):
            assert (name in words) == (value is not None)
        elif name == "size":
            assert all(f"size[{k}] = {millimetres(length)}" in words for k, length in enumerate(value))
        elif value:
            written = words.replace("=\n", "= ")
            assert told in written, name
            assert (f"{told} (default)" in written) == (name not in sizes.model_fields_set), name
    assert case.stem != "clutch" or "pole_chamfer =\n0 mm (default)" in words


def test_a_dimension_is_as_long_as_its_key_says():
    """Of shapes without thin parts, which would be drawn thicker; a radius by default is that of what it bounds."""
    length = 0.02
    names = ("gap", "face_gap", "rotor_wall", "ring_width", "cover_thickness", "clearance", "yoke", "coil_height")
    clutch = Clutch(disc_radius=0.1, disc_thickness=0.05, seal_radius=0.05, shaft_radius=0.02, coil_width=0.04,
                    **dict.fromkeys(names, length))  # fmt: skip
    sizes = {"coil_radius": clutch.housing_bore, "housing_width": clutch.rotor_length}
    clutch = replace(clutch, disc_slots=Slots(20, 0.4, 0.01))
    (section, slots), cell = clutch_views(clutch), ShearCell(0.01, 0.02, 0.03)
    for shape, view in ((clutch, section), (cell, *cell_views(cell))):
        for one in view.dimensions:
            span = abs(one.end[0] - one.start[0]) if one.along_x else abs(one.end[1] - one.start[1])
            assert span == pytest.approx(sizes.get(one.key) or getattr(shape, one.key)) == one.value, one.key
    assert [(one.key, one.value) for one in slots.dimensions] == [("depth", 0.01)]


@pytest.mark.parametrize(
    ("words", "says"),
    [([], "FILE is missing; name the new scene"), (["--kind", "cad", "--drawing", "a.png"], "its dimensions in a file"),
     (["--drawing", "a.jpg"], "must end in .png")],
)  # fmt: skip
def test_what_cannot_be_drawn_is_told(words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answer = CliRunner().invoke(app, ["new", *words])
    assert answer.exit_code == 2 and says in answer.stderr and not list(tmp_path.iterdir())


def test_a_clutch_from_cad_brings_its_drawing(written):
    device = build_device(emclutch.load_case(written["cad"]).scene)
    assert written["cad"].with_suffix(".step").is_file() and device.coil is not None and device.fill.count > 100


def test_nothing_is_overwritten_and_kinds_are_reported(tmp_path):
    file = tmp_path / "mine.toml"
    (tmp_path / "mine.step").write_text("mine")
    with pytest.raises(SceneError, match=r"mine\.step exists"):
        new_scene(file, "cad")
    assert not file.exists() and (tmp_path / "mine.step").read_text() == "mine"
    answer = CliRunner().invoke(app, ["new", str(file), "--kind", "durm"])
    assert answer.exit_code == 2 and "did you mean 'drum'?" in answer.stderr and not file.exists()
    assert CliRunner().invoke(app, ["new", str(file), "--kind", "box"]).exit_code == 0
    assert CliRunner().invoke(app, ["check", str(file)]).exit_code == 0


def test_a_device_from_cad_without_materials_is_reported(written):
    with pytest.raises(SceneError, match=r"geometry\.materials is missing"):
        emclutch.load_case(written["cad"], {"geometry.materials": None})


@pytest.mark.parametrize("kind", ["drum", "clutch"])
def test_examples_of_times_and_sizes_fit_the_device_that_they_stand_in(kind, written):
    """Taken out of its comment, each is right beside the others; a window is far shorter than the run."""
    text = written[kind].read_text(encoding="utf-8")
    keys = ("window", "step", "housing_width", "coil_radius", "settle_longest")
    for key in keys:
        text, count = re.subn(rf"^# ({key} = )", r"\1", text, count=1, flags=re.MULTILINE)
        assert count == 1, key
    beside = written[kind].with_name(f"{kind}-with-examples.toml")
    beside.write_text(text, encoding="utf-8")
    case = emclutch.load_case(beside)
    assert 100.0 < case.scene.time.window / case.scene.time.step < 1000.0
    assert case.scene.time.window < 1e-2 * 16e-3  # end of the drum; the clutch's, by its strain, is later
