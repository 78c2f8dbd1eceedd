"""`emclutch report`: a run as a page of Markdown, from its summary."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

from emclutch.results import COLUMNS, OutputError, Result
from emclutch.results.columns import DISC_SPEED, ROTOR_SPEED, TORQUE_DISC
from emclutch.results.failure import Failure
from emclutch.results.grain_profiles import profile_column, read_profiles
from emclutch.results.torque_in_words import torque_in_words
from particles.dem.overlap_limits import SOFT

RPM = 30.0 / math.pi
PICTURES = {
    "section.png": "flux density and flux lines in the cross-section",
    "gap.png": "radial flux density in the middle of the gap, unrolled",
    "torque.png": "torque against time",
    "speeds.png": "speeds of the shafts against time",
    "grains.png": "grains and the forces between them",
    "profiles.png": "flow and stress across the gap",
}
"""Pictures that a run may have, and what they show."""


def closing_lines(result: Result) -> list[str]:
    """Return the last lines of a run: lock-up, target precision, warnings."""
    summary, lines = result.summary, []
    if "stopped" in summary:
        lines.append(f"stopped {summary['stopped']}")
    if "lock_up_time" in summary:
        history = result.history
        rotor, disc = (abs(float(history[name].iloc[-1])) * RPM for name in (ROTOR_SPEED, DISC_SPEED))
        if summary["lock_up_time"] is not None:
            lines.append(f"output locked at {summary['lock_up_time']:.4g} s, at {disc:.4g} rpm at the end")
        else:
            lines.append(f"output not locked: {disc:.4g} rpm at the end, the motor {rotor:.4g} rpm")
    if until := summary.get("until"):
        lines.append(
            f"target precision reached ({until['asked']}) at t = {summary['time']:.4g} s"
            if until["reached"]
            else f"target precision not reached ({until['asked']})"
            + (f": {until['reason']}" if until["reason"] != summary["torque"]["reason"] else "")
        )
    if "grain_size_note" in summary:
        lines.append(summary["grain_size_note"])
    lines += [f"warning: {text}" for text in (summary.get("solver") or {}).get("warnings", ())]
    warning = soft_grains(summary)
    return lines + ([f"warning: {warning}"] if warning else [])


def soft_grains(summary: dict[str, Any]) -> str:
    """A warning where grains that press in overlapped too much; else empty."""
    overlap = summary.get("max_overlap") or 0.0
    # summaries of earlier versions do not say; those of DVI, rigid or not, are known by their solver
    contact = summary.get("contact") or {"compliant": "solver" not in summary}
    if not contact["compliant"] or overlap <= SOFT:
        return ""
    return (
        f"the largest overlap is {100 * overlap:.2g} % of the diameter: grains too soft; torque peaks are not to be "
        "trusted"
    )


STRUCTURE = {
    "coordination": "contacts a grain, walls included",
    "rattlers": "share of grains with fewer than two contacts",
    "fabric_anisotropy": "anisotropy of the contacts' directions (0 none, 1 all parallel)",
    "force_anisotropy": "the same, weighed by normal force",
    "in_chains": "share of grains in force chains",
    "longest_chain": "grains in the longest force chain",
}


def report(result: Result, page_folder: Path | None = None) -> str:
    """Markdown of a run: torque with its error, device, numerics, balances, cost.

    `page_folder` is where the page will lie, from which its links count; default: the run's folder.
    """
    summary = result.summary
    if not summary and (failed := result.folder.read_failure()) is not None:
        return _failed_page(result, failed)
    if not summary:
        raise OutputError(
            f"{result.folder.path} has no summary.json: the run is not finished; continue it with --resume"
        )
    lines = [f"# {summary['title']}", ""]
    if TORQUE_DISC in result.history:
        torque = result.torque
        lines += [f"**Torque on the disc: {torque_in_words(torque)}**; {torque.reason}.", ""]
        if torque.mean is not None:
            packings = "one packing: what packings differ by is not in it"
            lines += [f"Of {f'{torque.replicas} packings' if torque.replicas > 1 else packings}.", ""]
    lines += [f"**{line[:1].upper()}{line[1:]}.**\n" for line in closing_lines(result)]
    rows = [("effects", ", ".join(summary["effects"]) or "none"), *summary_rows(summary)]
    for part, value in summary["seconds"].items():
        if part == "predicted":
            rows.append(("wall-clock predicted", f"{value['total']:.1f} s"))
        else:
            rows.append((f"wall-clock: {part.replace('_', ' ')}", f"{value:.1f} s"))
    lines += ["| | |", "|---|---|", *(f"| {label} | {text} |" for label, text in rows), "", "## Decisions", ""]
    lines += [f"- {label}: {text}" for label, text in summary["plan"].items()]
    home = result.folder.path.resolve()
    way = Path(os.path.relpath(home, (page_folder or home).resolve()))
    pictures = [name for name in PICTURES if (home / name).is_file()]
    lines += [
        "",
        *(f"![{name}]({quote((way / name).as_posix())})" for name in pictures),
        "",
        "## Columns of history.csv",
        "",
    ]
    lines += [f"- `{name}` [{COLUMNS[name].unit}]: {COLUMNS[name].meaning}" for name in result.history.columns]
    if (home / "profiles.csv").is_file():
        columns = list(dict.fromkeys(name for table in read_profiles(home / "profiles.csv").values() for name in table))
        lines += ["", "## Columns of profiles.csv", ""]
        lines += [f"- `{name}` [{profile_column(name)[0]}]: {profile_column(name)[1]}" for name in columns]
    return "\n".join(lines) + "\n"


def _failed_page(result: Result, failed: Failure) -> str:
    """Markdown of a run that failed for its scene: when, why, and the torque until then."""
    text = failed.in_words()
    lines = [f"# {result.folder.path.resolve().name}", "", f"**{text[:1].upper()}{text[1:]}.**", ""]
    if TORQUE_DISC in result.history:
        torque = result.torque
        lines += [f"Torque on the disc until then: {torque_in_words(torque)}; {torque.reason}.", ""]
    return "\n".join(lines)


def summary_rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Return rows of device, course and numerics of a summary: label and value with its unit."""
    rows: list[tuple[str, str]] = []
    for key, label, unit in (
        ("current", "current at the end", "A"),
        ("turns", "turns of the coil", ""),
        ("gap_flux_density", "mean flux density under the poles", "T"),
        ("flux_linkage", "flux linkage", "Wb"),
        ("lock_up_time", "lock-up time", "s"),
        ("current_rise_time", "current's rise to 63 % of its final value", "s"),
        ("gap_flux_density_rise_time", "gap field's rise to 63 % of its final value", "s"),
        ("torque_rise_time", "torque's rise to 63 % of its final value", "s"),
        ("torque_rise_time_90", "torque's rise to 90 % of its final value", "s"),
        ("torque_lag", "torque's rise over the current's, 63 % (class: 1.7 to 4)", ""),
        ("inertial_number", "inertial number (upper bound)", ""),
        ("grains", "grains simulated", ""),
        ("sectors", "sectors in the ring", ""),
        ("dt", "step of the grains", "s"),
        ("time", "simulated time", "s"),
        ("max_overlap", "largest overlap over diameter, at any time", ""),
        ("typical_overlap", "the same, median over the windows of the second half", ""),
        ("torque_residual_rms", "torque balance, RMS of what is left", "N m"),
        ("energy_residual_relative", "energy balance, what is left over throughput", ""),
    ):
        if summary.get(key) is not None:
            rows.append((label, f"{summary[key]:.5g} {unit}".strip()))
    rows += [
        (f"at the end: {label}", f"{summary['structure'][key]:.3g}")
        for key, label in STRUCTURE.items()
        if summary.get("structure", {}).get(key) is not None  # a summary of an earlier version has none
    ]
    for key, label in (("current", "current"), ("gap_flux_density", "gap field")):
        if note := summary.get(f"{key}_rise_time_note"):
            rows.append((f"{label}'s rise", f"not over: {note}"))
    rows += [
        (f"estimated relative error of the field: {goal}", f"{error:.2g}")
        for goal, error in (summary.get("field_error_estimate") or {}).items()
    ]
    return rows
