"""A case: resolving is loading's inverse, values make new cases, derived numbers follow from the scene."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from pydantic import ValidationError

from emclutch.cli.input import assignments
from emclutch.scene.case import case_from, load_case
from emclutch.scene.errors import SceneError
from emclutch.scene.fill import fill_of
from emclutch.scene.flat import settings_beside
from emclutch.scene.model import Scene
from emclutch.scene.study import read_study
from geometry.time_profile import TimeProfile

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
BOX = {
    "scene": {"title": "box"},
    "geometry": {"kind": "box", "size": ["10 mm", "10 mm", "20 mm"]},
    "particles": {"diameter": "1 mm", "count": 100},
    "time": {"end": 1},
}


@pytest.fixture(scope="module")
def good():
    return load_case(GOOD)


def test_resolved_scene_loads_to_the_same(good, tmp_path):
    good.write_toml(tmp_path / "case.toml")
    assert load_case(tmp_path / "case.toml").scene == good.scene
    assert case_from(tomllib.loads(good.toml())).resolved() == good.resolved()
    (tmp_path / "notepad.toml").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "case.toml").read_bytes())
    assert load_case(tmp_path / "notepad.toml").scene == good.scene
    with pytest.raises(FileExistsError):
        good.write_toml(tmp_path / "case.toml")


def test_a_scene_is_frozen(good):
    with pytest.raises(ValidationError):
        good.scene.particles.diameter = 1.0


def test_values_make_a_new_case(good):
    other = good.with_values(
        {
            "coil.current": "0.8 A",
            "effects.gravity": None,
            "effects.wall_images": {},
            "effects.back_reaction.tolerance": 0.1,
        }
    )
    assert other.scene.coil.current == TimeProfile.constant(0.8)
    assert other.scene.effects.active == ("magnetic_force", "dipoles", "saturation", "wall_images", "back_reaction")
    assert good.scene.coil.current == TimeProfile((0.0, 0.02), (0.0, 0.94))
    assert good.scene.effects.gravity is not None


def test_auto_is_the_default(good):
    automatic = good.with_values({"time.step": "auto", "effects.dipoles.update_every": "auto"})
    assert automatic.scene == good.scene


def test_magnetised_scene_without_dipoles_is_warned_of(good):
    (warning,) = good.with_values({"effects.dipoles": None}).warnings
    assert "torque will be near zero" in warning


def test_current_beyond_the_voltage_is_warned_of(good):
    (warning,) = good.with_values({"coil.current": "2 A"}).warnings
    assert "51 V" in warning and "24 V" in warning


DIPOLES_TO_TWO = {"effects.dipoles.model": "mutual", "effects.dipoles.cutoff": 2.0}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (DIPOLES_TO_TWO, ("over 2 diameters", "raise effects.dipoles.cutoff")),
        ({"particles.diameter": "0.45 mm", "particles.sector": "9 deg"}, ("over 2.22 diameters", "smaller grains")),
        ({"effects.dipoles.cutoff": 3.0}, ()),
        (DIPOLES_TO_TWO | {"effects.back_reaction": None}, ()),
    ],
)
def test_a_smear_that_knows_single_grains_is_warned_of(values, words):
    """The quickstart's gap is 1 mm; without back_reaction no moment is spread."""
    quickstart = load_case(Path(__file__).parents[2] / "cases" / "quickstart.toml")
    reported = [text for text in quickstart.with_values(values).warnings if "spreads a grain" in text]
    assert len(reported) == bool(words) and all(word in text for word in words for text in reported)


def test_turns_follow_from_resistance_and_window(good):
    """R = rho l/a with l = N 2 pi r and a = fill A/N, recomputed from the wire."""
    area, radius, rho = 1e-4, 0.06, 1.72e-8
    turns = good.scene.coil.winding_in(area, radius).turns
    wire_section = 0.6 * area / turns
    assert rho * turns * 2 * math.pi * radius / wire_section == pytest.approx(25.5, rel=1e-12)
    given = good.with_values({"coil.resistance": None, "coil.turns": 700}).scene.coil
    assert given.winding_in(area, radius).turns == 700


def test_mass_is_that_of_the_whole_device(good):
    fill = fill_of(good.scene.shape(), good.scene.particles)
    assert fill.mass == pytest.approx(0.02, rel=1e-3)
    assert fill.count * 120 == pytest.approx(0.02 / 7700.0 / (math.pi / 6 * 0.2e-3**3), rel=1e-3)


def test_count_is_that_of_the_simulation():
    fill = fill_of(case_from(BOX).scene.shape(), case_from(BOX).scene.particles)
    assert fill.count == 100
    assert fill.solid_fraction == pytest.approx(100 * math.pi / 6 * 1e-9 / 2e-6)


@pytest.mark.parametrize(("region", "smaller"), [("rim", "faces"), ("faces", "cavity"), ("rim", "cavity")])
def test_regions_differ(good, region, smaller):
    shape, particles = good.scene.shape(), good.scene.particles
    volumes = {name: fill_of(shape, particles.model_copy(update={"region": name})).volume
               for name in ("rim", "faces", "cavity")}  # fmt: skip
    assert volumes[region] < volumes[smaller]
    assert volumes["rim"] + volumes["faces"] == pytest.approx(volumes["cavity"])


def test_drum_has_covers_without_flux(good):
    drum = good.with_values({"geometry.kind": "drum"}).scene
    assert good.scene.shape().cover_magnetic and not drum.shape().cover_magnetic


def mirrors(scene) -> dict[str, bool]:
    """Which walls of a clutch mirror dipoles, by their names without their sides."""
    return {wall.name.removesuffix("_left").removesuffix("_right"): wall.magnetic for wall in scene.shape().walls()}


