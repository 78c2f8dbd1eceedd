"""Hard cases stay stable: bounded energy, finite numbers, or an explained stop, never a silent wrong answer."""

from pathlib import Path

import numpy as np
import pytest
import sheared_annulus

import emclutch
from emclutch.scene.case import case_from

pytestmark = [pytest.mark.hard, pytest.mark.physics]

CASES = Path(__file__).resolve().parents[2] / "cases"
CELL = sheared_annulus.CELL | {
    "scene": {"title": "hard cell", "seed": 5},
    "effects": sheared_annulus.CELL["effects"] | {"wall_images": {}},
    "time": {"end": "0.4 ms"},
    "output": {"snapshots": 0, "pictures": False, "formats": [], "checkpoint": False},
}


@pytest.fixture
def steel_cylinders(monkeypatch):
    sheared_annulus.make_cylinders_of_steel(monkeypatch)


def run(tmp_path, name, values=None):
    return emclutch.run(case_from(CELL, values), out=tmp_path / name)


@pytest.mark.parametrize(
    "values",
    [
        {"contact.friction": 0.0},
        {"contact.friction": 5.0},
        {"contact.restitution": 1.0},
        {"contact.restitution": 0.05},
        {"particles.solid_fraction": 0.5, "contact.friction": 1.0},
        {"particles.susceptibility": 1e5},
        {"field.field_strength": "5 MA/m"},
        {"motion.rotor.speed": "6000 rpm", "time.end": "0.3 ms"},
        {"effects.rolling_friction": {"coefficient": 5.0}},
        {"time.steps_per_contact": 10},
        {"effects.dipoles.update_every": 40},
    ],
    ids=lambda values: " ".join(f"{key.rpartition('.')[2]}={value}" for key, value in values.items()),
)
def test_stays_bounded(values, tmp_path, steel_cylinders):
    """Grains never get faster than a few times the walls and the fall of a pair, nor deeper than a few per cent."""
    result = run(tmp_path, "run", values)
    history = result.history
    # the steel pulls at the grains: its images are in the energy budget of torque, beside the pairs
    assert history["torque_field_images"].abs().max() > 1e-3 * history["torque_field_dipoles"].abs().max()
    assert np.isfinite(history.drop(columns="inertial_number").to_numpy()).all()
    # a saturated pair falls together with v^2 = F d/m at most; walls stir with their own speed
    wall = 11.2e-3 * history["rotor_speed"].max()
    mu_0, Ms, rho = 4e-7 * np.pi, 1.3e6, 7700.0
    fall = np.sqrt(mu_0 * Ms**2 / (4.0 * rho))  # (pi/6) mu_0 Ms^2 a^2 over 2 a, against m/2
    assert history["max_speed"].max() < 3.0 * (wall + fall)
    assert history["max_overlap"].iloc[5:].max() < 0.05
    # magnetism and walls are the only sources; what they give is stored or dissipated, to the split's first order
    throughput = (history["work_walls"].abs() + history["work_magnetic"].abs() + history["dissipated"]).sum()
    assert abs(history["energy_residual"].sum()) < 0.1 * throughput


def test_a_contact_too_soft_for_its_load_is_refused_or_stops_with_an_explanation(tmp_path, monkeypatch):
    soft = {"contact.stiffness": 5.0, "time.end": "5 ms"}
    with pytest.raises(RuntimeError, match=r"contact.stiffness = 5 N/m is too soft.*Raise it to about"):
        run(tmp_path, "refused", soft)
    monkeypatch.setattr("emclutch.simulation.contact_plan.STOPS", np.inf)  # as where the plan does not see it coming
    with pytest.raises(RuntimeError, match=r"overlaps .* % of the diameter .*raise contact.stiffness = 5 fourfold"):
        run(tmp_path, "soft", soft)
    assert (tmp_path / "soft" / "history.csv").is_file()  # what was computed stays


def test_a_step_beyond_the_limit_is_refused_with_the_allowed_one(tmp_path):
    with pytest.raises(RuntimeError, match=r"time.step = .* allowed: more than 0 and at most"):
        run(tmp_path, "long", {"time.step": 1e-5})


def test_a_coil_switched_on_and_off_leaves_no_force_behind(tmp_path):
    """Current 0 -> 1 A -> 0 in a drum: the field follows the table, and at 0 A forces are exactly zero."""
    case = emclutch.load_case(CASES / "quickstart.toml").with_values(
        {
            "coil.current": {"times": [0.0, 2e-5, 4e-5, 6e-5], "values": [0.0, 1.0, 1.0, 0.0]},
            "time.end": 8e-5,
            "particles.sector": "4 deg",
            "field.size_factor": 2.0,
            **{f"output.{key}": value for key, value in CELL["output"].items()},
        }
    )
    history = emclutch.run(case, out=tmp_path / "run").history
    late = history["time"] > 7e-5  # three windows after the end of the current: forces follow the window before
    assert (history.loc[late, "flux_linkage"] == 0.0).all()
    assert (history.loc[late, "work_magnetic"] == 0.0).all()
    assert history["flux_linkage"].max() > 0.1


@pytest.mark.parametrize("fill", [0.3, 0.5, 0.58])
def test_the_powder_inside_the_newton_converges_for_any_susceptibility(fill):
    """A magnetisation fed back explicitly diverges above chi_eff of about 1.3; inside the Newton nothing does."""
    from field import AxisymmetricProblem, GrainLaw, PowderLaw, material
    from geometry import Clutch, mesh_clutch

    mesh = mesh_clutch(Clutch(), size_factor=2.0)
    steel = {"disc", "rotor", "housing"}
    laws = {r: material("steel_1010" if r in steel else "air") for r in mesh.regions if r not in ("powder", "coil")}
    for chi in (1.0, 1e2, 1e5):
        problem = AxisymmetricProblem(mesh, laws, powder_law=PowderLaw(GrainLaw(chi, 1.3e6)))
        for ampere_turns in (1.0, 650.0, 1e5):
            solution = problem.solve(ampere_turns, np.full(problem.powder_elements.size, fill))
            assert solution.newton[-1][0] < 1e-8
            assert len(solution.newton) < 20
