"""`emclutch materials`: the built-in materials as a list, the named ones in numbers, points and curves."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from emclutch.results.new_path import new_path
from emclutch.results.pictures.figure import new_figure, save_picture
from emclutch.results.report.report import Mark, Report, Shown, Statement, Statements, Table, note
from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.materials import ENDINGS
from emclutch.scene.units import CurveFieldStrength, FluxDensity, quantity_of
from emclutch.scene.value_list import read_all, split_list
from field.laws.coercivity import coercivity, misfit_of_curve
from field.laws.conductivity import Conductivity, conductivity
from field.laws.magnetisation_curve import TableLaw
from field.laws.magnetisation_table import TableFault, file_law
from field.laws.major_loop import MajorLoopLaw
from field.laws.materials import (
    canonical_name,
    grain_material,
    grain_names,
    material,
    material_aliases,
    material_names,
)
from field.laws.pinning import Pinning
from field.laws.reluctivity import MU_0, Law, LinearLaw
from field.laws.table_end import TableEnd
from geometry.table_file import is_unit_of, units_meant

_KINDS = {
    "LinearLaw": "linear",
    "TableLaw": "table",
    "PermeabilityLaw": "mu_r(B)",
    "FroehlichLaw": "Froehlich",
    "LangevinLaw": "Langevin",
    "BrauerLaw": "Brauer",
    "MajorLoopLaw": "loop",
}
SYMBOLS = (
    "J_s [T] = B - mu_0 H far in saturation. H_c [A/m]: coercivity. B_r [T]: remanence that follows from H_c and the "
    "curve. sigma [MS/m]: conductivity"
)
MORE = "Source and warnings of a material or powder: emclutch materials NAME"
# Every law that ships has the slope of vacuum here; J_s is read off at this flux density [T].
_SATURATED_B = 20.0
# of the list and the curves: 0.1 A/m, a hundredth of what soft iron needs, to 10 MA/m
_CURVE_B = np.concatenate((np.logspace(-7.0, 0.0, 700, endpoint=False), np.linspace(1.0, 15.0, 2801)))


@dataclass(frozen=True, slots=True)
class Characteristics:
    """One line of the list.

    Attributes
    ----------
    initial_mu_r, largest_mu_r : float
        Relative permeability B/(mu_0 H) at B -> 0, and the largest [-].
    J_s : float
        Saturation polarisation, B - mu_0 H far in saturation [T].
    conductivity : float or None
        Electrical [S/m], at 20 degrees C; None where it is not known (a table of the user).
    coercivity : float or None
        [A/m], an order of magnitude; None where it is not known.
    remanence : float or None
        [T], of the loop from saturation that follows from curve and coercivity; None where this is not known.
    also : tuple of str
        Other names of the same material.
    warning : str
        What of a table's points is not used, that it ends before the steel is saturated, or that the coercivity is not
        that of the curve's steel; else empty.
    loop : str
        Coercivity, remanence and loss of a law that is fitted to a loop against those of the loop; else empty.
    """

    name: str
    law: str
    initial_mu_r: float
    largest_mu_r: float
    J_s: float
    conductivity: float | None
    conductivity_is_rough: bool
    coercivity: float | None
    remanence: float | None
    also: tuple[str, ...]
    source: str
    warning: str = ""
    loop: str = ""


def characteristics(law: Law) -> Characteristics:
    """Line of the list for a law."""
    name = canonical_name(law.name)
    conducts: Conductivity | None = None if name is None else conductivity(name)
    H, slope = law.H_of_B(_CURVE_B)
    saturated = law.H_of_B(np.array([_SATURATED_B]))[0][0]
    coerced, remanence, misfit = _hysteresis(law)
    end = TableEnd.of(law)
    also = tuple(sorted(alias for alias, of in material_aliases().items() if of == name))
    return Characteristics(
        law.name,
        _KINDS.get(type(law).__name__, type(law).__name__),
        float(1.0 / (MU_0 * law.H_of_B(np.zeros(1))[1][0])),
        float(np.max(_CURVE_B / (MU_0 * H))),
        # a rounding below 0 for a linear law of mu_r = 1
        max(0.0, float(_SATURATED_B - MU_0 * saturated)) if slope[-1] * MU_0 > 0.999 else float("inf"),
        None if conducts is None else conducts.sigma,
        conducts is not None and conducts.rough,
        coerced,
        remanence,
        also,
        law.source,
        "; ".join(filter(None, (getattr(law, "warning", ""), end.in_words() if end else "", misfit))),
        law.in_words() if isinstance(law, MajorLoopLaw) else "",
    )


def _hysteresis(law: Law) -> tuple[float | None, float | None, str]:
    """Coercivity [A/m], remanence [T], None where they are not known, and a warning where they do not fit the curve."""
    if isinstance(law, MajorLoopLaw):
        return law.fitted.coercivity, law.fitted.remanence, ""
    name = canonical_name(law.name)
    if name is None:
        return None, None, ""
    pinning = Pinning.of(law, coercivity(name).H_c)
    return pinning.coercivity, pinning.remanence(law), misfit_of_curve(law, pinning)


def laws_of(names: list[str]) -> list[Law]:
    """The laws of built-in names and of files with a curve or a major loop; SceneError with every one that is wrong."""
    laws, faults = [], []
    for name in names:
        try:
            is_file = canonical_name(name) is None and (Path(name).suffix.lower() in ENDINGS or Path(name).is_file())
            laws.append(file_law(name) if is_file else material(name))
        except TableFault as fault:
            faults.append(Fault(name, "", fault.reason))
        except ValueError as error:
            faults.append(Fault("", "", str(error)))
    if faults:
        raise SceneError(faults, "command line")
    return laws


def points_of(laws: list[Law], places: str) -> list[dict[str, Any]]:
    """Points of curves at field strengths or flux densities, such as "2 kA/m, 1.5 T": H [A/m], B [T], B/(mu_0 H).

    `beyond_table` where a measured curve has ended. SceneError for a place that cannot be read.
    """
    points: list[dict[str, Any]] = []
    for text in map(str.strip, split_list(places, "--at")):
        unit = re.sub(r"^[\s+-]*[\d.]*(e[+-]?\d+)?\s*", "", text, flags=re.I)
        if not unit:
            message = "has no unit; write a field strength (A/m, kA/m, A/cm, Oe, kOe) or a flux density (T, mT, G, kG)"
            raise SceneError([Fault("--at", shown(text), message)], "command line")
        is_B = is_unit_of(unit, "T")
        goal = "T" if is_B else "A/m"
        text = text.removesuffix(unit) + units_meant(unit, goal)[0] if is_unit_of(unit, goal) else text
        (value,) = read_all([text], quantity_of(FluxDensity if is_B else CurveFieldStrength), "--at")
        for law in laws:
            B = value if is_B else _flux_density(law, value)
            (H,), (slope,) = law.H_of_B(np.array([B]))
            ends = law.H.max() if isinstance(law, TableLaw | MajorLoopLaw) else np.inf
            mu_r = (B / H if H else 1.0 / slope) / MU_0
            points.append({"material": law.name, "H": float(H), "B": B, "mu_r": mu_r, "beyond_table": bool(H > ends)})
    return points


def _flux_density(law: Law, H: float) -> float:
    """B [T] at H [A/m]."""
    top = 1.0
    while law.H_of_B(np.array([top]))[0][0] < H:
        top *= 2.0
    return float(brentq(lambda B: law.H_of_B(np.array([B]))[0][0] - H, 0.0, top, rtol=1e-12))


def _range(law: Law) -> str:
    """Where a measured curve ends and how it continues; empty of other laws."""
    if not isinstance(law, TableLaw | MajorLoopLaw):
        return ""
    J_s = getattr(law, "J_s", None)
    beyond = "B grows with mu_0 (slope of vacuum)" if J_s is None else f"J approaches J_s = {J_s:g} T"
    end = f"H = {law.H.max():.4g} A/m, B = {law.B.max():.4g} T"
    return f"{law.name}: {len(law.H)} points up to {end}; beyond, {beyond}."


def materials_report(names: list[str] | None, places: str | None = None) -> Report:
    """Return the list of all built-in materials, or of the named ones, with their points at H or B."""
    powders = [name for name in names or grain_names() if name in grain_names()]
    laws = laws_of([name for name in names or material_names() if name not in powders or canonical_name(name)])
    chosen = [characteristics(law) for law in laws]
    points = [] if places is None else points_of(laws, places)
    data: dict[str, Any] = {"materials": [asdict(one) for one in chosen]} | ({"points": points} if points else {})
    data |= {"grains": []} if powders else {}
    report = Report("Magnetic materials", data=data)
    if points:
        cells = [(one["material"], f"{one['H']:.4g}", f"{one['B']:.4g}", f"{one['mu_r']:.4g}",
                  "beyond the table" if one["beyond_table"] else "") for one in points]  # fmt: skip
        report.add("Points", Table(cells, ("", "H [A/m]", "B [T]", "B/(mu_0 H)", ""), (1, 2, 3)), Shown.TERMINAL)
    rows = []
    for one in chosen:
        sigma = "?" if one.conductivity is None else f"{1e-6 * one.conductivity:.3g}"
        permeability = f"{one.initial_mu_r:.0f}", f"{one.largest_mu_r:.0f}"
        sigma = f"≈ {sigma}" if one.conductivity_is_rough else sigma
        loop = (f"{one.coercivity:.3g}", f"{one.remanence:.2g}") if one.coercivity and one.remanence else ("", "")
        rows.append((one.name, *permeability, f"{one.J_s:.3f}", *loop, sigma))
    head = ("material", "initial mu_r", "largest mu_r", "J_s", "H_c", "B_r", "sigma")
    if rows:
        report.add("Materials", Table(rows, head, range(1, 7)), Shown.TERMINAL)
        also = ", ".join(f"{other} = {one.name}" for one in chosen for other in one.also)
        lines = _sources(laws, chosen) if names else [note(f"{SYMBOLS}."), note(f"Other names: {also}."), note(MORE)]
        report.add("Sources", Statements(lines), Shown.TERMINAL)
    if not powders:
        return report
    powder_rows: list[tuple[str, ...]] = []
    lines = []
    for name in powders:
        law, density, source = grain_material(name)
        data["grains"].append({"name": name, "susceptibility": law.chi, "saturation": law.Ms, "density": density,
                               "source": source})  # fmt: skip
        powder_rows.append((name, f"{law.chi:g}", f"{law.Ms or 0.0:.4g}", f"{density:g}"))
        lines += [note(f"{name}: {source}.")] if names else []
    grain_head = ("powder (particles.material)", "susceptibility", "saturation [A/m]", "density [kg/m^3]")
    report.add("Powders", Table(powder_rows, grain_head, (1, 2, 3)), Shown.TERMINAL)
    return report.add("Sources of powders", Statements(lines), Shown.TERMINAL) if lines else report


def _sources(laws: list[Law], chosen: list[Characteristics]) -> list[Statement]:
    """Return the sources of materials, and what is doubtful about them."""
    lines = [note(f"{SYMBOLS}.")]
    for one in chosen:
        also = f" (also {', '.join(one.also)})" if one.also else ""
        sigma_source = "" if one.conductivity is None else f" Conductivity: {conductivity(one.name).source}."
        lines.append(note(f"{one.name}{also}: {one.source}.{sigma_source}"))
        if one.coercivity and not one.loop:
            lines.append(note(f"{one.name}: coercivity {one.coercivity:g} A/m, {coercivity(one.name).source}."))
        if one.loop:
            lines.append(note(f"{one.name}: {one.loop}"))
        if one.warning:
            lines.append(Statement(Mark.WARNING, f"{one.name}: {one.warning}"))
    return lines + [note(text) for text in map(_range, laws) if text]


def draw_materials(laws: list[Law], path: str | Path) -> Path:
    """Draw B(H) on a linear and a logarithmic axis and mu_r(B) of some laws into a new picture (.png, .svg, .pdf).

    Materials of mu_r = 1 share one thin grey line. Measured points are marked: between them a table is an
    interpolation, beyond the last one the extrapolation is dashed. OutputError where there is a file already, or its
    ending names no picture.
    """
    path = new_path(Path(path), "--plot")
    figure, (plain, logarithmic, permeability) = new_figure(13.5, 4.6, None, columns=3)
    B = _CURVE_B[_CURVE_B >= 1e-4]
    as_vacuum = [law.name for law in laws if isinstance(law, LinearLaw) and law.mu_r == 1.0]
    for number, law in enumerate(law for law in laws if law.name not in as_vacuum[1:]):
        style = {"color": f"C{number % 10}", "lw": 1.6, "ls": "-" if number < 10 else "-.", "label": law.name}
        if law.name in as_vacuum:
            style |= {"color": "0.5", "lw": 1.0, "ls": ":", "label": ", ".join(as_vacuum)}
        curves = [(law.H_of_B(B)[0], B, style)]
        if isinstance(law, TableLaw | MajorLoopLaw):
            table, beyond = B[law.B.max() >= B], B[law.B.max() <= B]
            dashed = style | {"ls": "--", "lw": 1.0, "label": None}
            curves = [(law.H_of_B(table)[0], table, style), (law.H_of_B(beyond)[0], beyond, dashed)]
            points = {"color": style["color"], "ls": "none", "marker": ".", "ms": 4}
            curves.append((law.H[law.B > 0.0], law.B[law.B > 0.0], points))
        for H, of_H, drawn in curves:
            plain.plot(H / 1e3, of_H, **drawn)
            logarithmic.plot(H, of_H, **drawn)
            permeability.plot(of_H, of_H / (MU_0 * H), **drawn)
    top = 2.6
    plain.set(xlabel="H [kA/m]", ylabel="B [T]", xlim=(0.0, 20.0), ylim=(0.0, top), title="B(H)")
    logarithmic.set(xscale="log", xlabel="H [A/m]", ylabel="B [T]", xlim=(10.0, 1e6), ylim=(0.0, top))
    logarithmic.set_title("B(H), H logarithmic")
    permeability.set(yscale="log", xlabel="B [T]", ylabel="B/(mu_0 H)", xlim=(0.0, top), title="relative permeability")
    permeability.set_ylim(bottom=0.8)
    for axes in (plain, logarithmic, permeability):
        axes.grid(True, lw=0.3, alpha=0.6)
    plain.legend(loc="lower right", fontsize=8, frameon=False)
    return save_picture(figure, path)
