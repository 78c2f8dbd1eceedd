"""The rest runs without an effect, a device and a source: each is one module. `make stability` takes away every one."""

from take_away import MAGNETIC, run_without

from emclutch.devices.clutch import ClutchGeometry
from emclutch.devices.drum import DrumGeometry
from emclutch.effects.coil_circuit import CoilCircuitSection
from emclutch.sources.coil import CoilFieldSection


def test_the_rest_runs_without_an_effect_a_device_and_a_source(tmp_path):
    run_without([CoilCircuitSection, ClutchGeometry, DrumGeometry, CoilFieldSection], MAGNETIC, tmp_path)
