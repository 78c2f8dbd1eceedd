"""The shear stress of magnetised powder at the default step by DVI is within its bars that at a quarter of the step.

A small periodic box across a field; `tests/benchmarks/dvi_step_in_field.py` has a larger one, with DEM as the line.
"""

import numpy as np
import pytest
from scipy import stats

from coupling import run_staggered
from emclutch.results.columns import columns_of
from emclutch.scene.case import case_from
from emclutch.simulation.assembly import assemble
from emclutch.simulation.plan import make_plan

pytestmark = pytest.mark.physics

D, EDGE = 1e-4, 4.6  # m; diameters: no grain meets a neighbour twice
BEGIN, END, BATCHES = 0.5, 3.5, 6  # strains of the mean
SCENE = {
    "scene": {"title": "powder across a field", "seed": 3},
    "geometry": {"kind": "sheared_box", "size": 3 * [EDGE * D], "inertial_number": 0.15},
    "field": {"source": "uniform", "field_strength": 300e3, "direction": "z", "means": "macroscopic"},
    "particles": {"diameter": D, "solid_fraction": 0.35},
    "contact": {"method": "dvi"},
    "effects": {"dipoles": {"model": "mutual", "cutoff": 2.0}, "saturation": {}},
    "time": {"end": f"strain {END:g}"},
    "output": {"pictures": False, "snapshots": 0, "formats": []},
}


def _stress(changes):
    """Mean and standard error [Pa] of the stress over batches of strain, and the step [s]."""
    device, plan = make_plan(case_from(SCENE, changes))
    simulation, rows = assemble(device, plan), []
    run_staggered(simulation, plan.end, [lambda _, row: rows.append(columns_of(row))])
    late = [(one["shear_stress"], one["steps"], one["missed_steps"]) for one in rows if one["shear_strain"] > BEGIN]
    stress, steps, missed = np.array(late).T
    assert missed.sum() == 0
    parts = zip(np.array_split(stress, BATCHES), np.array_split(steps, BATCHES), strict=True)
    means = [np.average(s, weights=n) for s, n in parts]
    return np.mean(means), np.std(means, ddof=1) / BATCHES**0.5, plan.dt


def test_a_quarter_of_the_step_has_the_same_stress():
    stress, error, step = _stress({})
    finer, finer_error, quarter = _stress({"contact.dvi.step": 0.25 * make_plan(case_from(SCENE))[1].dt})
    assert quarter == pytest.approx(0.25 * step, rel=1e-3)
    joint = np.hypot(error, finer_error)
    assert joint < 0.2 * finer  # 8 % expected; of two times six batches, so known to a quarter of itself
    # the paths of grains differ with the last bit, hence by processor: Student's t of 10 degrees at 1 in 1000
    assert stress == pytest.approx(finer, abs=stats.t.ppf(0.9995, 2 * (BATCHES - 1)) * joint)
