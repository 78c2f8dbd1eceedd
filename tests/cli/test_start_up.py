"""The program starts quickly: help and `check` import no library that their answer does not need."""

import subprocess
import sys
from pathlib import Path

import pytest

from emclutch.cli.main import app
from emclutch.scene import units

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = [one.name or one.callback.__name__.replace("_", "-") for one in app.registered_commands]
DRAWING = {"matplotlib", "PIL", "pyvista", "vtkmodules", "jinja2"}
OF_RESULTS = {"h5py", "pandas", "dask", "scipy.stats", "scipy.integrate"}


def loaded_by(*calls):
    """Modules that a new process has imported after the command line has answered each call."""
    code = "import sys\nfrom emclutch.cli.main import app\n"
    code += "".join(f"app({call}, standalone_mode=False)\n" for call in calls)
    code += "print(*sys.modules, sep='\\n', file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(done.stderr.split())


def test_help_of_every_command_imports_nothing_that_computes():
    loaded = loaded_by(["--help"], *([name, "--help"] for name in COMMANDS))
    computing = {"numpy", "scipy", "numba", "gmsh", "skfem", "meshio", "pint", "emclutch.scene.model"}
    assert loaded & (computing | DRAWING | OF_RESULTS) == set()


def test_check_imports_neither_what_draws_nor_what_keeps_results():
    loaded = loaded_by(["check", "cases/quickstart.toml"])
    assert loaded & (DRAWING | OF_RESULTS | {"pint", "meshio", "emclutch.simulation.run"}) == set()


@pytest.mark.parametrize(("SI", "unit"), [(SI, unit) for SI, table in units.FACTORS.items() for unit in table])
def test_units_without_pint_are_pints_to_the_last_bit(SI, unit):
    registry, factor = units.registry(), units.FACTORS[SI][unit]
    for number in (1.0, 0.1, 0.3, 1.7, 7.3e-5, 6378.1):
        assert factor * number == registry.Quantity(number, registry(unit).units).to(SI or "dimensionless").magnitude
