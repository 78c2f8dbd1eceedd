"""A changed setting gives a valid scene with the wanted value, and leaves the amount of powder alone."""

from itertools import pairwise
from pathlib import Path

import pytest

from emclutch.scene.case import Case, load_case, read_toml
from emclutch.scene.errors import SceneError
from emclutch.scene.slip_checks import why_no_slip
from emclutch.scene.start_up import start_up_strain
from emclutch.settings import FROZEN, HISTORIES, SETTINGS, settings_of
from emclutch.settings.powder import GRAINS_PER_GAP, SAME_WIDTH, SECTOR
from emclutch.simulation.plan import Plan, plan
from emclutch.simulation.setting_values import with_settings

CASES = Path(__file__).parents[2] / "cases"
SHIPPED = sorted(
    path
    for path in (*CASES.glob("*.toml"), *CASES.glob("thesis/*.toml"))
    if "particles" in (data := read_toml(path)) and "study" not in data
)
TURNED = ("quickstart", "hard/dense_hertz_mindlin", "hard/dense_walton_braun", "hard/rigid_and_elastic",
          "hard/rigid_jam", "hard/friction_of_five")  # fmt: skip


def planned(path: Path) -> tuple[Case, Plan]:
    """Return a scene with a coarse mesh, long enough for every setting, and its plan."""
    case = load_case(path)
    scene = case.scene
    values = {"time.until": None}
    if scene.geometry.has_axis and not why_no_slip(scene):
        values["time.end"] = f"strain {2.0 * start_up_strain(scene):g}"
    if scene.coil_field is not None:
        values["field.size_factor"] = 4.0
    case = case.with_values(values)
    return case, plan(case, threads=1)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_values_go_from_coarse_to_fine_through_the_scenes_own(path):
    if "slotted" in path.stem:
        pytest.skip("its field is solved in 3D, for many seconds; its sector has a test of its own")
    case, planning = planned(path)
    for setting in settings_of(case.scene):
        values = setting.values(case.scene, planning)
        steps = [setting.step_size(value) for value in values]
        assert setting.own(case.scene, planning) in values, setting.name
        assert all(coarse > fine for coarse, fine in pairwise(steps)), setting.name
        for value in values:
            case.with_values(setting.entries(case.scene, planning, value))


@pytest.mark.parametrize("name", TURNED)
def test_a_changed_scene_has_the_value_and_the_same_amount_of_powder(name):
    case, before = planned(CASES / f"{name}.toml")
    for setting in settings_of(case.scene):
        if setting.measured_on == FROZEN:
            continue  # they are keys of the scene as they stand, and a finer field takes long
        own, values = setting.own(case.scene, before), setting.values(case.scene, before)
        value = values[0] if values[0] != own else values[-1]
        turned = case.with_values(setting.entries(case.scene, before, value))
        after = plan(turned, threads=1)
        assert setting.own(turned.scene, after) == pytest.approx(value, rel=0.02), setting.name
        assert powder(turned, after) == pytest.approx(powder(case, before), rel=0.02), setting.name


def powder(case: Case, planning: Plan) -> float:
    """Return the volume of all grains of the device [m^3]."""
    grains = case.scene.grains
    return planning.count * grains.grain_volume * grains.n_sectors


def test_a_sector_between_slots_keeps_a_whole_number_of_pitches():
    scene = (case := load_case(CASES / "slotted_disc.toml")).scene
    for setting, values in ((SECTOR, SECTOR.usual(scene, None)), (GRAINS_PER_GAP, (5.0, 12.0))):
        for value in values:
            turned = case.with_values(setting.entries(scene, None, value))
            assert setting.own(turned.scene, None) == pytest.approx(value, rel=1e-3)
            rounded = case.with_values(setting.entries(scene, None, float(f"{value:.6g}"))).scene
            assert rounded.grains.n_sectors == turned.scene.grains.n_sectors


def test_finer_grains_leave_the_sector_as_wide_as_it_is_and_coarser_ones_keep_its_diameters():
    scene = (case := load_case(CASES / "quickstart.toml")).scene  # 4 grains per gap
    own = SECTOR.own(scene, None)
    for across, width in ((2.0, own), (5.0, 1.25 * own), (12.0, 3.0 * own)):
        turned = case.with_values(GRAINS_PER_GAP.entries(scene, None, across)).scene
        assert SECTOR.own(turned, None) == pytest.approx(width, rel=SAME_WIDTH)
        assert turned.grains.n_sectors == scene.grains.n_sectors or across < 4.0


@pytest.mark.parametrize("sector", ["4.5 deg", "30 deg", "60 deg", "180 deg"])
def test_finer_grains_that_are_counted_are_as_much_powder(sector):
    case = load_case(CASES / "quickstart.toml")
    case = case.with_values({"particles.sector": sector, "particles.solid_fraction": None, "particles.count": 400})
    finer = case.with_values(GRAINS_PER_GAP.entries(case.scene, None, 12.0)).scene.grains
    assert finer.n_sectors == case.scene.grains.n_sectors
    assert finer.count * finer.grain_volume == pytest.approx(400 * case.scene.grains.grain_volume, rel=1e-3)


def test_values_of_grains_and_sector_mean_the_same_whatever_the_scene_has_of_them():
    """A width is that beside the study's grains, here 4 per gap: three times finer ones have three times as many."""
    case = load_case(CASES / "quickstart.toml")
    own = SECTOR.own(case.scene, None)
    finer = with_settings(case, {"grains_per_gap": 12.0}, 4.0)
    wider = case.with_values(SECTOR.entries(case.scene, None, 2.0 * own))
    for begin in (case, finer, wider, with_settings(finer, {"sector": 2.0 * own}, 4.0)):
        for width in (own, 2.0 * own):
            found = with_settings(begin, {"grains_per_gap": 12.0, "sector": width}, 4.0).scene
            assert GRAINS_PER_GAP.own(found, None) == pytest.approx(12.0, rel=1e-3)
            assert SECTOR.own(found, None) == pytest.approx(3.0 * width, rel=0.03)  # a sector less in the ring


def test_values_of_a_scene_are_taken_as_they_stand():
    case, _ = planned(CASES / "hard/dense_hertz_mindlin.toml")
    asked = case.with_values({"accuracy.values.contact_step": [12, 30]})
    setting = next(one for one in SETTINGS if one.name == "contact_step")
    assert setting.values(asked.scene, plan(asked, threads=1)) == (12.0, 20.0, 30.0)


def test_an_unknown_setting_is_refused_with_the_nearest_name():
    case, _ = planned(CASES / "hard/dense_hertz_mindlin.toml")
    with pytest.raises(SceneError, match="contact_step"):
        case.with_values({"accuracy.values.contact_steps": [12, 30]})
    with pytest.raises(SceneError, match=r"accuracy\.values\.contact_step"):
        case.with_values({"accuracy.values.contact_step": [5]})


def test_a_free_shaft_has_no_start_up_in_strains():
    settings = {one.name for one in settings_of(load_case(CASES / "lock_up.toml").scene)}
    assert not any(one.name in settings for one in SETTINGS if one.measured_on == HISTORIES)
