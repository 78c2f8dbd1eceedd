"""The second process compiles the very step that the run will ask for."""

import numpy as np
import pytest
from numba import typeof
from sheared_annulus import DRY

from coupling.staggered import refresh_field
from emclutch.scene.case import case_from
from emclutch.simulation import kernel_warm_up
from emclutch.simulation.assembly import assemble
from emclutch.simulation.plan import make_plan
from particles.dem import box_kernel, total_columns


def types(dem):
    """Types of the arguments of a compiled step."""
    bodies = len(dem.bodies)
    given = dem._arguments(
        1,
        True,
        np.zeros(bodies),
        np.zeros(bodies),
        np.zeros(total_columns.N_SUMS),
        np.zeros((bodies, total_columns.N_BODY_SUMS)),
        None if dem.box is None else np.zeros(box_kernel.N_BOX_SUMS),
    )
    return [str(typeof(one)) for one in given]


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"particles.sector": None, "geometry.height": 0.5e-3},
        {"effects.rolling_friction": {}, "output.energy_budget": False},
        {"effects.twisting_friction": {}, "effects.cohesion": {"model": "constant", "force": "1 uN"}},
        {"particles.diameter": None, "particles.sizes": {"kind": "uniform", "min": "0.2 mm", "max": "0.3 mm"}},
        {"contact.law": "hertz_mindlin", "contact.youngs_modulus": "1 GPa", "contact.poisson_ratio": 0.3},
        {"contact.law": "walton_braun", "effects.gravity": {"direction": [0.0, 0.0, -1.0]}},
        {"geometry": {"kind": "sheared_box", "size": [2e-3] * 3, "shear_rate": 100.0}, "motion": None,
         "particles.sector": None},
    ],
)
def test_the_second_process_compiles_what_the_run_needs(values):
    case = case_from(DRY, values)
    simulation = assemble(*make_plan(case))
    assert types(kernel_warm_up.grains_of_kind(*kernel_warm_up.kind_of(case.scene))) == types(simulation.motion)


def test_the_second_process_knows_that_grains_attract():
    """The pull of near grains is in the step from the first evaluation of the moments on."""
    field = {"source": "uniform", "field_strength": "50 kA/m", "direction": "radial"}
    effects = {"dipoles": {"model": "near_field", "cutoff": 2.5}, "saturation": {}}
    case = case_from({**DRY, "field": field, "effects": effects}, {})
    simulation = assemble(*make_plan(case))
    refresh_field(simulation)
    simulation.magnetised.update(simulation)
    simulation.magnetised.freeze(simulation, np.zeros_like(simulation.motion.grains.position))
    simulation.motion.attraction.fetch(simulation.motion)
    assert types(kernel_warm_up.grains_of_kind(*kernel_warm_up.kind_of(case.scene))) == types(simulation.motion)


def test_there_is_no_second_process_where_one_thread_is_asked_for(monkeypatch):
    """So in this test run, whose workers have one core each."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert kernel_warm_up.start(case_from(DRY).scene) is None


def test_the_second_process_runs_no_file_of_the_folder_that_the_user_stands_in(tmp_path, monkeypatch):
    (tmp_path / "numpy.py").write_text("open('ran', 'w')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.setattr(kernel_warm_up, "has_entries", lambda kernel: False)
    monkeypatch.setattr(kernel_warm_up, "kind_of", lambda scene: [])  # it has imported everything when it fails
    child = kernel_warm_up.start(case_from(DRY).scene)
    if child is not None:  # a machine with one core has none
        assert child.wait(timeout=120) == 1
    assert not (tmp_path / "ran").exists()
