"""Law of a powder between two faces of steel: shear stress, pressure and permeability, fitted to gap cells.

A gap cell is a `sheared_box` with `walls = "steel"` (`particles.GapBox`): some hundred grains in a given field. With B
the flux density across the gap, phi the solid fraction, n the grains per gap and I the inertial number of the shear
stress, the cells' stress is

    tau = mu_0 Ms^2 A (b/0.4)^e [1 + (phi/phi_n)^m] exp(k w),   e = p + r ln(chi/273),
    b = B/(mu_0 Ms),   w = 1/n^2 - 1/8^2,   ln phi_n = ln phi_1 - l w - q (I^2 - 0.1^2),

A and phi_1 being those of the powder (friction, rolling friction, susceptibility chi) and p, r, m, k, l, q those of all
powders. Beyond the cells b counts as 0.61 at most, and the stress goes with b^2 below 0.06 and with phi^1.5 below 0.22.
The contacts press on the faces with

    P = 0.103 mu_0 Ms^2 (b/0.4)^1.27 (phi/0.38)^0.22 [1 + 0.47 (phi/phi_n)^m],

whatever the friction. Dilute powder has a stress in proportion to A; from about 0.8 phi_1 on grains jam between the
faces. Diameter, density and saturation Ms drop out by similarity. The demagnetising factor with which the grains'
material has the magnetisation of the grains is

    N = N_0 + N_1 H/Ms + N_2 x

with x = ln(phi/0.38), below saturation (`field.laws.powder_law`, N against the macroscopic field H), N_0 being the
powder's. A, phi_1 and N_0 of other powders follow from a regression over those that were simulated, with a larger
error. What it misses of a simulated powder is added with a weight that decays with the distance from that powder
(universal kriging; N. A. C. Cressie, Statistics for Spatial Data, 1993, section 3.4). So the law is continuous, and
that of a simulated powder is its own. Cells: docs/explanation/gap_cells.md.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from math import exp, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from emclutch.device_model.materials import saturation_of
from emclutch.results.atomic_file import replace_json, replace_text
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.model import Scene
from field import MU_0, ParticleLaw
from particles.bulk_friction.friction_table import measured_table

VERSION = 1
"""Of the physics of cells: raised with each change that moves their stress."""

FILE = Path(__file__).with_name("powder_laws.json")
BASE_FILL, BASE_FLUX, BASE_SIZE, BASE_INERTIA = 0.38, 0.4, 8.0, 0.1
"""phi, b, n and I at which the logarithms of the law are 0."""

COEFFICIENTS = ("ln_A", "ln_fill", "flux", "power", "size", "size_fill", "inertia")
"""ln A, ln phi_1, e, m, k, l, q."""

COMMON = (*COEFFICIENTS[2:], "flux_susceptibility")
"""p, m, k, l, q, r."""

BASE_SUSCEPTIBILITY = 273.0

START = (-4.0, -0.7, 1.5, 9.0, 1.0, 1.0, 0.0, 0.0)
"""From which a fit begins."""

CLOSE_PACKING = 0.64
"""Of random spheres, phi_1 at most: that of powder whose cells show no jams is not known better."""

OWN = 2
"""Of them the first are the powder's own."""

WIDER = 5.0
"""Factor on the errors of the coefficients of all powders for a powder that they were not fitted to."""

UNLIKE = 0.3
"""Least error of such a coefficient over itself, of a powder that has what no shipped cell has: grains without necks
have e = 2.1 in place of 1.47 (two cells, H of 20 and 60 kA/m)."""

JAMMING_ERROR = 0.3
"""Largest standard error of ln phi_1: that of powder whose cells show no jams is not known better."""

MIN_CELLS = 3
"""For a law of one powder."""

OF_POWDER = (*COEFFICIENTS[:OWN], "demagnetising_factor")
"""ln A, ln phi_1, N_0."""

