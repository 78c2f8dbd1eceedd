"""Magnetic circuits of lumped reluctances with saturating iron, and the one of a particle clutch.

A flux tube of length l and section A carries a flux Phi at the magnetic voltage l H(Phi/A); a winding adds
N I to its branch.  Kirchhoff's laws are the minimum of a convex energy over the branch fluxes,

    min  sum l A w(|Phi|/A) - N I Phi       with   sum of the fluxes into every node = 0,

w the energy density of the tube's law: the circuit is the field's own principle with a handful of unknowns.
It is solved by Newton with a line search, so saturation from a cold start is no difficulty.

What a circuit leaves out (fringing beyond what a tube is given, leakage off its paths, flux that
crowds at corners) makes it an estimate, good to ten or twenty per cent, in milliseconds.
Source: Roters, Electromagnetic Devices, 1941, ch. 4 and 5.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from field.laws.powder_law import PowderLaw
from field.laws.reluctivity import AIR, Law

if TYPE_CHECKING:
    from geometry.clutch import Clutch

_MAX_STEPS = 200
_TOLERANCE = 1e-10


@dataclass(frozen=True, slots=True)
class FilledPowder:
    """A powder law at one solid fraction, as a law of a flux tube."""

    powder: PowderLaw
    fill: float
    name: str = "powder"
    source: str = "powder law at a given fill"

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Law.H_of_B`."""
        return self.powder.H_of_B(B, self.fill)

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """See `Law.energy_density`."""
        return self.powder.energy_density(B, self.fill)


@dataclass(frozen=True, slots=True)
class FluxTube:
    """A piece of flux path with one flux density.

    Parameters
    ----------
    name : str
    length : float
        Along the flux [m], > 0.
    area : float
        Across it [m^2], > 0.
    law : Law
    """

    name: str
    length: float
    area: float
    law: Law = AIR

    def __post_init__(self) -> None:
        if not (0.0 < self.length < math.inf and 0.0 < self.area < math.inf):
            raise ValueError(
                f"flux tube {self.name!r}: length {self.length} m and area {self.area} m^2 must be finite and above 0"
            )

    @classmethod
    def axial(cls, name: str, r0: float, r1: float, length: float, law: Law = AIR) -> FluxTube:
        """An annulus r0 < r < r1 [m] that carries axial flux."""
        return cls(name, length, math.pi * (r1**2 - r0**2), law)

    @classmethod
    def radial(cls, name: str, r0: float, r1: float, width: float, law: Law = AIR) -> FluxTube:
        """A ring r0 < r < r1 [m] of axial width [m] that carries radial flux; r0 > 0.

        With l = r1 - r0 and the logarithmic mean of the area its linear reluctance ln(r1/r0)/(2 pi mu width) is exact.
        """
        if not 0.0 < r0 < r1:
            raise ValueError(f"flux tube {name!r}: radii {r0} and {r1} m must be above 0 and grow")
        return cls(name, r1 - r0, 2.0 * math.pi * width * (r1 - r0) / math.log(r1 / r0), law)

    def voltage(self, flux: float) -> tuple[float, float]:
        """Magnetic voltage [A] and its slope [A/Wb] at a flux [Wb]."""
        H, slope = self.law.H_of_B(np.array([abs(flux) / self.area]))
        return math.copysign(self.length * float(H[0]), flux), self.length / self.area * float(slope[0])

    def energy(self, flux: float) -> float:
        """Stored energy [J] at a flux [Wb]."""
        return self.length * self.area * float(self.law.energy_density(np.array([abs(flux) / self.area]))[0])


@dataclass(frozen=True, slots=True)
class Branch:
    """Tubes in series between two nodes, with the windings around them.

    Parameters
    ----------
    begin, end : str
        Nodes; flux is positive from begin to end.
    tubes : tuple of FluxTube
    winding : float
        Ampere-turns per ampere-turn of the coil that drive flux from begin to end: 1 for the coil's own branch.
    """

    begin: str
    end: str
    tubes: tuple[FluxTube, ...]
    winding: float = 0.0


@dataclass(frozen=True, slots=True)
class CircuitSolution:
    """Fluxes of a solved circuit.

    Attributes
    ----------
    flux : dict of str to float
        Of every tube [Wb].
    flux_density : dict of str to float
        [T]
    voltage : dict of str to float
        Magnetic voltage [A].
    linkage_per_turn : float
        Flux through a turn of the coil [Wb].
    energy : float
        [J]
    """

    flux: dict[str, float]
    flux_density: dict[str, float]
    voltage: dict[str, float]
    linkage_per_turn: float
    energy: float


