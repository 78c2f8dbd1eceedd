"""A scene of kind `cad` with `three_dimensional`: solids of a STEP file, their field, grains in it, and refusals.

The device: a steel disc, the powder around its rim, a rotor and covers of aluminium, a coil.
"""

import json
import math

import numpy as np
import pandas
import pytest
import tomli_w
from step_file import write_step
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.device_model.device import build_device
from emclutch.scene.case import load_case
from emclutch.studies.field_3d import along_line, line_3d
from field import AIR, MU_0, AxisymmetricProblem

MATERIALS = {"disc": "iron", "rotor": "aluminium", "cover": "aluminium"}
SCENE = {
    "scene": {"title": "Solids"},
    "geometry": {
        "kind": "cad",
        "file": "round.step",
        "materials": MATERIALS,
        "three_dimensional": True,
        "air_factor": 2.0,
    },
    "materials": {"iron": {"law": "linear", "relative_permeability": 100.0}},
    "coil": {"current": "1 A", "turns": 500},
    "field": {"source": "coil", "size_factor": 3.0, "gap_layers": 3},
    "particles": {"diameter": "0.5 mm", "count": 60},
    "contact": {"friction": 0.3, "restitution": 0.5},
    "motion": {"rotor": {"speed": "1000 rpm"}, "disc": {"speed": 0.0}},
    "effects": {"magnetic_force": {}, "dipoles": {"model": "mutual"}, "saturation": {}},
    "time": {"end": "0.01 ms"},
    "output": {"snapshots": 2, "pictures": False},
}


def tube(occ, r0, r1, z0, z1):
    outer = (3, occ.addCylinder(0, 0, z0, 0, 0, z1 - z0, r1))
    return outer if r0 == 0 else occ.cut([outer], [(3, occ.addCylinder(0, 0, z0, 0, 0, z1 - z0, r0))])[0][0]


def device(occ, slots=(), coil=(13, 18, -4, 4), rotor_slots=()):
    """Solids [mm]; `slots`: angles [degrees] of the sectors cut out of the disc's rim and filled with resin."""
    disc, rotor = tube(occ, 0, 8, -5, 5), tube(occ, 10.5, 12, -5, 5)
    names = ["disc", "rotor", "powder", "cover", "cover", "coil"]
    solids = [
        disc,
        rotor,
        tube(occ, 8, 10.5, -5, 5),
        tube(occ, 0, 12, 5, 6),
        tube(occ, 0, 12, -6, -5),
        tube(occ, *coil),
    ]
    for body, angles, r0, r1, name in ((0, slots, 5, 8, "resin"), (1, rotor_slots, 10.5, 12, "bar")):
        for angle in angles:
            sector = (3, occ.addCylinder(0, 0, -5, 0, 0, 10, r1, angle=math.radians(60.0)))
            occ.cut([sector], [(3, occ.addCylinder(0, 0, -5, 0, 0, 10, r0))])
            occ.rotate([sector], 0, 0, 0, 0, 0, 1, math.radians(angle - 30.0))
            solids[body] = occ.cut([solids[body]], [sector], removeTool=False)[0][0]
            solids.append(sector)
            names.append(name)
    occ.synchronize()
    order = [tag for _, tag in solids]
    return [names[order.index(tag)] for _, tag in occ.getEntities(3)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solids")
    write_step(folder / "round.step", device)
    write_step(folder / "slotted.step", lambda occ: device(occ, slots=(90, 180, 270)))
    write_step(folder / "both.step", lambda occ: device(occ, slots=(90, 180), rotor_slots=(180,)))
    write_step(folder / "oblique.step", oblique)
    write_step(folder / "empty.step", lambda occ: ["cover" if name == "powder" else name for name in device(occ)])
    return folder


def oblique(occ):
    """The coil is a cone's shell."""
    names = device(occ)
    occ.remove([(3, occ.getEntities(3)[names.index("coil")][1])], recursive=True)
    cone = (3, occ.addCone(0, 0, -4, 0, 0, 8, 20, 18))
    occ.cut([cone], [(3, occ.addCylinder(0, 0, -4, 0, 0, 8, 13))])
    names.remove("coil")
    return [*names, "coil"]


def case_of(folder, name="scene", **sections):
    data = {section: dict(entries) for section, entries in SCENE.items()}
    for section, entries in sections.items():
        data[section] = {**data.get(section, {}), **entries}
    path = folder / f"{name}.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return path


SLOTTED = {"file": "slotted.step", "materials": {**MATERIALS, "resin": "aluminium"}, "bodies": {"resin": "disc"}}


def test_a_body_of_revolution_has_in_space_the_field_of_its_section(folder, tmp_path):
    """The axisymmetric solve is the oracle: linkage from above and below, and B along a line, within a few per cent."""
    solid = build_device(load_case(case_of(folder)).scene)
    section = build_device(
        load_case(case_of(folder, geometry={"three_dimensional": False}, field={"size_factor": 1.0})).scene
    )
    assert solid.fill == section.fill and solid.coil.carrier == "housing"
    assert [wall.name for wall in solid.walls()] == [wall.name for wall in section.walls()]
    ours, theirs = solid.coil.solve_at_peak(None), section.coil.solve_at_peak(None)
    # a scalar potential has too much energy, a vector potential too little
    assert 0.0 < ours.flux_linkage_per_turn / theirs.flux_linkage_per_turn - 1.0 < 0.03
    z = np.linspace(-4e-3, 4e-3, 41)
    expected = theirs.B_along(np.column_stack((np.full_like(z, 9.25e-3), z)))
    sampler = ours.sampler("powder")
    for angle in (0.0, 2.0):
        x, y = math.cos(angle), math.sin(angle)
        line = line_3d((9.25e-3 * x, 9.25e-3 * y, -4e-3, 9.25e-3 * x, 9.25e-3 * y, 4e-3), len(z))
        raw = along_line(ours, line)
        assert set(raw["region"]) == {"powder"}
        H, _ = sampler.sample(line)
        for B, error in ((raw[["B_x", "B_y", "B_z"]].to_numpy(), 0.08), (MU_0 * H, 0.04)):
            found = np.column_stack((B[:, 0] * x + B[:, 1] * y, B[:, 2]))
            assert np.linalg.norm(found - expected) < error * np.linalg.norm(expected)


def test_the_field_command_writes_what_slots_do(folder, tmp_path):
    """Resin in place of iron takes flux from the coil; the field has the device's mirror plane."""
    path = case_of(folder, geometry=SLOTTED)
    lines = "6 mm, 6 mm, -4 mm, 6 mm, 6 mm, 4 mm", "6 mm, -6 mm, -4 mm, 6 mm, -6 mm, 4 mm"
    arguments = ["field", str(path), "--line", lines[0], "--line", lines[1], "--line", "9 mm, 0, 9 mm, 4 mm"]
    result = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "field")])
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "field" / "field.json").read_text())
    assert summary["at_last_current"]["turns_with"] == "disc" and (tmp_path / "field" / "gap.png").is_file()
    section = build_device(load_case(case_of(folder, geometry={"three_dimensional": False})).scene).coil
    smooth = section.solve_at_peak(None).flux_linkage_per_turn
    bare = AxisymmetricProblem(section.mesh, {name: AIR for name in ("disc", "rotor", "cover")}, open_boundary=True)
    empty = bare.solve(500.0).flux_linkage_per_turn
    assert 1.02 * empty < summary["currents"][0]["flux_linkage"] / 500.0 < 0.99 * smooth
    one, other, plane = (pandas.read_csv(tmp_path / "field" / f"line-{number}.csv") for number in (1, 2, 3))
    size = np.linalg.norm(one[["B_x", "B_y", "B_z"]])
    for name, sign in (("B_x", 1.0), ("B_y", -1.0), ("B_z", 1.0)):
        assert np.linalg.norm(one[name] - sign * other[name]) < 0.1 * size
    assert list(plane["y"]) == [0.0] * len(plane) and plane["x"][0] == pytest.approx(9e-3)


