"""The package in Python: what the commands do, with the same errors; a callback sees every window and may stop."""

from __future__ import annotations

import ast
import pickle
import tomllib
from html import unescape
from importlib import import_module
from inspect import unwrap
from pathlib import Path

import numpy as np
import pandas
import pytest
import sheared_annulus

import emclutch
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.report.render import terminal
from emclutch.scene.case import case_from
from emclutch.scene.design import search_of

ROOT = Path(__file__).resolve().parents[2]
QUICKSTART = ROOT / "cases" / "quickstart.toml"
COARSE = {"field.size_factor": 3.0, "field.gap_layers": 3}

CELL = sheared_annulus.CELL | {"time": {"end": "0.2 ms", "window": "20 us"}, "accuracy": {"replicas": 1}}


def run(folder, callback=None, **options):
    return emclutch.run(case_from(CELL), out=folder, callback=callback, **options)


def grains(folder):
    return read_checkpoint(folder / "checkpoint.h5")["dem"]


def test_a_run_that_a_callback_stopped_goes_on_to_the_bits_of_an_undisturbed_one(tmp_path):
    whole = run(tmp_path / "whole")
    seen = []
    stopped = run(tmp_path / "stopped", lambda state: seen.append(state.window) or state.window == 4)
    assert seen == [1, 2, 3, 4] and len(stopped.history) == 4
    assert stopped.stopped.startswith("by the callback at t = ") and whole.stopped is None
    assert not stopped.torque.converged and f"  Stopped {stopped.stopped}." in terminal(stopped.report())
    resumed = run(tmp_path / "stopped", resume=True)
    assert resumed.stopped is None and len(resumed.history) == len(whole.history)
    ends = grains(tmp_path / "whole"), grains(tmp_path / "stopped")
    assert all(
        np.array_equal(ends[0][name], ends[1][name]) for name in ("position_radius", "velocity_force", "particle_id")
    )


def test_a_callback_sees_the_run_as_it_is_written_and_cannot_change_it(tmp_path):
    rows, times, last = [], [], []

    def watch(state):
        rows.append(dict(state.row))
        times.append(state.time)
        last.append(state.windows)
        assert state.position.shape == state.magnetic_moment.shape
        reach = np.hypot(state.position[:, 0], state.position[:, 1])
        assert np.all((reach > 10e-3) & (reach < 11.2e-3)) and np.all(state.radius == 0.15e-3)
        assert sorted(state.particle_id) == list(range(len(state.radius)))
        for array in (state.position, state.velocity, state.angular_velocity, state.magnetic_moment):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0
        with pytest.raises(TypeError):
            state.row["time"] = 0.0

    history = run(tmp_path / "run", watch).history
    assert set(last) == {len(history)}
    assert np.allclose(times, history["time"], rtol=1e-6)
    assert np.allclose([row["torque_disc"] for row in rows], history["torque_disc"], rtol=1e-5)


def test_an_error_of_the_callback_is_its_own(tmp_path):
    with pytest.raises(emclutch.CallbackError, match="ValueError: mine") as failed:
        run(tmp_path / "run", lambda state: int("x") if state.window == 9 else _raise())
    assert isinstance(failed.value.__cause__, ValueError)


def _raise():
    raise ValueError("mine")


def test_check_and_plan_tell_the_same_run():
    case = emclutch.load_case(QUICKSTART, COARSE)
    checked, plan = emclutch.check(case, threads=1), emclutch.plan(case, threads=1)
    assert checked.title == case.scene.scene.title and checked.effects == case.scene.effects.active
    assert f"{plan.windows} windows" in checked.decisions["coupling window"]
    assert checked.decisions["expected torque"] == checked.expected.in_words()
    assert checked.expected.torque > 0.0 and checked.omitted_effects
    table = checked.report().sections[-1].blocks[0]  # every effect, on or off, and what no scene can have
    assert {one.effect.replace("_", " ") for one in checked.omitted_effects} <= {name for name, *_ in table.rows}
    assert {"on", "off", "not in this program", "in every scene"} == {state for _, state, *_ in table.rows}
    assert repr(checked).startswith(f"<Checked: {checked.title}: expected torque 0.") and " N m" in repr(checked)
    assert repr(plan).startswith(f"<Plan: {plan.count} grains, {plan.windows} windows to 7.99 ms, time step ")
    assert str(checked.report()) == terminal(checked.report())  # as print shows it
    assert checked.report().closing.endswith(f"emclutch check {QUICKSTART} --details")
    assert any(one.text.startswith("In continuous operation the winding") for one in checked.report().statements())
    page = unescape(checked._repr_html_())  # a notebook shows what a terminal prints
    assert all(one.text in page for one in checked.report().statements())


