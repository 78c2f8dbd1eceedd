"""What each effect adds: torque and processor time of a scene without it."""

from __future__ import annotations

from pathlib import Path

from emclutch.results.effect_contributions import Contributions, Without
from emclutch.results.pictures.figure import label_panel, new_figure, save_picture
from emclutch.results.text import format_percent

WHOLE, SIGNIFICANT, NOT_SIGNIFICANT = "black", "#0b5fa5", "0.55"
TIME = "#c4540a"


def effects_picture(path: str | Path, found: Contributions, *, title: str | None = None) -> Path:
    """Draw the torque with its 95 % interval, and the processor time of a replica, a row for each effect left out.

    Parameters
    ----------
    path : PNG to write.
    found : replicas; effects that cannot be left out have a row without a mark.
    """
    rows = [found.whole, *found.without]
    figure, (torque, time) = new_figure(
        11.0, 1.6 + 0.48 * len(rows), title, columns=2, width_ratios=(1.5, 1.0), sharey=True
    )
    whole = found.whole.torque
    assert whole is not None
    torque.axvspan(*whole.interval(), color="black", alpha=0.1, lw=0.0)
    torque.axvline(whole.value, color="black", lw=0.8, ls=":")
    for place, one in enumerate(rows):
        _draw_row(torque, time, found, one, place)
    torque.set_yticks(range(len(rows)), [_label(one) for one in rows], fontsize=9)
    torque.set_ylim(len(rows) - 0.4, -0.6)
    torque.axhline(0.5, color="black", lw=0.6)
    time.axhline(0.5, color="black", lw=0.6)
    low, high = torque.get_xlim()
    torque.set_xlim(min(low, 0.0), high)
    torque.set_xlabel("torque on the disc [N m]")
    time.set_xlabel("processor time of a replica [s]")
    time.set_xlim(0.0, time.get_xlim()[1] * 1.2)  # room for the text beside the bars
    for axis in (torque, time):
        axis.grid(axis="x", alpha=0.25)
    label_panel(torque, "Torque, 95 % interval (hollow: difference not significant)")
    label_panel(time, "Cost, and what the effect adds to it")
    return save_picture(figure, path)


def _draw_row(torque, time, found: Contributions, one: Without, place: int) -> None:
    """Draw one scene: its torque to the left, its cost to the right."""
    mean = one.torque
    if mean is None:
        torque.annotate("cannot be left out", (0.02, place), xycoords=torque.get_yaxis_transform(), fontsize=8,
                        color=NOT_SIGNIFICANT, va="center", style="italic")  # fmt: skip
        return
    added = None if one is found.whole else found.torque(one)
    significant = added is None or added.is_significant()
    colour = WHOLE if added is None else SIGNIFICANT if significant else NOT_SIGNIFICANT
    torque.errorbar(mean.value, place, xerr=mean.half_width(), fmt="o", ms=7, capsize=4, lw=1.6, color=colour,
                    mfc=colour if significant else "white")  # fmt: skip
    time.barh(place, one.seconds, height=0.55, color=WHOLE if added is None else TIME, alpha=0.8)
    text = f"{one.seconds:.3g} s"
    if added is not None:
        share = (found.whole.seconds - one.seconds) / found.whole.seconds
        text = f"{'+' if share >= 0.0 else '-'}{format_percent(abs(share))}"
    time.annotate(text, (one.seconds, place), xytext=(4, 0), textcoords="offset points", va="center", fontsize=9)


def _label(one: Without) -> str:
    """Return the row's name; what goes with an effect stands in a line of its own."""
    if not one.effect:
        return "the whole scene"
    others = f"\n(nor {', '.join(one.others)})" if one.others else ""
    return f"without {one.effect}{others}".replace("_", " ")
