"""Profiles across the gap: fill, flow, stress, torque, and mu against the inertial number."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.pictures.figure import BODY_COLOURS, MM, new_figure, save_picture

if TYPE_CHECKING:
    from particles.diagnostics.profiles import Profile

GRAINS = "#2a8c3f"


def profile_picture(path: str | Path, profiles: Sequence[Profile], *, title: str | None = None) -> Path:
    """Draw six panels a profile, two rows of three, one profile below the other."""
    figure, axes = new_figure(11.0, 5.6 * len(profiles), title, rows=2 * len(profiles), columns=3)
    for profile, rows in zip(profiles, axes.reshape(len(profiles), 6), strict=True):
        _draw(rows, profile)
    return save_picture(figure, path)


def _draw(axes: Any, profile: Profile) -> None:
    fill, flow, heat, stress, torque, law = axes
    edges = MM * np.append(profile.low, profile.high[-1])
    s = MM * profile.position
    is_ring = bool(np.any(np.isfinite(profile.angular_speed)))

    fill.stairs(profile.solid_fraction, edges, fill=True, color=GRAINS, alpha=0.5)
    fill.set_ylabel("solid fraction")
    fill.set_ylim(0.0, max(0.7, 1.1 * float(np.max(profile.solid_fraction))))
    fill.set_title(f"across {profile.along}, mean of {profile.moments} moments", loc="left", fontsize=9)

    flow.plot(s, profile.velocity, "o-", ms=3, color=GRAINS, label="grains")
    for body, slip in profile.slip.items():
        flow.plot(s, profile.velocity - slip, "--", lw=1.2, color=BODY_COLOURS.get(body), label=body)
    flow.set_ylabel("velocity along the flow [m/s]")
    _legend_above(flow)

    heat.plot(s, profile.shear_rate, "o-", ms=3, color="#8a1c7c")
    heat.set_ylabel("shear rate [1/s]", color="#8a1c7c")
    right = heat.twinx()
    right.plot(s, np.sqrt(profile.temperature), "s-", ms=3, color="#c4540a")
    right.set_ylabel("velocity fluctuation [m/s]", color="#c4540a")
    right.set_ylim(bottom=0.0)

    unit, factor = _scaled(np.concatenate([profile.pressure, profile.shear_stress]), "Pa")
    for values, label, colour in (
        (profile.pressure, "pressure", "black"),
        (profile.normal_stress, "normal, across", "#6a6a6a"),
        (profile.shear_stress, "shear", "#c4540a"),
    ):
        stress.plot(s, factor * values, "o-", ms=3, color=colour, label=label)
    stress.axhline(0.0, color="black", lw=0.6)
    stress.set_ylabel(f"stress [{unit}]")
    _legend_above(stress)

    unit, factor = _scaled(profile.torque, "N m" if is_ring else "N")
    torque.stairs(factor * profile.torque, edges, baseline=None, color="#0b5fa5", lw=1.5)
    torque.axhline(0.0, color="black", lw=0.6)
    torque.set_ylabel(f"{'torque' if is_ring else 'shear force'} through contacts [{unit}]")
    for axis in (fill, flow, heat, stress, torque):
        axis.set_xlabel(f"{profile.along} [mm]")
        axis.set_xlim(edges[0], edges[-1])

    moving = (profile.inertial_number > 0.0) & (profile.mu > 0.0)
    if moving.any():
        dots = law.scatter(profile.inertial_number[moving], profile.mu[moving], c=s[moving], cmap="cividis", s=18)
        law.figure.colorbar(dots, ax=law, label=f"{profile.along} [mm]")
        law.set_xscale("log")
        law.set_ylim(bottom=0.0)
    law.set_xlabel("inertial number I")
    law.set_ylabel("mu = |tau|/p")


def _legend_above(axis: Any) -> None:
    axis.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, fontsize=8, borderaxespad=0.0,
        columnspacing=1.0, handlelength=1.4,
    )  # fmt: skip


def _scaled(values: np.ndarray, unit: str) -> tuple[str, float]:
    """Unit with a prefix, and the factor, in which the largest value is a handy number."""
    largest = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
    for prefix, factor in (("k", 1e-3), ("", 1.0), ("m", 1e3)):
        if largest * factor >= 1.0 or (prefix == "" and largest == 0.0):
            return prefix + unit, factor
    return "µ" + unit, 1e6
