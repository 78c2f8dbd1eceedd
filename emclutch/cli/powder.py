"""`emclutch powder`: friction and rolling friction of grains from the angle of repose of their powder, or back."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.cli.fit import REPOSE
from emclutch.results.atomic_file import json_values
from emclutch.results.new_path import new_picture
from emclutch.results.report.report import Mark, Report, Shown, Statement, Statements, Table, note, sentence
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.repose import (
    DRY_STEEL,
    angle_in_words,
    pair_by_tangent,
    pair_of_bulk_friction,
    spread_of_bulk_friction,
    tangent_in_words,
)
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import number_or_text
from particles.bulk_friction.friction_table import SOFTNESS, FrictionPair, measured_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SPREAD = Quantity("an angle", "rad", "1 deg", 0.0, 0.5, angular=True)
PAIRS = 8
"""Of a line that are listed."""


@dataclass(frozen=True, slots=True)
class FrictionLine:
    """The pairs of contact parameters that give one bulk friction.

    Attributes
    ----------
    bulk, spread : float
        tau/P and the half width of its interval [-].
    ends : tuple of 2 floats
        Least and largest sliding friction on the line [-].
    pairs : tuple of FrictionPair
        By ascending sliding friction.
    taken : FrictionPair
        By a scene with this particles.repose.
    angle : float or None
        The angle of repose that was given [rad]; None with an internal friction, of which there is one reading.
    """

    bulk: float
    spread: float
    ends: tuple[float, float]
    pairs: tuple[FrictionPair, ...]
    taken: FrictionPair
    angle: float | None

    @property
    def repose(self) -> float:
        """Angle of repose with this bulk friction [rad]."""
        return math.asin(self.bulk)


def line_of(repose: str | None, internal_friction: float | None, uncertainty: str) -> FrictionLine:
    """Return the line of an angle of repose, or of a coefficient of internal friction.

    Raises
    ------
    SceneError
        Both or neither, an entry that cannot be read, an angle that no friction gives.
    """
    if repose is not None and internal_friction is not None:
        message = "is the sine of --repose; give only one of the two"
        raise SceneError([Fault("--internal-friction", f"{internal_friction:g}", message)], "command line")
    if repose is None and internal_friction is None:
        message = "needs an angle of repose, --repose '34 deg', or the tau/P of a shear tester, --internal-friction 0.5"
        raise SceneError([Fault("powder", "", message)], "command line")
    option, entry = ("--repose", repose) if internal_friction is None else ("--internal-friction", internal_friction)
    try:
        angle = None if repose is None else REPOSE.read(number_or_text(repose))
        bulk = internal_friction or 0.0 if angle is None else math.sin(angle)
        pair_of_bulk_friction(bulk)  # refuses an angle that no friction gives
    except ValueError as error:
        raise SceneError([Fault(option, str(entry), str(error))], "command line") from None
    try:
        spread = spread_of_bulk_friction(bulk, _SPREAD.read(number_or_text(uncertainty)))
    except ValueError as error:
        raise SceneError([Fault("--uncertainty", uncertainty, str(error))], "command line") from None
    taken = pair_of_bulk_friction(bulk, spread)
    table = measured_table()
    ends = table.range_of_friction(bulk)
    assert ends is not None  # else there were no pair to take
    pairs = (table.pair(bulk, float(friction), spread) for friction in np.linspace(*ends, PAIRS))
    return FrictionLine(bulk, spread, ends, tuple(one for one in pairs if one is not None), taken, angle)


def bulk_of(friction: float, rolling: float) -> dict[str, float]:
    """Return bulk friction, its standard error and the angle of repose [rad] of a pair; SceneError beyond the table."""
    table, faults = measured_table(), []
    if not 0.0 <= friction <= table.friction[-1]:
        message = f"is out of range; allowed: 0 to {table.friction[-1]:g}, as far as bulk friction was measured"
        faults.append(Fault("--friction", f"{friction:g}", message))
    if not rolling >= 0.0:
        faults.append(Fault("--rolling-friction", f"{rolling:g}", "is out of range; allowed: at least 0"))
    if faults:
        raise SceneError(faults, "command line")
    mean, error = table.bulk_friction(friction, rolling)
    return {"bulk_friction": mean, "standard_error": error, "repose": math.asin(mean)}


def bulk_report(found: dict[str, float]) -> Report:
    """Return the report on a pair of coefficients (`bulk_of`)."""
    bulk = f"bulk friction {found['bulk_friction']:.3f} ± {found['standard_error']:.3f} (standard error of the table)"
    line = Statement(Mark.GOOD, f"Angle of repose: {angle_in_words(found['repose'])}; {bulk}.")
    return Report("Angle of repose", data=found).add("Result", Statements([line]), Shown.TERMINAL)


def as_data(line: FrictionLine) -> dict[str, Any]:
    """The line for a machine; angles in rad."""
    tangent = None if line.angle is None else pair_by_tangent(line.angle)
    return json_values(
        {
            "repose": line.repose, "bulk_friction": line.bulk, "bulk_friction_uncertainty": line.spread,
            "friction_range": line.ends, "pairs": [asdict(one) for one in line.pairs], "taken": asdict(line.taken),
            "taken_by_tangent": None if tangent is None else asdict(tangent),
        }
    )  # fmt: skip


def line_report(line: FrictionLine, picture: Path | None = None) -> Report:
    """Return the pairs that give an angle of repose, what a scene takes, and what is assumed."""
    table, taken = measured_table(), line.taken
    report = Report("Friction of a powder", data=as_data(line), closing="" if picture is None else str(picture))
    rows = [
        (f"{pair.friction:.2f}", f"{pair.rolling:.2g}", f"{pair.lowest:.2g}",
         "any" if math.isinf(pair.highest) else f"{pair.highest:.2g}")
        for pair in line.pairs
    ]  # fmt: skip
    low, high = line.ends
    if line.pairs[-1].rolling < 1e-3:
        end = f"{high:.2f} (perfect spheres, without rolling friction)"
    elif high < table.friction[-1]:
        end = f"{high:.2f} (at higher friction the angle is smaller even with hindered rolling)"
    else:
        end = (
            f"{high:g}, the largest simulated (clean iron). Spheres that roll freely reach "
            f"{angle_in_words(math.asin(table.mean[:, 0].max()))} at most, at any friction"
        )
    repose = angle_in_words(line.repose)
    lines = [
        Statement(Mark.GOOD, f"particles.repose = '{repose}' sets friction {taken.friction:.3g} and rolling friction "
                  f"{taken.rolling:.2g}. This pair is nearest to the friction of dry steel, {DRY_STEEL:g}."),
        note(f"Angle of repose {repose}: bulk friction {line.bulk:.3f} ± {line.spread:.3f}, that of all pairs below."),
        note(f"The column 'from' includes {100.0 * SOFTNESS:g} %, because simulated contacts are too soft."),
        note(f"Range of friction: from {low:.2f} (rolling hindered: grains slide before they roll) to {end}."),
    ]  # fmt: skip
    lines += [] if line.angle is None else [note(sentence(tangent_in_words(line.angle)))]
    report.add("Result", Statements(lines), Shown.TERMINAL)
    head = ("friction", "rolling friction", "from", "to")
    return report.add("Pairs", Table(rows, head, (0, 1, 2, 3)), Shown.TERMINAL)


def draw(line: FrictionLine, path: Path) -> None:
    """Draw bulk friction over both coefficients, and the line with its interval, into a new picture.

    Raises
    ------
    SceneError
        The file is no .png.
    OutputError
        There is a file already; nothing is overwritten.
    """
    from emclutch.results.pictures.figure import legend_below, new_figure, save_picture

    title = f"Friction of a powder with an angle of repose of {angle_in_words(line.repose)}"
    figure, (axes,) = new_figure(7.0, 5.8, title)
    _draw_line(axes, line)
    legend_below(axes, 2)
    save_picture(figure, new_picture(path))


def _draw_line(axes: Axes, line: FrictionLine) -> None:
    table = measured_table()
    friction, rolling = np.linspace(0.0, table.friction[-1], 201), np.linspace(0.0, table.rolling[-1] ** 0.5, 201) ** 2
    bulk = table.on_grid(friction, rolling).T
    levels = np.arange(12, 46, 4)
    levels = levels[np.abs(levels - np.degrees(line.repose)) > 0.5]  # the line of the powder has no second label
    angles = axes.contour(friction, rolling, np.degrees(np.arcsin(bulk)), levels=levels, colors="0.6")
    axes.clabel(angles, fmt="%d deg", fontsize=7, colors="0.3")
    inside = (bulk >= (line.bulk - line.spread) / (1.0 + SOFTNESS)) & (bulk <= line.bulk + line.spread)
    axes.contourf(friction, rolling, inside.astype(float), levels=[0.5, 1.5], colors="C0", alpha=0.25)
    axes.contour(friction, rolling, bulk, levels=[line.bulk], colors="C0", linewidths=2.0)
    angle = angle_in_words(line.repose)
    axes.plot([], [], color="0.6", label="equal angles of repose")
    axes.plot([], [], color="C0", lw=2.0, label=f"{angle}; shaded: with its uncertainty")
    axes.plot(line.taken.friction, line.taken.rolling, "o", color="C3", label=f"used for particles.repose = '{angle}'")
    measured = [axis.ravel() for axis in np.meshgrid(table.friction, table.rolling)]
    axes.plot(*measured, ".", color="0.3", ms=4, clip_on=False, label="simulated sheared boxes")
    axes.set_yscale("function", functions=(np.sqrt, np.square))
    axes.set(xlabel="sliding friction [1]", ylabel="rolling friction [1]", ylim=(0.0, table.rolling[-1]))
