"""Torque against current of cases/powder_clutch.toml: law of the powder, its runs, and measured dry powder brakes.

    python tests/benchmarks/dry_brakes.py docs/dry_brakes.png

maps the torque of the brake into docs/brake_map.csv (half a minute), draws it with the rows of powder_clutch in
docs/measured.csv and the brakes of cases/validation/dry_powder_brakes.csv (its sources are in its head), and writes the
tables between the marks of docs/explanation/dry_brakes.md and docs/explanation/brake.md; the latter has the runs of
other powders in docs/two_scales.csv. Run it again when the law or one of these tables has changed.

Exponents d ln T/d ln I are least squares in ln T over ln I, with a standard error from the points' errors or from their
scatter about the power law, whichever is larger. A point is taken to be known to 2 % (the same curves typed twice) and
to 0.002 of the rated torque (the last digit of the smallest torques).
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas
from two_scales import misfit, read_rows

import emclutch
from emclutch.device_model.grain_size import COEFFICIENT, EXPONENT
from emclutch.results.fits import NORMAL, power_law
from emclutch.results.linear_range import linear_range
from emclutch.results.measured_table import read_measured
from emclutch.results.pictures.figure import COLOURS, draw_measured, legend_below, new_figure, save_picture
from emclutch.results.pictures.torque_map import BandedCurve

sys.path.append(str(Path(__file__).resolve().parents[1] / "project"))  # the table of record
from measured import ROOT, table

DATA = ROOT / "cases" / "validation" / "dry_powder_brakes.csv"
CASE = ROOT / "cases" / "powder_clutch.toml"
MAP = ROOT / "docs" / "brake_map.csv"
PAGE, BRAKE_PAGE = (ROOT / "docs" / "explanation" / f"{name}.md" for name in ("dry_brakes", "brake"))
CURRENTS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.94, 1.1, 1.3)  # [A]
COARSE, REAL = 8.0, 1.0 / 0.06  # grains per gap of the runs and of the powder
RATED = 0.94  # [A] of brakes of 12 N m, tests/REFERENCE.md section 6
RANGES = ((0.1, 0.4), (0.4, 0.6), (0.6, 0.9))  # of the rated current
SHARES = (0.1, 0.2, 0.3, 0.5, 0.8)
SHOWN = (0.1, 0.2, 0.4, 0.6, 0.8)  # [A]
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


def law() -> pandas.DataFrame:
    """Return the map of the brake over the current [A]: torque, low, high, ranges of unknown powder [N m], is_guess."""
    return pandas.read_csv(MAP).set_index("coil.current")


def of_law() -> np.ndarray:
    """Current and torque of the map to the rated current, over the rated ones, (n, 2)."""
    torque = law()["torque"][:RATED]
    return np.column_stack([torque.index / RATED, torque / torque[RATED]])


def runs() -> np.ndarray:
    """Current [A], torque and standard error [N m] of the runs of the table of record, brought to the real grains.

    They have 8 grains per gap: T(n) = T_inf (1 + a/n^2), emclutch/device_model/grain_size.py.
    """
    rows = sorted(
        (float(found[1]), float(row["value"]), 0.5 * (float(row["high"]) - float(row["low"])) / NORMAL)
        for name, row in table().items() if (found := ROW.fullmatch(name))
    )  # fmt: skip
    size = (1.0 + COEFFICIENT[0] * REAL**-EXPONENT) / (1.0 + COEFFICIENT[0] * COARSE**-EXPONENT)
    return np.array(rows) * [1.0, size, size]


def tables() -> str:
    """The page's tables."""
    measured = brakes()
    lines = [
        "The exponent is d ln T/d ln I. The straight part is T = slope (I - offset). Currents are divided by the rated "
        "current.",
        "± is one standard error of the fit:",
        "",
        "| branch | "
        + " | ".join(f"{100 * low:.0f} to {100 * high:.0f} %" for low, high in RANGES)
        + " | straight part | offset |",
        "|---" * (len(RANGES) + 3) + "|",
    ]
    for name, branch in (measured | {"law of the powder": of_law()}).items():
        found = [exponent(branch, *part) for part in RANGES]
        cells = ["" if one is None else f"{one[0]:.2f} ± {one[1]:.2f}" for one in found]
        line = linear_range(*branch.T, errors(branch[:, 1]))
        cells += [f"{line.first:.2f} to {line.last:.2f}", f"{line.offset:.2f} ± {line.offset_error:.2f}"]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    lines += ["", "Torque of the falling branch divided by that of the rising branch:", ""]
    lines += [
        "| brake | " + " | ".join(f"{100 * share:.0f} %" for share in SHARES) + " |",
        "|---" * (len(SHARES) + 1) + "|",
    ]
    for brake in ("B15", "B5Z"):
        rising, falling = (np.interp(SHARES, *measured[f"{brake} {way}"].T) for way in ("rising", "falling"))
        lines.append(f"| {brake} | " + " | ".join(f"{ratio:.2f}" for ratio in falling / rising) + " |")
    names = [name for name in measured if not name.startswith("B5ZD")]
    head = ["current / rated", "law of the powder", "runs", *names]
    lines += ["", "Torque divided by that at the rated current. The brakes are interpolated:", ""]
    lines += ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    torque, (current, of_run, _) = dict(of_law()), runs().T
    rated = of_run[current == RATED].item()
    for at in SHOWN:
        ran = of_run[current == at] / rated
        cells = [f"{torque[at / RATED]:.3f}", *(f"{one:.3f}" for one in ran), *[""] * (1 - len(ran))]
        cells += [f"{np.interp(at / RATED, *measured[name].T):.3f}" for name in names]
        lines.append(f"| {at / RATED:.3f} | {' | '.join(cells)} |")
    return "\n".join(lines)