RANGES = {
    "fill": (0.22, 0.50),
    "flux density over mu_0 Ms": (0.06, 0.61),
    "grains per gap": (4.0, np.inf),
    "inertial number": (0.0, 0.4),
}
"""In which the law holds: phi, b, n, I. Cells have 0.25 to 0.50, 0.063 to 0.606, 4 to 16, 0.03 to 0.9; a device had a
fill of 0.22; beyond 16 grains per gap w is near its end, and devices of a larger I spill."""

DILUTE = 1.5
"""Power of the fill below that of the cells; suspensions of iron have 1.52 (J. D. Carlson, Int. J. Mod. Phys. B 19
(2005) 1463)."""

POWDERS = {"friction": (0.2, 0.7), "rolling friction": (0.0, 0.6), "susceptibility": (100.0, 1000.0)}
"""In which the law holds; the simulated powders have 0.23 to 0.64, 0 to 0.54, 100 to 999."""

REACH = (0.08, 0.04, 0.3)
"""Distance in friction, rolling friction and ln chi over which what the regression misses of a powder decays as a
Gaussian: left-out powders have their stress at a fill of 0.38 within 3.9 %, and 4.4 % without (root mean square)."""

FARTHEST = 1.0
"""Leverage of a powder in the regression, up to which its own coefficients follow from the others."""

UNSATURATED = 0.13
"""H/Ms up to which grains are not saturated, so that N has a meaning: they have less than 0.9 Ms."""

PRESSURE = (0.103, 1.27, 0.22, 0.47)
"""The numbers of P, fitted to the cells below I = 0.35, which have it within 4 % (standard deviation)."""

SURFACE_GAP = 3e-3
"""Of the simulated powders, in grain radii."""

