"""Powder in a sheared box: what the coupled loop runs it with, its reach, and the stress that is to be expected."""

from __future__ import annotations

import math

import numpy as np

from coupling.grain_law_table import FARTHEST_GAP
from field.laws.reluctivity import MU_0
from particles import DEM, Grains, PairLaws, ShearedBox

SKIN = 0.3  # of the lists, in diameters
NEAR = 1.0 + 0.5 * FARTHEST_GAP  # diameters: where two equal spheres become mutual dipoles
DIPOLES_SUFFICE = 0.15  # of Ms: the field above which a chain of mutual dipoles holds as strongly as one with necks
STRESS_OF_LOAD = 0.258  # shear stress over phi load/d^2: iron of fill 0.32 had 0.13 at 18, 0.17 at 80, 0.20 at 200 kA/m


def grains_in_flow(box: ShearedBox, position: np.ndarray, radius: float | np.ndarray, density: float) -> Grains:
    """Grains that go and turn with the flow of the box; positions (n, 3) [m], radii [m], density [kg/m^3]."""
    spin = np.tile([0.0, 0.5 * box.rate, 0.0], (len(position), 1))
    return Grains.create(position, radius, density, velocity=box.flow(position[:, 2]), angular_velocity=spin)


def dem_in_box(box: ShearedBox, grains: Grains, laws: PairLaws, dt: float, *, energy_budget: bool = True) -> DEM:
    """The DEM of grains in a box, taken over, with a step [s] and lists of a skin that `list_reach` leaves room for."""
    skin = SKIN * 2.0 * float(grains.radius.max())
    return DEM(grains, [], [], laws, dt=dt, periodicity=box, skin=skin, energy_budget=energy_budget)


def list_reach(width: float | None) -> float:
    """Reach of the lists of pairs [diameters], their skin included; magnetic forces reach ``width`` diameters."""
    return max(0.0 if width is None else width, NEAR) + SKIN


def min_edge(width: float | None) -> float:
    """Shortest edge [diameters] of a box in which no grain meets a neighbour twice; ``width`` as of `list_reach`."""
    return 2.0 * list_reach(width)


def chain_load(Ms: float, H: float, diameter: float, *, necks: bool) -> float:
    """Load [N] on the contacts of a chain along the field: min(2 pi H/Ms, 0.7) mu_0 Ms^2 a^2.

    Of grains of saturation ``Ms`` [A/m] in the macroscopic field ``H`` [A/m]; 0 without either. Chains of mutual
    dipoles, without ``necks``, hold less in weak fields.
    """
    if Ms == 0.0:
        return 0.0
    load = min(2.0 * math.pi * H / Ms, 0.7) * MU_0 * (0.5 * Ms * diameter) ** 2
    return load if necks else load * min(1.0, (H / (DIPOLES_SUFFICE * Ms)) ** 1.2)


def expected_stress(load: float, fill: float, diameter: float) -> float:
    """Shear stress [Pa] of a powder whose chains bear ``load`` [N], within a factor of about two."""
    return STRESS_OF_LOAD * fill * load / diameter**2