class MagneticCircuit:
    """A network of flux tubes.

    Parameters
    ----------
    branches : sequence of Branch
        Names of tubes are unique.

    Raises
    ------
    ValueError
        No branches, tubes of one name, a branch without tubes.
    """

    def __init__(self, branches: list[Branch] | tuple[Branch, ...]) -> None:
        names = [tube.name for branch in branches for tube in branch.tubes]
        if not branches or any(not branch.tubes for branch in branches):
            raise ValueError("a magnetic circuit needs branches, each with at least one flux tube")
        double = sorted({name for name in names if names.count(name) > 1})
        if double:
            raise ValueError(f"tubes of one name in a magnetic circuit: {', '.join(double)}; rename them")
        self.branches = tuple(branches)
        nodes = sorted({node for branch in branches for node in (branch.begin, branch.end)})
        incidence = np.zeros((len(nodes), len(branches)))
        for k, branch in enumerate(branches):
            incidence[nodes.index(branch.begin), k] -= 1.0
            incidence[nodes.index(branch.end), k] += 1.0
        # closed loops of flux: every admissible flux is a combination of these columns
        _, singular, right = np.linalg.svd(incidence)
        rank = int((singular > 1e-9).sum())
        self._loops = right[rank:].T
        self._winding = np.array([branch.winding for branch in branches])

    def solve(self, ampere_turns: float) -> CircuitSolution:
        """Fluxes at N I [A]; raises ArithmeticError if Newton does not converge."""
        loops = self._loops
        drive = ampere_turns * (loops.T @ self._winding)
        q = np.zeros(loops.shape[1])
        size = max(np.abs(drive).max(initial=0.0), 1e-300)
        value = self._energy(q, drive)
        for _ in range(_MAX_STEPS):
            voltage, slope = self._voltages(loops @ q)
            residual = loops.T @ voltage - drive
            if ampere_turns == 0.0 or np.abs(residual).max(initial=0.0) <= _TOLERANCE * size:
                return self._solution(loops @ q)
            step = -np.linalg.solve(loops.T @ (slope[:, None] * loops), residual)
            descent, length = float(residual @ step), 1.0
            while True:
                trial = self._energy(q + length * step, drive)
                if trial <= value + 1e-4 * length * descent + 1e-13 * abs(value) or length < 1e-12:
                    break
                length *= 0.5
            q, value = q + length * step, trial
        raise ArithmeticError(
            f"the magnetic circuit did not converge at {ampere_turns:g} ampere-turns: residual "
            f"{np.abs(residual).max():.2g} A; check that H of every law grows with B"
        )

    def _voltages(self, fluxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        both = np.array(
            [
                np.sum([tube.voltage(float(flux)) for tube in branch.tubes], axis=0)
                for branch, flux in zip(self.branches, fluxes, strict=True)
            ]
        )
        return both[:, 0], both[:, 1]

    def _energy(self, q: np.ndarray, drive: np.ndarray) -> float:
        fluxes = self._loops @ q
        stored = sum(
            tube.energy(float(flux))
            for branch, flux in zip(self.branches, fluxes, strict=True)
            for tube in branch.tubes
        )
        return stored - float(drive @ q)

    def _solution(self, fluxes: np.ndarray) -> CircuitSolution:
        flux, density, voltage, energy = {}, {}, {}, 0.0
        for branch, through in zip(self.branches, fluxes, strict=True):
            for tube in branch.tubes:
                flux[tube.name] = float(through)
                density[tube.name] = float(through) / tube.area
                voltage[tube.name] = tube.voltage(float(through))[0]
                energy += tube.energy(float(through))
        return CircuitSolution(flux, density, voltage, float(self._winding @ fluxes), energy)


def clutch_circuit(clutch: Clutch, laws: Mapping[str, Law], powder: Law = AIR) -> MagneticCircuit:
    """The magnetic circuit of a clutch.

    Parameters
    ----------
    clutch : Clutch
    laws : dict of str to Law
        Of the regions disc, rotor, housing and, where they are steel, cover.
    powder : Law
        Of the powder in the gaps, see `FilledPowder`; air by default.

    The coil drives flux through the housing's yoke, down its two cheeks, over the clearance into the two poles
    of the rotor, and through rim gap and disc from pole to pole.  Beside it lie the leakage across the coil's
    window (a third of its area: the flux links the turns in part), the one through the ring and the clearance
    next to it, and, where the covers are steel, the path over cover and face gap.  Poles fringe by a gap's width on
    each free side.

    Names of tubes: yoke, cheeks, clearance, shell, gap, disc; window, ring; cover, face.
    """
    half_face, gap = 0.5 * clutch.disc_thickness, clutch.gap
    coil, length = clutch.coil_width, clutch.housing_length
    cheek = 0.5 * (length - coil)
    pole = clutch.pole_length
    steel, rotor, disc = laws["housing"], laws["rotor"], laws["disc"]
    yoke_middle = 0.5 * (clutch.coil_outer_radius + clutch.outer_radius)
    housing = Branch(
        "cheek_left",
        "cheek_right",
        (
            FluxTube.axial("yoke", clutch.coil_outer_radius, clutch.outer_radius, coil + cheek, steel),
            _both_sides(FluxTube.radial("cheeks", clutch.housing_bore, yoke_middle, cheek, steel)),
        ),
        winding=1.0,
    )
    window = Branch(
        "cheek_right",
        "cheek_left",
        # flux across the winding links only the turns outside it: a third of the area, as in a slot
        (FluxTube("window", coil, math.pi * (clutch.coil_outer_radius**2 - clutch.housing_bore**2) / 3.0),),
    )
    # flux enters the shell under the cheek and leaves it over the pole: what lies between runs along the shell
    along = abs(0.5 * (coil + cheek) - 0.5 * (clutch.ring_width + pole))
    overlap = min(cheek, 0.5 * (clutch.rotor_length - coil)) + clutch.clearance
    shell = [_both_sides(FluxTube.radial("clearance", clutch.rotor_radius, clutch.housing_bore, overlap))]
    if along > 0.0:
        shell.append(_both_sides(FluxTube.axial("shell", clutch.bore_radius, clutch.rotor_radius, along, rotor)))
    # both sides of the symmetric device stand in one tube: from the right cheek in and back out to the left one
    branches = [
        housing,
        window,
        Branch("cheek_right", "poles", tuple(shell)),
    ]
    ring_width = clutch.ring_width
    if ring_width > 0.0:
        # in addition to the ring itself, the half circles that fringe over it outwards (Roters' semicircular tube)
        area = math.pi * (clutch.rotor_radius**2 - clutch.bore_radius**2)
        fringe = 0.26 * 2.0 * math.pi * clutch.rotor_radius * ring_width
        branches.append(Branch("poles", "cheek_left", (FluxTube("ring", ring_width, area + fringe),)))
    if pole > 0.0:
        width = pole + gap  # half a gap of fringing on each side
        branches.append(
            Branch(
                "poles",
                "disc",
                (_both_sides(FluxTube.radial("gap", clutch.disc_radius, clutch.bore_radius, width, powder)),),
            )
        )
    if "cover" in laws and clutch.cover_magnetic:
        face_middle = math.sqrt(0.5 * (clutch.seal_radius**2 + clutch.disc_radius**2))
        branches.append(
            Branch(
                "poles",
                "disc",
                (
                    _both_sides(
                        FluxTube.radial("cover", face_middle, clutch.bore_radius, clutch.cover_thickness, laws["cover"])
                    ),
                    _both_sides(
                        FluxTube.axial("face", clutch.seal_radius, clutch.disc_radius, clutch.face_gap, powder)
                    ),
                ),
            )
        )
    # in the disc the flux turns from radial to axial: it reaches about half a thickness deep below the rim
    depth = min(clutch.disc_radius, half_face)
    branches.append(
        Branch(
            "disc",
            "cheek_left",
            (
                FluxTube.axial(
                    "disc",
                    clutch.disc_radius - depth,
                    clutch.disc_radius,
                    0.5 * (clutch.disc_thickness + ring_width),
                    disc,
                ),
            ),
        )
    )
    return MagneticCircuit(branches)


def _both_sides(tube: FluxTube) -> FluxTube:
    """Both sides of the symmetric device in one tube."""
    return FluxTube(tube.name, 2.0 * tube.length, tube.area, tube.law)