Table = Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True)
class PowderLaw:
    """Law of one powder.

    Attributes
    ----------
    powder : tuple of float
        Friction, rolling friction and susceptibility [-].
    coefficients, errors : ndarray (7,)
        `COEFFICIENTS` and their standard errors, by the scatter of the cells.
    correlation : float
        Of the errors of the powder's own two.
    deviation : float
        Of a cell's logarithm from the law, standard deviation [-].
    permeability : tuple of float
        N_0, N_1, N_2.
    cells : int
        Of this powder; 0: by the regression over other powders.
    measured : dict of str to Any
        Keys of a scene with their values, as `powder_entries` returns them, of which the cells are; empty of a shipped
        law.
    """

    powder: tuple[float, float, float]
    coefficients: np.ndarray
    errors: np.ndarray
    correlation: float
    deviation: float
    permeability: tuple[float, float, float]
    cells: int
    measured: dict[str, Any] = field(default_factory=dict)

    def fit(self, cells: Table, measured: dict[str, Any], is_unlike: bool = False) -> PowderLaw:
        """Return the law of one powder by its cells, with this law as what is known before.

        Least squares of the logarithm of the stress. The powder's own coefficients are free; those of all powders have
        their values as a prior, with `WIDER` times their errors. The deviation is the larger of that of all cells and
        of these, in which a coefficient that is off its prior counts as a cell does.

        Parameters
        ----------
        cells : columns `saturation`, `field_strength`, `solid_fraction`, `grains_per_gap`, `inertial_number`,
            `shear_stress`, `flux_density`, `demagnetising_factor` (nan of saturated grains); `MIN_CELLS` rows or more.
        measured : see `PowderLaw`.
        is_unlike : whether the powder has what no shipped cell has; its prior is `UNLIKE` as wide at least.
        """
        Ms = cells["saturation"]
        y = np.log(cells["shear_stress"] / (MU_0 * Ms**2))
        at = (cells["flux_density"] / (MU_0 * Ms), cells["solid_fraction"], cells["grains_per_gap"],
              cells["inertial_number"])  # fmt: skip
        least = UNLIKE * np.abs(self.coefficients) if is_unlike else np.zeros(len(COEFFICIENTS))
        known = np.append(np.full(OWN, np.inf), np.maximum(WIDER * self.errors, least)[OWN:])

        def misfit(values: np.ndarray) -> np.ndarray:
            prior = (values - self.coefficients) / known
            return np.append((_logarithm(values, *at) - y) / self.deviation, prior[OWN:])

        upper = np.append((np.inf, np.log(CLOSE_PACKING)), np.full(len(known) - OWN, np.inf))
        found = least_squares(misfit, np.minimum(self.coefficients, upper - 1e-6), bounds=(-np.inf, upper),
                              x_scale=np.append((1.0, 0.1), known[OWN:]), xtol=1e-12, ftol=1e-12)  # fmt: skip
        scatter = self.deviation * sqrt(float((found.fun**2).sum()) / max(len(y) - OWN, 1))
        deviation = max(self.deviation, scatter)
        bounded = np.diag([0.0, JAMMING_ERROR**-2, *np.zeros(len(known) - OWN)])  # dilute powder shows no jams
        covariance = np.linalg.inv((self.deviation / deviation) ** 2 * found.jac.T @ found.jac + bounded)
        errors = np.sqrt(np.diag(covariance))
        start, slope, of_fill = self.permeability
        x, ratio = np.log(cells["solid_fraction"] / BASE_FILL), cells["field_strength"] / Ms
        own = cells["demagnetising_factor"] - slope * ratio - of_fill * x
        own = own[(ratio <= UNSATURATED) & np.isfinite(own)]
        return PowderLaw(
            self.powder, found.x, errors, float(covariance[0, 1] / (errors[0] * errors[1])), deviation,
            (float(own.mean()) if len(own) else start, slope, of_fill), len(y), measured,
        )  # fmt: skip

    def write(self, path: Path) -> None:
        """Write the law as JSON."""
        arrays = {"coefficients": self.coefficients.tolist(), "errors": self.errors.tolist()}
        replace_json(path, {"version": VERSION} | {one.name: getattr(self, one.name) for one in fields(self)} | arrays)

    @classmethod
    def read(cls, path: Path) -> PowderLaw:
        """Read a law; ValueError for a file that is none, or of another version."""
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            version = found.pop("version")
            law = cls(**found | {name: np.array(found[name], dtype=float) for name in ("coefficients", "errors")}
                      | {name: tuple(map(float, found[name])) for name in ("powder", "permeability")})  # fmt: skip
            parts = (law.coefficients, law.errors, law.powder, law.permeability, law.correlation, law.deviation)
            is_law = all(np.isfinite(part).all() for part in parts) and len(law.coefficients) == len(COEFFICIENTS)
        except OSError as error:
            raise ValueError(f"{path} cannot be read ({error.strerror or error}); measure the powder first with: "
                             "emclutch powder-law") from None  # fmt: skip
        except (AttributeError, KeyError, TypeError, ValueError):
            raise ValueError(f"{path} is no law of a powder; name powder_law.json of an emclutch "
                             "powder-law") from None  # fmt: skip
        if version != VERSION or not is_law:
            message = f"{path} has a law of version {version!r}, and the physics of cells is at {VERSION}"
            raise ValueError(f"{message}; measure the powder again with: emclutch powder-law")
        return law

    def stress(
        self, B: np.ndarray, Ms: float, fill: float, grains_per_gap: float, inertial_number: float = BASE_INERTIA
    ) -> np.ndarray:
        """Shear stress [Pa] at the flux density B [T] across the gap of grains that saturate at Ms [A/m]."""
        unit = MU_0 * Ms
        logarithm = _logarithm(self.coefficients, np.abs(B) / unit, fill, grains_per_gap, inertial_number)
        return unit * Ms * np.exp(logarithm)

    def pressure(self, B: np.ndarray, Ms: float, fill: float, grains_per_gap: float) -> np.ndarray:
        """Pressure of the contacts on the faces [Pa], arguments as of `stress`; the pull of the field is not in it."""
        start, flux, of_fill, jams = PRESSURE
        jammed = (fill / self.jamming_fill(grains_per_gap)) ** self.coefficients[3]
        b = np.abs(B) / (MU_0 * Ms)
        return start * MU_0 * Ms**2 * (b / BASE_FLUX) ** flux * (fill / BASE_FILL) ** of_fill * (1.0 + jams * jammed)

    def changes(self, b: float, fill: float, grains_per_gap: float, inertial_number: float) -> np.ndarray:
        """Changes of the logarithm of the stress at b = B/(mu_0 Ms) by a standard error of each coefficient."""
        above, below = (self.coefficients + sign * np.diag(0.5 * self.errors) for sign in (1.0, -1.0))
        at = max(b, 1e-6), fill, grains_per_gap, inertial_number
        return _logarithm(above.T, *at) - _logarithm(below.T, *at)

    def errors_at(self, b: float, fill: float, grains_per_gap: float, inertial_number: float) -> dict[str, float]:
        """Standard errors of the logarithm of the stress at b = B/(mu_0 Ms), by their causes."""
        change = self.changes(b, fill, grains_per_gap, inertial_number)
        size = np.isin(COEFFICIENTS, ("size", "size_fill"))
        square = float((change[~size] ** 2).sum() + 2.0 * self.correlation * change[0] * change[1])
        return {"cells": sqrt(square), "form": self.deviation, "size": float(np.linalg.norm(change[size]))}

    def jamming_fill(self, grains_per_gap: float) -> float:
        """phi_n at an inertial number of 0.1 [-]."""
        return exp(self.coefficients[1] - self.coefficients[5] * float(_excess(grains_per_gap)))

    def rise_with_fill(self, fill: float, grains_per_gap: float) -> float:
        """d ln(tau)/d ln(phi) at a fixed flux density."""
        above, below = (
            _logarithm(self.coefficients, BASE_FLUX, fill * exp(h), grains_per_gap, 0.0) for h in (0.01, -0.01)
        )
        return float(above - below) / 0.02

    def factor(self, H: np.ndarray, fill: np.ndarray | float, Ms: float) -> np.ndarray:
        """Demagnetising factor N of the grains [-] at the macroscopic field H [A/m]; constant from saturation on."""
        start, slope, of_fill = self.permeability
        x = np.log(np.maximum(fill, 0.5 * BASE_FILL) / BASE_FILL)
        return start + slope * np.minimum(np.abs(H) / Ms, UNSATURATED) + of_fill * x

    def flux_density(self, H: np.ndarray, fill: float, grains: ParticleLaw, Ms: float) -> np.ndarray:
        """B [T] of powder in a macroscopic field H [A/m]."""
        H = np.abs(np.asarray(H, dtype=float))
        # with H in the place of B/mu_0 a grain's factor against it is N - phi
        return MU_0 * (H + fill * grains.from_flux(MU_0 * H, fill, self.factor(H, fill, Ms) - fill)[0])


