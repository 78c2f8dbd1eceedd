"""Torque against current of measured dry powder brakes and of cases/powder_clutch.toml, all over their rated points.

    python tests/benchmarks/dry_brakes.py docs/dry_brakes.png

draws cases/validation/dry_powder_brakes.csv (its sources are in its head) and the rows of powder_clutch in
docs/measured.csv, and writes the tables between the marks of docs/explanation/dry_brakes.md. Run it again when rows of
the table of record have changed.

Exponents d ln T/d ln I are least squares in ln T over ln I, with a standard error from the points' errors or from their
scatter about the power law, whichever is larger. A point is taken to be known to 2 % (the same curves typed twice) and
to 0.002 of the rated torque (the last digit of the smallest torques).
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

from emclutch.results.fits import NORMAL, power_law
from emclutch.results.linear_range import linear_range
from emclutch.results.measured_table import read_measured
from emclutch.results.pictures import torque_against_current_picture
from emclutch.results.torque_curves import TorqueCurve

sys.path.append(str(Path(__file__).resolve().parents[1] / "project"))  # the table of record
from measured import ROOT, table

DATA = ROOT / "cases" / "validation" / "dry_powder_brakes.csv"
PAGE = ROOT / "docs" / "explanation" / "dry_brakes.md"
RATED = 0.94  # [A] of brakes of 12 N m, tests/REFERENCE.md section 6
RANGES = ((0.1, 0.4), (0.4, 0.6), (0.6, 0.9))  # of the rated current
SHARES = (0.1, 0.2, 0.3, 0.5, 0.8)
MARKS = "<!-- tables by tests/benchmarks/dry_brakes.py -->", "<!-- end of tables -->"
ROW = re.compile(r"powder_clutch\.torque_([\d.]+)A")


def brakes() -> dict[str, np.ndarray]:
    """Branches of the measured brakes: name -> (n, 2) current and torque over the rated ones."""
    return read_measured(DATA, "current over rated", "torque over rated")


def errors(torque: np.ndarray) -> np.ndarray:
    """Standard errors of measured torques (n,), all over the rated torque."""
    return np.hypot(0.02 * torque, 0.002)


def exponent(branch: np.ndarray, low: float, high: float) -> tuple[float, float] | None:
    """d ln T/d ln I between two currents with its standard error; None where the points do not span them."""
    x, torque = branch[(branch[:, 0] > low - 0.011) & (branch[:, 0] < high + 0.011)].T
    law = power_law(x, torque, errors(torque))
    return None if law is None or x[-1] < low + 0.6 * (high - low) else (law[1].value, law[1].error)


def ours() -> list[TorqueCurve]:
    """Curves of the table of record over their points at the rated current."""
    return [curve.over_rated(RATED) for curve in recorded_curves()]


def recorded_curves() -> list[TorqueCurve]:
    """The curve of the table of record, in a list."""
    rows = sorted(
        (float(found[1]), float(row["value"]), 0.5 * (float(row["high"]) - float(row["low"])) / NORMAL)
        for name, row in table().items() if (found := ROW.fullmatch(name))
    )  # fmt: skip
    current, torque, error = np.array(rows).T
    converged = np.full(len(rows), False)  # one replica, and still drifting
    return [TorqueCurve({"emclutch:": "one replica, eight grains per gap"}, current, torque, error, converged)]


def tables() -> str:
    """The page's tables."""
    measured = brakes()
    lines = [
        "Exponent d ln T/d ln I, and the straight part T = slope (I - offset), currents over the rated one "
        "(± one standard error):",
        "",
        "| branch | "
        + " | ".join(f"{100 * low:.0f} to {100 * high:.0f} %" for low, high in RANGES)
        + " | straight part | offset |",
        "|---" * (len(RANGES) + 3) + "|",
    ]
    for name, branch in measured.items():
        found = [exponent(branch, *part) for part in RANGES]
        cells = ["" if one is None else f"{one[0]:.2f} ± {one[1]:.2f}" for one in found]
        line = linear_range(*branch.T, errors(branch[:, 1]))
        cells += [f"{line.first:.2f} to {line.last:.2f}", f"{line.offset:.2f} ± {line.offset_error:.2f}"]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    lines += ["", "Torque of the falling branch over that of the rising one:", ""]
    lines += [
        "| brake | " + " | ".join(f"{100 * share:.0f} %" for share in SHARES) + " |",
        "|---" * (len(SHARES) + 1) + "|",
    ]
    for brake in ("B15", "B5Z"):
        rising, falling = (np.interp(SHARES, *measured[f"{brake} {way}"].T) for way in ("rising", "falling"))
        lines.append(f"| {brake} | " + " | ".join(f"{ratio:.2f}" for ratio in falling / rising) + " |")
    lines += [
        "",
        "Torque over that at the rated current (± half of the 95 % interval; brakes: between their points):",
        "",
    ]
    names = [name for name in measured if not name.startswith("B5ZD")]
    lines += ["| current | emclutch | " + " | ".join(names) + " |", "|---" * (len(names) + 2) + "|"]
    for curve in ours():
        for x, torque, error in zip(curve.x, curve.torque, curve.error, strict=True):
            if x < 1.0:
                cells = [f"{np.interp(x, *measured[name].T):.3f}" for name in names]
                lines.append(f"| {x:.3f} | {torque:.3f} ± {NORMAL * error:.3f} | {' | '.join(cells)} |")
    return "\n".join(lines)


def page_with(text: str, of_tables: str) -> str:
    """Text of the page with other tables between its marks."""
    before, _, rest = text.partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    return f"{before}{MARKS[0]}\n\n{of_tables}\n\n{MARKS[1]}{after}"


if __name__ == "__main__":
    title = (
        "Dry powder brakes (B15, B5Z: maker's curves; B5ZD: measured on a bench) and cases/powder_clutch.toml at "
        f"{RATED:g} A"
    )
    torque_against_current_picture(sys.argv[1], ours(), measured=brakes(), over_rated=True, title=title)
    PAGE.write_text(page_with(PAGE.read_text(encoding="utf-8"), tables()), encoding="utf-8")
    print(tables())