def test_field_and_mesh_give_what_they_write(tmp_path):
    case = emclutch.load_case(QUICKSTART, COARSE | {"effects.back_reaction": None})
    found = emclutch.field(case, 0.5, [(20.5e-3, -3e-3, 20.5e-3, 3e-3)], out=tmp_path / "field")
    assert found.table["current"].tolist() == [0.5] and found.units["gap_flux_density"] == "T"
    assert np.allclose(found.table, pandas.read_csv(tmp_path / "field" / "field.csv"), rtol=1e-9)
    assert repr(found).startswith("<FieldResult: Mean flux density in the gap: 0.") and " T at 0.5 A" in repr(found)
    (line,) = found.lines
    assert np.allclose(line["r"], 20.5e-3) and np.hypot(line["B_r"], line["B_z"]).max() > 0.1
    made = emclutch.mesh(case, out=tmp_path / "mesh")
    assert made.file.is_file() and made.picture.is_file() and len(made.mesh.triangles) > 100
    with pytest.raises(emclutch.SceneError, match="does not lie in the mesh"):
        emclutch.field(case, lines=[(1.0, 0.0, 2.0, 0.0)], out=tmp_path / "other")
    with pytest.raises(emclutch.SceneError, match=r"give a list of lines \(r0, z0, r1, z1\)"):
        emclutch.field(case, lines=(0.02, 0.0, 0.02, 0.003), out=tmp_path / "other")
    with pytest.raises(emclutch.SceneError, match=r"geometry\.kind = 'shear_cell' has no field"):
        emclutch.mesh(case_from(CELL), out=tmp_path / "other")


def test_a_study_is_read_back_with_its_runs(tmp_path):
    file = tmp_path / "study.toml"
    case_from(CELL).write_toml(tmp_path / "case.toml")
    file.write_text('[study]\ncase = "case.toml"\n[study.values]\n"motion.rotor.speed" = ["100 rpm", "300 rpm"]\n')
    study = emclutch.load_study(emclutch.sweep(file, out=tmp_path / "study"))
    assert study.table["motion.rotor.speed"].tolist() == ["100 rpm", "300 rpm"] and study.seeds is None
    for point, torque in zip(study.points, study.table["torque"], strict=True):
        assert point.torque.mean == pytest.approx(torque, rel=1e-7)  # a table has eight digits
    with pytest.raises(emclutch.OutputError, match="read_study"):
        emclutch.load_study(file)
    with pytest.raises(emclutch.OutputError, match=r"study\.csv"):
        emclutch.load_study(tmp_path)
    with pytest.raises(emclutch.OutputError, match=r"is a study; read it with emclutch\.load_study"):
        emclutch.load_result(tmp_path / "study")