def powder_of(scene: Scene) -> tuple[float, float, float]:
    """Friction, rolling friction and susceptibility of a scene's grains."""
    rolling = scene.effects.rolling
    return scene.contact.friction, 0.0 if rolling is None else rolling.coefficient, scene.grains.susceptibility


def powder_entries(scene: Scene) -> dict[str, Any]:
    """What the stress of a scene's powder depends on, by dotted keys; diameter, density and Ms drop out by similarity.

    With cohesion, which has a scale, diameter and Ms are among them.
    """
    effects, grains = scene.effects, scene.grains
    found: dict[str, Any] = {
        "contact.friction": scene.contact.friction, "contact.friction_at_walls": scene.contact.friction_at_walls,
        "particles.susceptibility": grains.susceptibility, "particles.law": grains.law,
        "effects.saturation": effects.saturate, "effects.dipoles.model": effects.attraction.model,
    }  # fmt: skip
    if grains.sizes is not None:
        ends = (grains.smallest_diameter, grains.largest_diameter)
        found["particles.sizes"] = [float(f"{end / grains.mean_diameter:.3g}") for end in ends]
    if effects.attraction.has_necks:
        found["effects.dipoles.surface_gap"] = effects.attraction.surface_gap
    for effect in effects.present:
        if effect.role == "rolling" or (effect.changes_stress and effect.role != "drag"):
            found |= {f"effects.{effect.name}.{key}": value for key, value in effect.model_dump(mode="json").items()}
        if effect.has_scale:
            found |= {"particles.diameter": grains.mean_diameter, "particles.saturation": saturation_of(scene)}
    return found