def test_grains_run_in_the_field_of_solids_which_turns_with_the_disc(folder, tmp_path):
    case = load_case(case_of(folder, geometry=SLOTTED, field={"order": 1}, motion={"disc": {"speed": "-500 rpm"}}))
    assert {wall.body for wall in case.scene.shape().walls()} == {"disc", "rotor"}
    result = emclutch.run(case, out=tmp_path / "run")
    history = result.history
    assert np.isfinite(history["torque_disc"]).all() and (history["gap_flux_density"] > 1e-3).all()
    assert (history["torque_disc_field"].abs() > 0.0).any() and not history.get("torque_rotor_field", np.zeros(1)).any()


REFUSED = {
    "slots in both bodies": (
        {"geometry": {**SLOTTED, "file": "both.step", "materials": {**SLOTTED["materials"], "bar": "aluminium"}}},
        "several parts are not bodies of revolution: bar (rotor), disc (disc), resin (disc), rotor (rotor)"),
    "no slots in a section": ({"geometry": {**SLOTTED, "three_dimensional": False}},
                              "part 'resin' does not meet the half-plane"),
    "oblique coil": ({"geometry": {"file": "oblique.step"}}, "the coil of a field in 3D is one ring of rectangular"),
    "no powder": ({"geometry": {"file": "empty.step"}}, "no part is named 'powder'"),
    "feedback": ({"effects": {"back_reaction": {}}}, "effects.back_reaction is not available with "
                 "geometry.three_dimensional"),
    "tolerance": ({"field": {"tolerance": 1e-3}}, "field.tolerance = 0.001 refines the mesh of a section"),
    "sector": ({"particles": {"sector": "60 deg"}}, "particles.sector = '60 deg' needs a field that repeats"),
    "axis": ({"geometry": {"axis": "x"}}, "geometry.axis = 'x' is of sections"),
    "a part without a material": ({"geometry": {**SLOTTED, "materials": MATERIALS}}, "means nothing here: 'resin'"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_there_in_space_is_refused_in_words(name, folder):
    changes, words = REFUSED[name]
    result = CliRunner().invoke(app, ["check", str(case_of(folder, "refused", **changes))])
    assert result.exit_code == 2 and words in result.output, result.output


def test_slots_of_air_beside_the_powder_are_refused(folder):
    write_step(folder / "open.step", open_slot)
    result = CliRunner().invoke(app, ["check", str(case_of(folder, "open", geometry={"file": "open.step"}))])
    assert result.exit_code == 2 and "next to the powder is air in the half-plane y = 0, x > 0" in result.output


def open_slot(occ):
    names = device(occ, slots=(0,))
    occ.remove([(3, occ.getEntities(3)[names.index("resin")][1])], recursive=True)
    return [name for name in names if name != "resin"]


def test_images_in_slots_are_reported(folder):
    case = load_case(case_of(folder, geometry=SLOTTED, effects={"wall_images": {}}))
    assert any("mirrors dipoles all around in what is steel in the half-plane" in text for text in case.warnings)