@pytest.mark.parametrize("case", ["quickstart", "powder_clutch", "lock_up", "switch_on", "slotted_disc"])
def test_steel_of_the_shipped_drums_mirrors_and_the_rest_does_not(case):
    walls = mirrors(load_case(GOOD.parents[3] / "cases" / f"{case}.toml").scene)
    steel = {"disc_face": True, "disc_rim": True, "bore": True}
    assert walls == {**steel, "bore_ring": False, "cover": False, "seal_rim": False}


OWN = {
    "weak": {"law": "linear", "relative_permeability": 1.02},
    "ferrite": {"law": "linear", "relative_permeability": 2000},
    "powder_core": {"law": "froehlich", "susceptibility": 0.5, "saturation": "1 MA/m"},
}


@pytest.mark.parametrize(
    ("region", "material", "walls"),
    [
        ("disc", "aluminium", {"disc_face": False, "disc_rim": False}),
        ("rotor", "aluminium", {"bore": False}),
        ("ring", "steel_1010", {"bore_ring": True}),
        ("cover", "stainless_304", {"cover": False}),
        ("seal", "dc01", {"seal_rim": True}),
        ("disc", "weak", {"disc_face": False, "disc_rim": False}),
        ("rotor", "powder_core", {"bore": False}),
        ("seal", "ferrite", {"seal_rim": True}),
    ],
)
def test_a_wall_mirrors_dipoles_when_its_material_is_magnetic(good, region, material, walls):
    """Also a fit that begins with mu_r = 5 (dc01), and own materials; all other walls stay as they are."""
    changed = good.with_values({f"geometry.materials.{region}": material, "materials": OWN})
    assert mirrors(changed.scene) == {**mirrors(good.scene), **walls}


def test_images_without_a_magnetic_wall_are_reported(good):
    values = {f"geometry.materials.{region}": "aluminium" for region in ("disc", "rotor", "cover")}
    reported = good.with_values({**values, "effects.wall_images": {}}).warnings
    assert any("no wall is of a magnetic material" in line for line in reported)


def test_own_material_from_a_file_is_kept_in_the_resolved_scene(good, tmp_path):
    (tmp_path / "iron.csv").write_text("H [A/m], B [T]\n0, 0\n100, 1\n1000, 1.5\n5000, 1.7\n")
    scene = tmp_path / "scene.toml"
    table = '\n[materials.iron]\nlaw = "table"\nfile = "iron.csv"\n[geometry.materials]\ndisc = "iron"\n'
    scene.write_text(GOOD.read_text() + table)
    resolved = load_case(scene).resolved()
    assert resolved["materials"]["iron"] == {"law": "table", "H": [0, 100, 1000, 5000], "B": [0, 1, 1.5, 1.7]}
    assert case_from(resolved).scene == load_case(scene).scene


def test_study_is_every_combination(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(
        f'[study]\ncase = "{GOOD}"\n[study.values]\n"coil.current" = ["0 A", "1 A"]\n'
        'contact.friction = [0.1, 0.2, 0.3]\n[study.set]\n"time.end" = "1 ms"\n'
    )
    read = read_study(study)
    assert len(read.points()) == 6
    assert read.points()[1] == {"coil.current": "0 A", "contact.friction": 0.2}
    assert all(case.scene.time.end == 1e-3 for _, case in read.cases())


def test_study_tells_the_point_at_fault(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = [0.1, 20]\n')
    with pytest.raises(SceneError, match=r"contact.friction = 20 .*\(at contact.friction = 20\)"):
        read_study(study)


def test_schema_is_json_and_describes_quantities():
    schema = json.loads(json.dumps(Scene.model_json_schema()))
    gap = schema["$defs"]["ClutchGeometry"]["properties"]["gap"]
    assert gap["anyOf"][0]["examples"] == ["1 mm"]
    assert gap["anyOf"][1]["exclusiveMinimum"] == 0.0


def test_reading_the_schema_needs_no_heavy_package():
    """`import emclutch` stays quick: neither pint nor the packages of the physics are imported by it."""
    heavy = ["pint", "gmsh", "numba", "matplotlib", "scipy"]
    code = f"import sys, emclutch; print([name for name in {heavy} if name in sys.modules])"
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert done.stdout.strip() == "[]"


def test_a_resolved_box_loads_again():
    """Its case.toml in a run's folder has the defaults of both shafts written out."""
    import tomllib

    box = {
        "scene": {"title": "box"},
        "geometry": {"kind": "box", "size": [0.01, 0.01, 0.02]},
        "particles": {"diameter": 1e-3, "count": 10},
        "effects": {"gravity": {}},
        "time": {"end": 0.01},
    }
    case = case_from(box)
    assert case_from(tomllib.loads(case.toml())).resolved() == case.resolved()


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"coil.current": "0.5 A", "particles.material": "carbonyl_iron", "field.order": 1},
        {"effects.gravity": {}, "effects.rolling_friction": None, "time.until": None},
        {"effects.dipoles.cutoff": 3.0, "output.pictures": False, "output.formats": ["hdf5"]},
    ],
)
def test_what_was_set_beside_a_file_makes_the_same_scene_again(values):
    """As options --set, which a command prints for the next one."""
    path = Path(__file__).parents[2] / "cases" / "quickstart.toml"
    case = load_case(path, values)
    given = settings_beside(case)
    assert load_case(path, assignments([f"{key}={text}" for key, text in given.items()])).scene == case.scene
    assert (given == {}) == (values == {})
