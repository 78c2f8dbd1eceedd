"""What is compiled ahead is what the run will ask for."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numba import typeof
from sheared_annulus import DRY

from coupling.staggered import refresh_field
from emclutch.scene.case import case_from
from emclutch.simulation import kernel_warm_up
from emclutch.simulation.assembly import assemble
from emclutch.simulation.plan import make_plan
from geometry.kernels.cache import ROOT
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


@pytest.mark.stability
def test_a_run_after_it_compiles_nothing(tmp_path):
    """From an empty cache."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    case = ROOT / "cases" / "quickstart.toml"
    ahead = [sys.executable, "-m", "emclutch.simulation.kernel_warm_up", str(case)]
    subprocess.run(ahead, cwd=ROOT, env=environment, check=True, capture_output=True)
    values = [f"--set={key}={value}" for key, value in {"time.end": "0.2 ms", "time.until": "none"}.items()]
    command = [sys.executable, "-m", "emclutch.cli.main", "run", str(case), "--out", str(tmp_path / "run"), *values]
    done = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True)
    assert "started" in done.stderr and "Compiling" not in done.stderr
