"""Effects that meet in the field or in an energy close torques and energies together as each does alone.

The bounds are those of `cases/hard/invariants.toml`, but for those that a pair gives itself. There are, besides: the
circuit with fed-back powder (`cases/hard/voltage_jump.toml`) by DEM, and both with eddy currents
(`cases/hard/eddy_currents_with_powder.toml`); eddy currents and circuit without powder (`test_coil_transient.py`).

Slots with circuit and powder end before the voltage jumps: they test the switch-on. At a fill of 0.15 the first window
leaves 2.2 % of the coil's energy open, 41 uJ in 0.1 ms and 11 uJ in 0.05 ms: about of second order in the window.
"""

import numpy as np
import pytest
from finished_run import FinishedRun
from hard_scene import hard_scenes
from invariants import margins

pytestmark = [pytest.mark.hard, pytest.mark.physics]

SCENES = {scene.name: scene for scene in hard_scenes()}
UP_AND_DOWN = {"times": [0.0, 4e-4, 8e-4], "values": [0.2, 1.0, 0.2]}
AT_A_CURRENT = {"effects.coil_circuit": None, "coil.voltage": None, "coil.current": UP_AND_DOWN}
SHORT = {"field.size_factor": 3, "time.end": "0.8 ms"}
SLOTS = {
    "geometry.disc_slots": {"count": 60, "fraction": 0.4, "depth": "2 mm"},
    "field.order": 1,
    "field.gap_layers": 3,
    "particles.diameter": "0.4 mm",
    "particles.solid_fraction": 0.05,
    "particles.sector": "6 deg",
    "time.end": "0.15 ms",  # two windows: the field is solved seven times
}


def into_steel_and_field(run: FinishedRun, share: float) -> float:
    """The integral of i d(flux linkage) is the change of the field's energy and the heat of hysteresis.

    From the first window's end on. The little work on the grains is left open, as by `coil_energy`.
    """
    history = run.history
    current, linkage = history["current"].to_numpy(), history["flux_linkage"].to_numpy()
    put_in = 0.5 * (current[1:] + current[:-1]) * np.diff(linkage)
    heat = history["hysteresis_loss"].to_numpy()[1:]
    energy = history["field_energy"].to_numpy()
    assert heat.sum() > share * energy.max()
    return abs(put_in.sum() - heat.sum() - (energy[-1] - energy[0])) / (share * (np.abs(put_in).sum() + energy.max()))


# Rigid grains: impulses do their work exactly. Of the energy that goes through, 1.2e-16 was measured, and no loss
# below zero; round-off, and a tenth of the solver's tolerance as in every scene by DVI. DEM's bound would be 6e-3.
RIGID = {"energy_balance": 1e-12, "losses": 1e-5}

# Scene, its values, and the bounds of the scene that are others here; None: not looked at.
PAIRS = {
    "eddy currents, feedback": ("eddy_currents_with_powder", AT_A_CURRENT, {}),
    "hysteresis, feedback": (
        "eddy_currents_with_powder",
        AT_A_CURRENT | {"effects.eddy_currents": None, "effects.hysteresis": {}},
        {},
    ),
    "DVI, circuit, feedback": ("voltage_jump", {"contact.method": "dvi"}, RIGID),
    "slots, circuit, feedback": ("voltage_jump", SLOTS, {"current": None}),  # it ends far below V/R
}


@pytest.mark.parametrize("name", PAIRS)
def test_torques_and_energies_close(name, tmp_path):
    of, values, own = PAIRS[name]
    scene = SCENES[of]
    run = scene.run(tmp_path / "run", SHORT | values)
    bounds = {name: bound for name, bound in (scene.bounds | own).items() if bound is not None}
    if own is RIGID:
        assert run.history["n_contacts"].max() > 0 and run.history["dissipated"].sum() > 0.0
    if "coil.current" in values:
        del bounds["current"]  # what voltage and resistance allow
    if "hysteresis_loss" in run.history:
        del bounds["coil_energy"]  # no supply: the current is given
        assert into_steel_and_field(run, 0.005) < 1.0
    found = margins(run, bounds)
    assert all(margin < 1.0 for margin in found.values()), {n: m for n, m in found.items() if m >= 1.0}
    assert run.history["feedback_residual"].max() > 0.0 and np.linalg.norm(run.moment, axis=1).min() > 0.0