def law_of(scene: Scene) -> tuple[PowderLaw, list[str]]:
    """Return the law of a scene's powder, and what the powder has that no cell of that law has.

    That is the measured law of `particles.powder_law`, or a shipped one, of the nearest powder.

    Raises
    ------
    SceneError
        The file of a measured law cannot be read, or holds no law.
    """
    file = scene.grains.powder_law
    if file is None:
        law, doubt = shipped_laws().nearest(*powder_of(scene))
        return law, [*_beyond_shipped_cells(scene), *([doubt] if doubt else [])]
    try:
        law = PowderLaw.read(Path(file))
    except ValueError as error:
        raise SceneError([Fault("particles.powder_law", "", str(error))], "scene") from None
    own = powder_entries(scene)
    others = [f"{key} = {own.get(key, 'none')} for {law.measured.get(key, 'none')}"
              for key in sorted({*own, *law.measured}) if own.get(key) != law.measured.get(key)]  # fmt: skip
    how = "measure it by emclutch powder-law, or remove particles.powder_law"
    doubts = [f"its law is of another powder ({', '.join(others)}): {how}"] if others else []
    real, own_diameter = scene.grains.real_diameter, scene.grains.mean_diameter
    if real is not None and real < own_diameter:
        doubts += [
            f"its law is of grains of {1e3 * own_diameter:.3g} mm, real ones have {1e3 * real:.3g} mm, and stress "
            f"depends on the diameter by [effects.{effect.name}]"
            for effect in scene.effects.present if effect.has_scale
        ]  # fmt: skip
    return law, doubts


def _beyond_shipped_cells(scene: Scene) -> Iterator[str]:
    """What a powder has that no shipped cell has."""
    effects, contact, rolling = scene.effects, scene.contact, scene.effects.rolling
    if not effects.attraction.has_necks:
        yield "grains have no necks (effects.dipoles.model)"
    elif effects.attraction.surface_gap != SURFACE_GAP:
        gap = effects.attraction.surface_gap
        yield f"its effects.dipoles.surface_gap is {gap:g}, and that of cells {SURFACE_GAP:g}"
    if not effects.saturate:
        yield "its grains do not saturate"
    if contact.friction_at_walls != contact.friction:
        yield f"its walls have a friction of {contact.friction_at_walls:g}, and its grains {contact.friction:g}"
    if rolling is not None and rolling.wall_coefficient not in (None, rolling.coefficient):
        walls, between = rolling.wall_coefficient, rolling.coefficient
        yield f"its walls have a rolling friction of {walls:g}, and its grains {between:g}"
    for one in effects.present:
        if one.changes_stress and one.role != "drag":
            yield f"it has [effects.{one.name}]"


def _of_susceptibility(common: np.ndarray, susceptibility: Any) -> list[Any]:
    """Coefficients of all powders with the exponent of the flux of a susceptibility."""
    flux, *others, change = common
    return [flux + change * np.log(np.asarray(susceptibility) / BASE_SUSCEPTIBILITY), *others]


def _excess(grains_per_gap: Any) -> np.ndarray:
    """w."""
    return np.maximum(grains_per_gap, RANGES["grains per gap"][0]) ** -2.0 - BASE_SIZE**-2.0


def _logarithm(coefficients: Iterable[Any], b: Any, fill: Any, grains_per_gap: Any, inertial_number: Any) -> np.ndarray:
    """ln(tau/(mu_0 Ms^2)) for `COEFFICIENTS`, numbers or arrays."""
    ln_A, ln_fill, flux, power, size, size_fill, inertia = coefficients
    w, (low, high) = _excess(grains_per_gap), np.log(RANGES["flux density over mu_0 Ms"])
    with np.errstate(divide="ignore"):  # no flux, no stress
        ln_b = np.minimum(np.log(np.asarray(b, dtype=float)), high)
    of_flux = flux * (ln_b - np.log(BASE_FLUX)) + (2.0 - flux) * np.minimum(ln_b - low, 0.0)
    dilute = DILUTE * np.minimum(np.log(np.asarray(fill) / RANGES["fill"][0]), 0.0)
    excess = inertia * (np.square(inertial_number) - BASE_INERTIA**2)
    jamming = np.logaddexp(0.0, power * (np.log(fill) - ln_fill + size_fill * w + excess))
    return ln_A + of_flux + dilute + jamming + size * w


