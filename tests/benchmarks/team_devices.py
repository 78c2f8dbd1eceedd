"""Sizes, steels and measurements of TEAM workshop problems 20 and 13; where they are from stands in `team_problems`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from field.laws.magnetisation_curve import TableLaw
from field.laws.materials import material
from field.laws.reluctivity import MU_0, Law
from field.three_d.current_source import FlatCoil


@dataclass(frozen=True, slots=True)
class Team20:
    """Sizes [m] and measurements of problem 20; z = 0 is the yoke's bottom, the coil's axis is z."""

    gap: float = 1.5e-3
    pole: tuple[float, float] = (25e-3, 10e-3)
    yoke: tuple[float, float, float] = (127e-3, 25e-3, 150e-3)
    floor: float = 25e-3
    leg: float = 25e-3
    lid: float = 25e-3
    hole: float = 27e-3
    air_centre: float = 75e-3
    air_radius: float = 300e-3

    # Ampere-turns [A] and force on the pole [N]: of the article of 1994, at the currents that were set, and of
    # the summary of 1995, for the nominal ampere-turns.
    measured = ((980.0, 8.0), (3010.0, 53.8), (4520.0, 74.7), (5020.0, 79.7))
    summary = ((1000.0, 8.1), (3000.0, 54.4), (4500.0, 75.0), (5000.0, 80.1))
    # B_z [T] in the middle of the gap and at the pole's edge, at the nominal ampere-turns (summary of 1995).
    B_middle = ((1000.0, 0.36), (3000.0, 0.84), (4500.0, 0.99), (5000.0, 1.03))
    B_edge = ((1000.0, 0.24), (3000.0, 0.63), (4500.0, 0.72), (5000.0, 0.74))

    @property
    def coil(self) -> FlatCoil:
        """The winding: 39 to 75 mm square outside the pole, corners concentric, 1.7 mm from floor and lid."""
        clear = 1.7e-3
        return FlatCoil(37.5e-3, 37.5e-3, 23e-3, 18e-3, (self.floor + clear, self.yoke[2] - self.lid - clear))

    @property
    def laws(self) -> dict[str, Law]:
        """Law of each region that is steel."""
        return {name: material("team_steel") for name in ("yoke", "pole")}


@dataclass(frozen=True, slots=True)
class Team13:
    """Sizes [m] and measurements of problem 13; its upper half, z = 0 is a plane of mirrored coil and steel."""

    thickness: float = 3.2e-3
    width: float = 50e-3
    height: float = 126.4e-3
    gap: float = 0.5e-3
    clear: float = 120e-3
    offset: float = 15e-3
    air_radius: float = 400e-3

    coil = FlatCoil(100e-3, 100e-3, 50e-3, 25e-3, (-50e-3, 50e-3))
    # Mean flux density [T] across the steel at 1000 ampere-turns: B_z in the plate, B_x in the channel's top,
    # B_z in its side, at the listed z, x and z [mm].
    plate = ((0, 1.33), (10, 1.329), (20, 1.286), (30, 1.225), (40, 1.129), (50, 0.985), (60, 0.655))
    top = ((2.1, 0.259), (10, 0.453), (20, 0.554), (30, 0.637), (40, 0.698), (50, 0.755), (60, 0.809),
           (80, 0.901), (100, 0.945), (110, 0.954), (122.1, 0.956))  # fmt: skip
    side = ((60, 0.960), (50, 0.965), (40, 0.970), (30, 0.974), (20, 0.981), (10, 0.984), (0, 0.985))
    # |B| [T] in the air at y = 20, z = 55 mm against x [mm], at 3000 ampere-turns.
    air_3000 = ((10, 0.0593), (20, 0.0400), (30, 0.0336), (40, 0.0304), (50, 0.0283), (60, 0.0260), (70, 0.0231),
                (80, 0.0182), (90, 0.0116), (100, 0.0061), (110, 0.00406))  # fmt: skip

    @property
    def laws(self) -> dict[str, Law]:
        """Law of each region that is steel."""
        return {name: TEAM_13_STEEL for name in ("plate", "channels")}


def _team_13_table() -> TableLaw:
    """The table of the problem; above 1.8 T its formula goes over into M = const = 2.16 T/mu_0."""
    B = [0.0025, 0.005, 0.0125, 0.025, 0.05, *np.arange(1, 16) * 0.1, 1.55, 1.6, 1.65, 1.7, 1.75, 1.8]
    H = [16, 30, 54, 93, 143, 191, 210, 222, 233, 247, 258, 272, 289, 313, 342, 377, 433, 509, 648, 933,
         1228, 1934, 2913, 4993, 7189, 9423]  # fmt: skip
    # B = mu_0 H + a H^2 + b H + c with the sheet's a, b, c lies within 1 % of these points (the same student's
    # table); from 2.22 T on B = mu_0 H + 2.16 T.
    B += [1.86530612, 1.93061224, 1.99591837, 2.06122449, 2.12653061, 2.22]
    saturated = [12820.4, 16544.7, 20716.4, 25550.1, 31520.6, (2.22 - 2.16) / MU_0]
    return TableLaw(np.array([*H, *saturated]), np.array(B), "team_13_steel", "TEAM workshop problem 13")


TEAM_13_STEEL = _team_13_table()
