"""`make stability`: the time that it announces follows the machine; its closing table hides no failure."""

from dataclasses import replace

import all_parts
import pandas
import pytest
from all_parts import HERE, PARTS, Part, announcement, main
from hard_scene import HardScene, kind_of_step
from killed_run import table_of
from stability import rows_of
from threads import scene_of, shipped

from emclutch.results.errors import RunError

TABLES = {
    "stability.csv": {"case": ["a", "b"], "steps": ["10", "32"], "invariant": ["speed", "losses"],
                      "margin": [0.5, 0.25]},
    "kills.csv": {"kills": [3, 4], "compared": [100, 200], "differ": [0, 0]},
    "threads.csv": {"compared": ["2 passive, 4 active"], "parts": [100], "differ": [0]},
    "random.csv": {"outcome": ["ran", "refused"], "scenes": [30, 20], "broken": [0, 0]},
    "take_away.csv": {"name": ["gravity", "coil"], "list": ["effects", "sources"], "broken": [0, 0]},
    "long_tests.csv": {"test": ["a.py::one", "b.py::two"], "failed": [0, 0]},
}  # fmt: skip
WRONG = {"stability.csv": ("margin", float("nan")), "kills.csv": ("differ", 1), "threads.csv": ("differ", 2),
         "random.csv": ("broken", 1), "take_away.csv": ("broken", 1),
         "long_tests.csv": ("failed", 1)}  # fmt: skip


def test_a_machine_twice_as_slow_is_announced_twice_the_time():
    parts = [Part("it", "it.py", "it.csv", 600.0, PARTS[0].count)]
    assert announcement(parts, 1.0).startswith("about 10 min of processor time")
    assert announcement(parts, 2.0).startswith("about 20 min of processor time")


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_no_failure_of_a_table_is_hidden(part, tmp_path):
    assert (HERE / part.script).is_file()
    assert part.row(tmp_path, True)["failed"] == 1  # no table
    table = pandas.DataFrame(TABLES[part.table])
    table.to_csv(tmp_path / part.table, index=False)
    row = part.row(tmp_path, True)
    checks = {"stability.csv": 2, "kills.csv": 7, "threads.csv": 2, "random.csv": 50, "take_away.csv": 2,
              "long_tests.csv": 2}  # fmt: skip
    assert row["failed"] == 0 and row["checks"] == checks[part.table]
    assert part.row(tmp_path, False)["failed"] == 1  # the script failed, and its table does not know
    column, value = WRONG[part.table]
    table.loc[0, column] = value
    table.to_csv(tmp_path / part.table, index=False)
    assert part.row(tmp_path, True)["failed"] >= 1


def test_every_case_whose_threads_are_compared_is_a_scene():
    scenes = [scene_of(path).scene for path in shipped()]
    assert len(scenes) >= 15 and all(scene.grains is not None for scene in scenes)


def test_what_breaks_down_is_a_failure_and_does_not_keep_the_next_from_its_turn(tmp_path):
    class Scene:
        name, stops = "scene", None

        def may_stop_with(self, words, step):
            return False

        def steps(self):
            return [{"time.steps_per_contact": 10.0}, {"time.steps_per_contact": 32.0}]

        def run(self, folder, values):
            if values["time.steps_per_contact"] == 10.0:
                raise ZeroDivisionError

        def margins(self, run):
            return {"speed": 0.5}

    assert [row["margin"] < 1.0 for row in rows_of(Scene())] == [False, True]

    def row_of(path, folder):
        assert path.name != "first", "ended with 1"
        return {"kills": 2, "compared": 9, "differ": 0}

    rows = table_of([tmp_path / "first", tmp_path / "second"], row_of, tmp_path / "kills.csv")
    assert [row["differ"] for row in rows] == [1, 0]
    assert PARTS[1].row(tmp_path, True) == {
        "part": "kills", "checks": 2, "failed": 1, "nearest": "9 parts of records compared"
    }  # fmt: skip


def test_a_part_that_fails_does_not_keep_the_next_from_running(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(all_parts, "HERE", tmp_path)
    monkeypatch.setattr(all_parts, "slowness", lambda: 1.0)
    (tmp_path / "fails.py").write_text("raise SystemExit(1)")
    (tmp_path / "works.py").write_text(
        "import pathlib, sys\npathlib.Path(sys.argv[1], 'kills.csv').write_text('kills,compared,differ\\n2,9,0\\n')"
    )
    parts = [replace(PARTS[0], script="fails.py"), replace(PARTS[1], script="works.py")]
    assert main(tmp_path / "out", parts) == 1
    assert list(pandas.read_csv(tmp_path / "out" / "parts.csv")["failed"]) == [1, 0]
    assert "9 parts of records compared" in capfd.readouterr().out
    assert main(tmp_path / "out", parts[1:]) == 0


def test_a_stop_that_is_not_listed_fails():
    """Also one with words, and one that is listed for another step."""
    scene = HardScene("scene", {}, may_stop={"longer": "overlaps .* wall"})
    words = {"time.steps_per_contact": "grain 3 overlaps a neighbour or a wall by 10 %"}

    class Stops(HardScene):
        def steps(self):
            return iter([{"time.steps_per_contact": 10.0}, {"time.steps_per_contact": 100.0}])

        def run(self, folder, values=None):
            raise RunError(words["time.steps_per_contact"])

    listed = Stops(scene.name, scene.bounds, may_stop=scene.may_stop)
    assert [row["margin"] < 1.0 for row in rows_of(listed)] == [True, False]
    words["time.steps_per_contact"] = "the moments of the grains did not converge"
    assert [row["margin"] < 1.0 for row in rows_of(listed)] == [False, False]
    assert [kind_of_step({"contact.dvi.step": 1.0}, n) for n in range(3)] == ["shorter", "default", "longer"]
