"""One effect that a scene leaves out, and the number that says whether it matters."""

from __future__ import annotations

from dataclasses import dataclass

from emclutch.scene.units import two_digits

OFF, ABSENT, ALWAYS = "off", "not in this program", "in every scene"
AT_LIMIT = 0.1
"""Relative change of the steady torque at an effect's limit, a guess by the order of magnitude, not measured."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """One effect, and whether it matters.

    Attributes
    ----------
    effect : str
        Its name.
    where : str
        Switched off in the scene, not in this program, or in every scene.
    number : str
        What is compared.
    value, limit : float or None
        The number and the one it is compared with; None where the plan does not know it.
    below : bool
        Whether the effect matters below the limit, and not above.
    note : str
        What else there is to say.
    change : float or None
        Relative change of the steady torque at the limit, by the order of magnitude; None where that is not estimated,
        as of what changes transients only.
    """

    effect: str
    where: str
    number: str
    value: float | None = None
    limit: float | None = None
    below: bool = False
    note: str = ""
    change: float | None = AT_LIMIT

    @property
    def matters(self) -> bool | None:
        """None where the plan cannot tell."""
        if self.value is None or self.limit is None:
            return None
        return self.value < self.limit if self.below else self.value > self.limit

    @property
    def is_reservation(self) -> bool:
        """Whether it matters and a scene could have it, or a later version."""
        return bool(self.matters) and self.where != ALWAYS

    @property
    def verdict(self) -> str:
        """Of `matters`, in a word."""
        return {True: "YES", False: "no", None: "not known"}[self.matters]

    @property
    def on_torque(self) -> str:
        """Say what it does to the torque, by the order of magnitude: `change` at its limit, and in proportion."""
        if self.where == ALWAYS:
            return "included"
        if self.change is None:
            return "not estimated"
        if self.value is None or not self.limit:
            return "not known"
        near = self.limit / self.value if self.below and self.value else self.value / self.limit
        if self.matters:
            return f"{100.0 * self.change:g} % or more"
        share = 100.0 * self.change * near
        return f"{share:.1g} %" if share >= 0.1 else "below 0.1 %"

    def in_words(self) -> str:
        """Number, limit and note."""
        text = self.number
        if self.value is not None:
            text += f": {two_digits(self.value)}"
        if self.value is not None and self.limit is not None:
            text += f" ({'below' if self.below else 'above'} {self.limit:g})"
        return "; ".join(filter(None, (text, self.note)))

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {"effect": self.effect, "where": self.where, "matters": self.matters, "number": self.number,
                "value": self.value, "limit": self.limit, "on_torque": self.on_torque, "note": self.note}  # fmt: skip