def test_type_checkers_see_the_names_that_are_loaded_when_asked_for():
    """The imports under TYPE_CHECKING are those of the table, and no module of the package hides a name of its face."""
    tree = ast.parse((ROOT / "emclutch" / "__init__.py").read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    reported = {name.name: node.module for node in block.body for name in node.names}
    table = next(node for node in ast.walk(tree) if isinstance(node, ast.Dict))
    places = {key.value: value.value for key, value in zip(table.keys, table.values, strict=True)}
    assert reported == {name: place.partition(":")[0] for name, place in places.items()}
    modules = {path.stem for path in (ROOT / "emclutch").iterdir() if path.suffix in (".py", "")}
    assert not modules & set(emclutch.__all__)
    for name, place in places.items():
        assert pickle.loads(pickle.dumps(getattr(emclutch, name))) is getattr(emclutch, name)
        assert unwrap(getattr(emclutch, name)) is getattr(import_module(place.partition(":")[0]), name)


def test_every_package_is_listed_and_marked_as_typed():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    tops = ("emclutch", "geometry", "field", "particles", "coupling")
    found = {
        str(path.parent.relative_to(ROOT)).replace("/", ".")
        for top in tops
        for path in (ROOT / top).rglob("__init__.py")
    }
    assert set(settings["packages"]) - set(settings.get("package-dir", {})) == found
    assert "py.typed" in settings["package-data"]["*"]
    assert all((ROOT / top / "py.typed").is_file() for top in tops)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda case: emclutch.load_case(5), "case = 5 is neither the path of a scene file nor the tables"),
        (lambda case: case.with_values("coil.current=1 A"), "values = 'coil.current=1 A' is not a dictionary"),
        (lambda case: emclutch.design(case, vary={"coil.current": 1}), "vary = {coil.current} is not a dotted key"),
        (lambda case: emclutch.design(case, "coil.current", "0.1 A:1 A"), "between = '0.1 A:1 A' is not a pair"),
        (lambda case: emclutch.design(case, "coil.current", (0.1, 1), 0.1, tolerance="x"), "tolerance = 'x' is not"),
        (lambda case: emclutch.field_transient(case, tolerance="1"), "tolerance = '1' is out of range"),
        (lambda case: emclutch.map(case, current="1 A"), "give a range A:B, or set coil.current in the scene"),
        (lambda case: emclutch.field(case, []), "currents = [] is empty"),
        (lambda case: case.with_values({1: 2}), "1 is not a dotted key; write it as in 'coil.current'"),
        (lambda case: case.with_values({"effects.dipole": "off"}), "effects.dipole is not a key of a scene; did you"),
        (lambda case: case.with_values({"coil.curent": None}), "coil.curent is not a key of a scene; did you mean"),
        (lambda case: emclutch.load_case(case.path, {"effects.dipole": None}), "did you mean effects.dipoles?"),
        (lambda case: emclutch.design(case, "coil.current", (0.1, 1), "0.3 N"), "target = '0.3 N' is a force"),
        (lambda case: case.with_values(None), "values = None is not a dictionary"),
        (lambda case: case.with_values({"coil": {"current": 1}}), "remove turns of [coil]; write dotted keys"),
        (lambda case: emclutch.map(case, current=None), "current = None is no value; give a range A:B, or a list"),
        (lambda case: emclutch.map(case, current={}), "current = {} is a dictionary; give a range A:B, or a list"),
        (lambda case: emclutch.map(case, current=[]), "current = [] is empty; give a range A:B, or a list"),
        (lambda case: emclutch.map(case, curent="1 A:2 A"), "curent is no argument of map; did you mean current?"),
        (lambda case: emclutch.map(case, **{"coil.curent": "1 A:2 A"}), "- coil.curent is not a key of a scene"),
        (lambda case: emclutch.field(case, out=5), "out = 5 is not the path of a folder"),
        (lambda case: emclutch.sweep(case), "is not the path of a study file"),
        (lambda case: emclutch.check(case, thread=1), "thread is no argument of check; did you mean threads?"),
        (lambda case: emclutch.run(case, threads="many"), "threads = 'many' is not a whole number from 1"),
        (lambda case: emclutch.run(case, callback=5), "callback = 5 is not a function"),
        (lambda case: emclutch.accuracy(case, budget="5 N"), "budget = '5 N' is a force"),
        (lambda case: emclutch.field(case, "0.4 A, 8 N"), "currents = '8 N' is a force"),
    ],
)
def test_a_wrong_argument_is_named(call, says):
    with pytest.raises(emclutch.SceneError) as refused:
        call(emclutch.load_case(QUICKSTART))
    assert says in str(refused.value) and "--" not in str(refused.value)


def test_effects_are_set_as_on_the_command_line_and_a_scene_may_be_tables():
    tables = tomllib.loads(QUICKSTART.read_text(encoding="utf-8"))
    case = emclutch.load_case(tables, {"effects.back_reaction": "off", "effects.heat": "on", "effects.dipoles": "on"})
    effects, given = case.scene.effects, emclutch.load_case(QUICKSTART).scene.effects
    assert effects.feedback is None and effects.thermal is not None and effects.dipoles == given.dipoles
    assert repr(case) == "Case('Quickstart: a small drum clutch')"
    changed = emclutch.load_case(QUICKSTART).with_values({"coil.current": "0.8 A", "effects.heat": "on"})
    assert changed.with_values({"coil.voltage": None}).data == changed.data  # a key that is not there
    assert search_of(changed, "coil.current", (0.1, 1.0), "0.3 N m").torque == 0.3
    assert repr(changed) == f"Case({str(QUICKSTART)!r}, coil.current = 0.8 A, effects.heat = on)"
