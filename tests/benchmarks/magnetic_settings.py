"""How far moments and magnetic pull depend on the settings of the magnetic model, on snapshots of a run.

python tests/benchmarks/magnetic_settings.py RUN_FOLDER [snapshots] [sectors]; the folder's run.h5 holds at least so
many in its second half (output.snapshots). A sector too narrow for the widest value is taken so many times side by
side. For each setting and value: root mean square change of the moments, and change of the pull across the gap, against
the reference of the setting (the last value), mean over the snapshots.

Refresh: the grains move on with held moments for so many steps; by then the moments that the law asks for have changed
by so much, and so does the pull that the grains feel, near pulls at their gaps of that step, differ from the one found
again. In the mean over the interval it is half of that.
"""

import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from magnetised_step import quiet, side_by_side

import emclutch
from coupling.staggered import lagged_forces, refresh_field
from coupling.window_budget import WindowBudget
from emclutch.results.record import Record
from emclutch.scene.case import Case
from emclutch.simulation.assembly import simulation_of
from emclutch.simulation.plan import make_plan
from emclutch.studies.accuracy.frozen_state import MOMENTS_TOLERANCE, FrozenState, frozen_state, pull_across
from particles import DEM, Grains

WIDTHS = (2.5, 3.0, 3.5)  # diameters
ROWS = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0)  # of elements, over the width
REFRESH = (10, 20, 40, 50, 80, 160)  # steps


def change(found: FrozenState, reference: FrozenState) -> tuple[float, float, float]:
    """Of the moments, root mean square; of the sum of their magnitudes; of the pull."""
    size = np.sqrt((reference.moment**2).sum())
    total = np.linalg.norm(found.moment, axis=1).sum() / np.linalg.norm(reference.moment, axis=1).sum()
    return (
        float(np.sqrt(((found.moment - reference.moment) ** 2).sum()) / size),
        float(total - 1.0),
        float(found.stress / reference.stress - 1.0),
    )


def held(case: Case, frame: dict[str, np.ndarray], steps: int) -> tuple[float, float]:
    """Change of the moments over so many steps in which they are held, root mean square, and of the pull."""
    device, plan = make_plan(case)
    grains = Grains.create(
        frame["position"], frame["radius"], case.scene.particles.density,
        velocity=frame["velocity"], angular_velocity=frame["angular_velocity"],
    )  # fmt: skip
    simulation = simulation_of(device, plan, grains)
    magnetised, dem = simulation.magnetised, simulation.motion
    magnetised.tolerance = MOMENTS_TOLERANCE
    refresh_field(simulation)
    dem.external_force = lagged_forces(simulation, WindowBudget(simulation))
    magnetised.freeze(simulation, dem.external_force)
    dem.run(steps)
    dem.renew_list()  # from here on the grains keep their order
    before, where = np.array(dem.grains.magnetic_moment), np.array(dem.grains.position)
    force = lagged_forces(simulation, WindowBudget(simulation))
    after = dem.grains.magnetic_moment
    moments = float(np.sqrt(((before - after) ** 2).sum() / (after**2).sum()))
    felt = force_of_next_step(dem)
    return moments, pull_across(device.shear_radius, where, felt) / pull_across(device.shear_radius, where, force) - 1.0


def force_of_next_step(dem: DEM) -> np.ndarray:
    """What a step's velocities say of the forces (n, 3) [N] that are none of contact."""
    velocity = np.array(dem.grains.velocity)
    dem.run(1)
    return dem.grains.mass[:, None] * (dem.grains.velocity - velocity) / dem.dt - dem.contact_force


def main() -> None:
    folder, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 10
    sectors = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    case = quiet(emclutch.load_case(f"{folder}/case.toml"), {})
    alone = case.scene.particles.sector
    if sectors > 1:
        case = case.with_values({"particles.sector": sectors * alone})
    record = Record.open(f"{folder}/run.h5")
    total = len(record.frames())
    frames = [
        side_by_side(record.grains(int(k)), alone, sectors) for k in np.linspace(total // 2, total - 1, count).round()
    ]
    gap, d = make_plan(case)[0].shear_gap, case.scene.particles.largest_diameter
    own = case.scene.effects.dipoles.cutoff
    fine = round(3.2 * gap / d)  # layers: eight rows over the narrowest width
    settings = {
        "width [d]": [(a, {"effects.dipoles.cutoff": a, "field.gap_layers": fine}) for a in WIDTHS],
        "rows": [(n, {"field.size_factor": 4.0 / n}) for n in ROWS],
    }
    print(f"{folder}: {count} snapshots, a = {own:g} d, gap {gap / d:.3g} d")
    for name, values in settings.items():
        print(f"{name:>10}  {'moments':>9} {'sum |m|':>9} {'pull':>9} {'its spread':>10} {'s':>6}")
        found = {
            value: [frozen_state(case.with_values(entries), f["position"], 2.0 * f["radius"]) for f in frames]
            for value, entries in values
        }
        reference = found[values[-1][0]]
        for value, states in found.items():
            off = np.array([change(one, other) for one, other in zip(states, reference, strict=True)])
            seconds = np.median([one.seconds for one in states])
            rms, size, pull = off.mean(axis=0)
            print(f"{value:10g}  {rms:9.2%} {size:9.2%} {pull:9.2%} {off[:, 2].std():10.2%} {seconds:6.2f}", flush=True)
    print(f"{'steps held':>10}  {'moments':>9} {'pull':>9}")
    for steps in REFRESH:
        moments, pull = np.mean([held(case, frame, steps) for frame in frames[:3]], axis=0)
        print(f"{steps:10d}  {moments:9.2%} {pull:9.3%}", flush=True)


if __name__ == "__main__":
    main()