def brake_tables() -> tuple[str, str]:
    """The tables of the brake's page: the map, and runs of other powders beside the law of their grains."""
    found = law().loc[[0.2, 0.4, 0.6, RATED, 1.3]]
    rows = [
        ("current [A]", [f"{at:g}" for at in found.index]),
        ("torque [N m]", [f"{torque:.1f}" for torque in found["torque"]]),
        ("its 95 % interval", [f"{row.low:.1f} to {row.high:.1f}" for row in found.itertuples()]),
        ("friction and fill unknown, 90 % range",
         [f"{row.unknown_low:.1f} to {row.unknown_high:.1f}" for row in found.itertuples()]),
    ]  # fmt: skip
    lines = [f"| {name} | {' | '.join(cells)} |" for name, cells in rows]
    lines.insert(1, "|---" * (len(found) + 1) + "|")
    others = ["| friction | rolling friction | fill | run [N m] | law [N m] | its 95 % interval | run/law |"]
    others.append("|---" * 7 + "|")
    for row in other_powders():
        (miss,), _, (half,) = misfit([row])
        run, expected = (f"{float(row[name]):.1f}" for name in ("torque", "predicted"))
        error = "guess, factor of 2" if row["guess"] else f"± {100.0 * np.expm1(NORMAL * half):.0f} %"
        powder = " | ".join(f"{float(row[name]):.2f}" for name in ("friction", "rolling_friction", "fill"))
        others.append(f"| {powder} | {run} | {expected} | {error} | {np.exp(miss):.2f} |")
    return "\n".join(lines), "\n".join(others)


def other_powders() -> list[dict[str, str]]:
    """Rows of docs/two_scales.csv of the brake with powders other than the scene's, by the torque."""
    rows = [row for row in read_rows(ROOT / "docs" / "two_scales.csv") if row["use"] == "brake"]
    others = [row for row in rows if (row["friction"], row["rolling_friction"]) != ("0.3", "0.2")]
    return sorted(others, key=lambda row: float(row["torque"]))


def page_with(text: str, *blocks: str) -> str:
    """Text of the page with other tables, a block between each pair of its marks."""
    done = ""
    for block in blocks:
        before, _, rest = text.partition(MARKS[0])
        _, _, text = rest.partition(MARKS[1])
        done += f"{before}{MARKS[0]}\n\n{block}\n\n{MARKS[1]}"
    return done + text


def draw(path: Path) -> None:
    """Draw the map with runs, and the brakes scaled to its torque at the rated current."""
    found, (current, torque, error) = law(), runs().T
    title = "Torque against current, brake of the 12 N m class"
    figure, (axis,) = new_figure(8.0, 6.6, title)
    columns = [found[list(names)].to_numpy() for names in (("torque", "low", "high"), ("unknown_low", "unknown_high"))]
    x, is_guess = found.index.to_numpy(), found.is_guess.to_numpy()
    curve = BandedCurve("expected torque", x, columns[0], is_guess, columns[1], np.full(len(x), np.nan))
    curve.draw(axis, COLOURS[0], "-", "95 % interval", "a guess within a factor of 2")
    axis.errorbar(current, torque, NORMAL * error, fmt="D", ms=5.5, capsize=3, color=COLOURS[1], zorder=3,
                  label="runs of 8 grains per gap, corrected to 60 µm")  # fmt: skip
    rated = found.torque[RATED]
    draw_measured(axis, brakes(), per_x=RATED, per_y=rated, joined=True)
    axis.set(xlabel="coil current [A]", ylabel="torque [N m]", xlim=(0.0, CURRENTS[-1]), ylim=(0.0, None))
    top = axis.secondary_xaxis("top", functions=(lambda current: current / RATED, lambda x: x * RATED))
    right = axis.secondary_yaxis("right", functions=(lambda torque: torque / rated, lambda y: y * rated))
    top.set_xlabel("current over rated current")
    right.set_ylabel("torque over torque at rated current")
    axis.grid(alpha=0.25)
    legend_below(axis, 2)
    save_picture(figure, path)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        mapped = emclutch.map(CASE, current=CURRENTS, out=Path(folder) / "map")
    pandas.DataFrame(mapped.rows).drop(columns="remark").to_csv(MAP, index=False, float_format="%.4g")
    draw(Path(sys.argv[1]))
    for page, blocks in ((PAGE, (tables(),)), (BRAKE_PAGE, brake_tables())):
        page.write_text(page_with(page.read_text(encoding="utf-8"), *blocks), encoding="utf-8")
