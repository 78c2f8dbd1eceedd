"""The grains' step is compiled by a second process while the first one meshes, solves and packs.

It takes 40 % of what a new user waits for before the first window (34 s of 87 s of processor time, `quickstart` with an
empty cache), and the first process has other kernels to compile meanwhile. So where the cache holds no step at all,
a child makes a step of the same kind with two grains, which puts the code into the cache, where the run finds it, or
waits for it. A run whose kind of step is not in a cache that has others compiles it itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from coupling.sheared_powder import dem_in_box
from emclutch.scene.contact import ContactSection
from emclutch.scene.replica_count import cores_at_hand
from emclutch.simulation.kernel_compilation import ONCE
from geometry.kernels.cache import ROOT, has_entries
from geometry.kernels.threads import default_threads
from geometry.walls import cylinder
from particles import DEM, Body, CyclicSector, GapBox, GrainMotion, Grains, PairLaws, RollingFriction, ShearedBox
from particles.attraction import Attraction

RADIUS, MASS = 1e-3, 1e-5


def kind_of(scene: Any) -> list[str]:
    """Law and optional parts of the loop over pairs, which decide the compiled DEM step of a scene."""
    effects = scene.effects
    parts = {
        "resistance": bool({"rolling", "twisting"} & set(effects.contact_terms())),
        "sizes": scene.particles.sizes is not None,
        "sector": scene.particles.sector is not None,
        "box": scene.geometry.is_periodic and not scene.geometry.may_have_steel_faces,
        "gap": scene.geometry.is_periodic and scene.geometry.may_have_steel_faces,
        "energies": scene.output.energy_budget,
        "attraction": effects.attraction is not None and effects.attraction.has_necks,
    }
    return [scene.contact.law, *(name for name, on in parts.items() if on)]


def grains_of_kind(law: str, *parts: str) -> DEM:
    """A DEM of two grains whose step is compiled from the same types as that of a scene of this kind."""
    radius = RADIUS * np.array([1.0, 1.2 if "sizes" in parts else 1.0])
    where = np.array([[10.0, 1.0, 0.0], [10.0, 4.0, 0.0]]) * RADIUS
    between = ContactSection(law=law).laws(mass=MASS, diameter=2.0 * RADIUS, force=1e-3, speed=1.0)[0]
    laws = PairLaws.of_one(between, rolling=RollingFriction(0.1) if "resistance" in parts else None)
    grains, energies = Grains.create(where, radius, 2500.0), "energies" in parts
    if "box" in parts:
        dem = dem_in_box(ShearedBox(np.full(3, 30.0 * RADIUS), 1.0), grains, laws, 1e-7, energy_budget=energies)
    else:
        sector = CyclicSector(2.0 * np.pi / 6.0) if "sector" in parts else None
        gap = GapBox(np.full(3, 30.0 * RADIUS)) if "gap" in parts else None
        bore = cylinder("bore", "drum", 20.0 * RADIUS, -1.0, 1.0)
        dem = DEM(grains, [bore], [Body("drum")], laws, dt=1e-7, periodicity=gap or sector, energy_budget=energies)
    if "attraction" in parts:
        dem.attraction = Attraction(0.0, 1.0, np.zeros((2, 2)), np.zeros(2), 1.0, _no_drives)
    return dem


def _no_drives(motion: GrainMotion) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((motion.listed_pairs.count, 3)), np.zeros((len(motion.listed_walls.wall), 2))


def lacks_step(scene: Any) -> bool:
    """True where the grains move by DEM and the cache holds no compiled step yet."""
    from particles.dem.step_kernel import run_steps

    return scene.contact.method == "dem" and not has_entries(run_steps)


def start(scene: Any) -> subprocess.Popen | None:
    """The child that compiles, or None where it would not help: a step is in the cache, or there is one core only."""
    if not lacks_step(scene) or default_threads(cores_at_hand()) < 2:
        return None
    # -P: the folder that the user stands in may hold files with the names of modules, from elsewhere even
    command = [sys.executable, "-P", "-m", "emclutch.simulation.kernel_warm_up", *kind_of(scene)]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    null = subprocess.DEVNULL
    with suppress(OSError):  # it only saves time
        return subprocess.Popen(command, stdin=null, stdout=null, stderr=null, env={**os.environ, "PYTHONPATH": path})
    return None


@contextmanager
def step_compiled_aside(scene: Any, report: Callable[[str], None]) -> Iterator[None]:
    """Compile the grains' step in a second process during the block.

    Whoever asks for the step meanwhile waits for it at the cache's lock (`geometry.kernels.cache`).
    """
    child = start(scene)
    if child is not None:
        report(f"Compiling the DEM step in a second process ({ONCE})")
    try:
        yield
    finally:
        if child is not None and child.poll() is None:
            child.terminate()
            child.wait()


if __name__ == "__main__":
    grains_of_kind(*sys.argv[1:]).run(1)