@dataclass(frozen=True, eq=False)
class PowderLaws:
    """Laws of all powders that were simulated in cells, and of powders between them.

    Attributes
    ----------
    powders : ndarray (m, 3)
        Friction, rolling friction, susceptibility.
    cells : ndarray (m,)
        Number of cells of each.
    own, own_errors : ndarray (m, 3)
        ln A, ln phi_1 and N_0 of each powder, with standard errors.
    correlation : ndarray (m,)
        Of the errors of the first two.
    common, common_errors : ndarray (6,)
        `COMMON`.
    deviation : float
        See `PowderLaw`.
    permeability : tuple of float
        N_1, N_2.
    unknown : ndarray (k, 2)
        Friction and rolling friction of powders that are as likely as one another where only a free flow is known.
    provenance : dict
        Where the cells came from.
    """

    powders: np.ndarray
    cells: np.ndarray
    own: np.ndarray
    own_errors: np.ndarray
    correlation: np.ndarray
    common: np.ndarray
    common_errors: np.ndarray
    deviation: float
    permeability: tuple[float, float]
    unknown: np.ndarray
    provenance: dict[str, Any]

    def of(self, friction: float, rolling_friction: float, susceptibility: float) -> PowderLaw:
        """The law of a powder; ValueError where the powder is outside of `POWDERS`."""
        powder = (friction, rolling_friction, susceptibility)
        for (name, (low, high)), value in zip(POWDERS.items(), powder, strict=True):
            if not low <= value <= high:
                raise ValueError(f"{name} is {value:g}, and the law holds from {low:g} to {high:g}")
        (law,), variance = self.interpolated(np.array([powder])), self._weights(np.array([powder]))[1]
        if variance > 1.0 + FARTHEST:
            raise ValueError(f"friction {friction:g} with rolling friction {rolling_friction:g} and susceptibility "
                             f"{susceptibility:g} is too far from the simulated powders")  # fmt: skip
        return replace(law, cells=int(self.cells @ np.isclose(self.powders, powder, rtol=0.005).all(axis=1)))

    def interpolated(self, powders: np.ndarray) -> list[PowderLaw]:
        """Laws of powders (k, 3) between those that were simulated, which have their own laws, with their errors."""
        weights, variance = self._weights(powders)
        own_cross = self.correlation * self.own_errors[:, 0] * self.own_errors[:, 1]
        missed = self.left_out.T @ (self.left_out * np.diag(self._inverse)[: len(self.own), None]) / len(self.own)
        errors = np.sqrt(weights**2 @ self.own_errors**2 + np.outer(variance, np.diag(missed)))
        correlation = (weights**2 @ own_cross + variance * missed[0, 1]) / (errors[:, 0] * errors[:, 1])
        rows = zip(powders.tolist(), weights @ self.own, errors, correlation.tolist(), strict=True)
        return [
            PowderLaw(
                (friction, rolling, chi), np.append(own[:OWN], _of_susceptibility(self.common, chi)),
                np.append(error[:OWN], self.common_errors[:-1]), both, self.deviation,
                (float(own[OWN]), *self.permeability), 0,
            ) for (friction, rolling, chi), own, error, both in rows
        ]  # fmt: skip

    def nearest(self, friction: float, rolling_friction: float, susceptibility: float) -> tuple[PowderLaw, str]:
        """The law of a powder with an empty text, or of the nearest powder within `POWDERS` with why it is another."""
        try:
            return self.of(friction, rolling_friction, susceptibility), ""
        except ValueError as error:
            powder = zip((friction, rolling_friction, susceptibility), POWDERS.values(), strict=True)
            inside = np.array([float(np.clip(value, *ends)) for value, ends in powder])
            scale = [high - low for low, high in POWDERS.values()]
            near = int(np.argmin(np.square((self.powders - inside) / scale).sum(axis=1)))
            return self.of(*map(float, self.powders[near])), str(error)

    def free_flowing(self, susceptibility: float) -> list[PowderLaw]:
        """Laws of the `unknown` powders with a susceptibility."""
        return self.interpolated(np.column_stack([self.unknown, np.full(len(self.unknown), susceptibility)]))

    @cached_property
    def _inverse(self) -> np.ndarray:
        """Inverse of the equations of kriging: likeness of the powders, bordered by the features of the regression."""
        F = _features(self.powders)
        return np.linalg.inv(np.block([[_likeness(self.powders, self.powders), F], [F.T, np.zeros((F.shape[1],) * 2)]]))

    def _weights(self, powders: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights (k, m) of the simulated powders and the variance (k,) of what they miss, 0 of one of them."""
        right = np.hstack([_likeness(powders, self.powders), _features(powders)])
        solved = right @ self._inverse
        return solved[:, : len(self.powders)], np.maximum(1.0 - (solved * right).sum(axis=1), 0.0)

    @property
    def left_out(self) -> np.ndarray:
        """Own coefficients of each powder less those by the others, (m, 3) (O. Dubrule, Math. Geol. 15 (1983) 687)."""
        Q = self._inverse[: len(self.own), : len(self.own)]
        return Q @ self.own / np.diag(Q)[:, None]

    @classmethod
    def fit(cls, cells: Table, unknown: np.ndarray, provenance: dict[str, Any]) -> PowderLaws:
        """Fit cells: columns `friction`, `rolling_friction`, `susceptibility`, `saturation`, `field_strength`,
        `solid_fraction`, `grains_per_gap`, `inertial_number`, `shear_stress`, `flux_density`, `demagnetising_factor`.

        Least squares of the logarithm of the stress with equal weights: seeds differ by as much as cells from the law.
        """
        unit = MU_0 * cells["saturation"]
        y = np.log(cells["shear_stress"] / (unit * cells["saturation"]))
        at = (cells["flux_density"] / unit, cells["solid_fraction"], cells["grains_per_gap"], cells["inertial_number"])
        named = np.column_stack([cells[name] for name in ("friction", "rolling_friction", "susceptibility")])
        powders, which, count = np.unique(named, axis=0, return_inverse=True, return_counts=True)
        which, m = which.ravel(), len(powders)

        def misfit(values: np.ndarray) -> np.ndarray:
            own, common = values[: OWN * m].reshape(m, OWN), values[OWN * m :]
            return _logarithm((*own[which].T, *_of_susceptibility(common, powders[which, 2])), *at) - y

        most = np.append(np.tile((np.inf, np.log(CLOSE_PACKING)), m), np.full(len(START) - OWN, np.inf))
        start = np.append(np.tile(START[:OWN], m), START[OWN:])
        found = least_squares(misfit, start, bounds=(-np.inf, most), x_scale="jac", xtol=1e-12, ftol=1e-12)
        variance = float(found.fun @ found.fun) / (len(y) - len(found.x))
        covariance = variance * np.linalg.inv(found.jac.T @ found.jac)
        errors, first, second = np.sqrt(np.diag(covariance)), np.arange(0, OWN * m, OWN), np.arange(1, OWN * m, OWN)
        ratio = cells["field_strength"] / cells["saturation"]
        below = ratio <= UNSATURATED
        columns = [np.equal.outer(which, np.arange(m)), ratio, np.log(cells["solid_fraction"] / BASE_FILL)]
        A, N = np.column_stack(columns)[below].astype(float), cells["demagnetising_factor"][below]
        factor = np.linalg.lstsq(A, N, rcond=None)[0]
        scatter = sqrt(float(((N - A @ factor) ** 2).sum()) / (len(N) - len(factor)))
        factor_errors = scatter * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
        return cls(
            powders, count,
            np.column_stack([found.x[: OWN * m].reshape(m, OWN), factor[:m]]),
            np.column_stack([errors[: OWN * m].reshape(m, OWN), factor_errors[:m]]),
            covariance[first, second] / (errors[first] * errors[second]),
            found.x[OWN * m :], errors[OWN * m :], sqrt(variance),
            (float(factor[-2]), float(factor[-1])), unknown, provenance,
        )  # fmt: skip

    def write(self, path: Path) -> None:
        """Write the laws as JSON."""
        common = zip(COMMON, self.common.tolist(), self.common_errors.tolist(), strict=True)
        rows = zip(self.powders.tolist(), self.own.tolist(), self.own_errors.tolist(), self.correlation.tolist(),
                   self.cells.tolist(), strict=True)  # fmt: skip
        powders = [
            dict(zip(("friction", "rolling_friction", "susceptibility"), powder, strict=True)) | {
                name: {"value": value, "error": error}
                for name, value, error in zip(OF_POWDER, own, errors, strict=True)
            } | {"correlation": correlation, "cells": count}
            for powder, own, errors, correlation, count in rows
        ]  # fmt: skip
        named = {
            "version": VERSION, "provenance": self.provenance,
            "common": {name: {"value": value, "error": error} for name, value, error in common},
            "deviation": self.deviation, "permeability": list(self.permeability), "unknown": self.unknown.tolist(),
        }  # fmt: skip
        lines = [f'"{name}": {json.dumps(value)}' for name, value in named.items()]
        lines.append('"powders": [\n  ' + ",\n  ".join(map(json.dumps, powders)) + "\n ]")  # a powder a line
        replace_text(path, "{\n " + ",\n ".join(lines) + "\n}\n")

    @classmethod
    def read(cls, path: Path) -> PowderLaws:
        """Read laws; ValueError for a file of another version, or that is none."""
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            version, rows = found["version"], found["powders"]
            own = np.array([[[row[name][key] for name in OF_POWDER] for row in rows] for key in ("value", "error")])
            common = np.array([[found["common"][name][key] for name in COMMON]
                               for key in ("value", "error")])  # fmt: skip
            powders = np.array([[row["friction"], row["rolling_friction"], row["susceptibility"]] for row in rows])
            of_field, of_fill = found["permeability"]
            laws = cls(
                powders, np.array([int(row["cells"]) for row in rows]), own[0], own[1],
                np.array([float(row["correlation"]) for row in rows]), common[0], common[1],
                float(found["deviation"]), (float(of_field), float(of_fill)), np.array(found["unknown"]),
                found["provenance"],
            )  # fmt: skip
            finite = [np.isfinite(part).all() for part in (own, common, powders, laws.correlation, laws.deviation)]
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} has no powder laws: {error!r}; measure the powders again") from None
        if version != VERSION:
            raise ValueError(
                f"{path} has powder laws of version {version!r}, and the physics of cells is at {VERSION}; measure the "
                "powders again"
            )
        if not (all(finite) and len(powders)):
            raise ValueError(f"{path} has powder laws that are no finite numbers; measure the powders again")
        return laws


@lru_cache(maxsize=1)
def shipped_laws() -> PowderLaws:
    """The laws that come with the program."""
    return PowderLaws.read(FILE)


def _features(powders: np.ndarray) -> np.ndarray:
    """What own coefficients are regressed on, (k, 4): bulk friction, friction and susceptibility."""
    measured = measured_table()
    bulk = np.array([measured.bulk_friction(friction, rolling)[0] for friction, rolling, _ in powders])
    return np.column_stack([np.ones(len(powders)), bulk, powders[:, 0], np.log(powders[:, 2])])


def _likeness(some: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Correlation (k, m) of what the regression misses of powders (k, 3) and (m, 3)."""
    a, b = (np.column_stack([one[:, :2], np.log(one[:, 2])]) / REACH for one in (some, others))
    return np.exp(-0.5 * np.square(a[:, None] - b).sum(axis=2))
