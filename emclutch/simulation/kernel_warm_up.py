"""Compile the kernels of a scene ahead of its first run, by two processes: ``make setup`` does for the quickstart.

    python -m emclutch.simulation.kernel_warm_up cases/quickstart.toml

The DEM step takes 40 % of the processor time of compiling. So a second process makes a step of the same kind with two
grains, while the first one runs the scene for a moment; whoever asks for the step meanwhile waits for it at the cache's
lock (`geometry.kernels.cache`). A run whose kernels are not in the cache compiles them itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from coupling.sheared_powder import dem_in_box
from emclutch.scene.case import Case, load_case
from emclutch.scene.contact import ContactSection
from emclutch.simulation.run import run
from geometry.kernels.cache import ROOT
from geometry.walls import cylinder
from particles import DEM, Body, CyclicSector, GapBox, GrainMotion, Grains, PairLaws, RollingFriction, ShearedBox
from particles.attraction import Attraction

SHORT = {"time.end": "1 us", "time.until": None, "accuracy.replicas": 1, "output.pictures": False}
STEP = "--step"
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


def compile_kernels(case: Case) -> None:
    """Put the kernels of a scene's run into the cache; what fails in the second process is compiled by this one."""
    # -P: the folder that the user stands in may hold files with the names of modules, from elsewhere even
    command = [sys.executable, "-P", "-m", "emclutch.simulation.kernel_warm_up", STEP, *kind_of(case.scene)]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    with TemporaryDirectory() as folder, subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}):
        run(case.with_values(SHORT), out=Path(folder) / "run")


if __name__ == "__main__":
    first, *rest = sys.argv[1:]
    if first == STEP:
        grains_of_kind(*rest).run(1)
    else:
        compile_kernels(load_case(first))
