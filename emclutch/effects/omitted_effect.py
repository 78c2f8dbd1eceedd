"""An effect that a scene omits, with the criterion of its significance."""

from __future__ import annotations

from dataclasses import dataclass

from emclutch.scene.units import format_number

OFF, ABSENT, ALWAYS = "off", "not in this program", "in every scene"
AT_LIMIT = 0.1
"""Relative change of the steady torque at an effect's limit, a guess by the order of magnitude, not measured."""


@dataclass(frozen=True, slots=True)
class OmittedEffect:
    """An omitted effect and its significance.

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
        True if the effect is significant below the limit, not above.
    note : str
        What else there is to say.
    change : float or None
        Relative change of the steady torque at the limit, by the order of magnitude; None where that is not estimated,
        as of what changes transients only.
    in_operation : str
        Consequence for continuous operation, which a run is too short for; empty where there is none.
    """

    effect: str
    where: str
    number: str
    value: float | None = None
    limit: float | None = None
    below: bool = False
    note: str = ""
    change: float | None = AT_LIMIT
    in_operation: str = ""

    @property
    def is_significant(self) -> bool | None:
        """True if the value passes its limit; None if unknown."""
        if self.value is None or self.limit is None:
            return None
        return self.value < self.limit if self.below else self.value > self.limit

    @property
    def is_reservation(self) -> bool:
        """True if it is significant and the scene or a later version could include it."""
        return bool(self.is_significant) and self.where != ALWAYS

    @property
    def verdict(self) -> str:
        """`is_significant` in a word."""
        if self.where == ALWAYS:
            return "always included"
        return {True: "YES", False: "no", None: "not known"}[self.is_significant]

    @property
    def on_torque(self) -> str:
        """Say what it does to the torque, by the order of magnitude: `change` at its limit, and in proportion."""
        if self.where == ALWAYS:
            return ""
        if self.change is None:
            return "not estimated"
        if self.value is None or not self.limit:
            return "not known"
        near = self.limit / self.value if self.below and self.value else self.value / self.limit
        if self.is_significant:
            return f"{100.0 * self.change:g} % or more"
        share = 100.0 * self.change * near
        return f"{share:.1g} %" if share >= 0.1 else "below 0.1 %"

    def in_words(self) -> str:
        """Return the number, its limit and the note."""
        text = self.number
        if self.value is not None:
            text += f": {format_number(self.value)}"
        if self.value is not None and self.limit is not None:
            text += f" (relevant {'below' if self.below else 'above'} {self.limit:g})"
        return "; ".join(filter(None, (text, self.note)))

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {"effect": self.effect, "where": self.where, "significant": self.is_significant, "number": self.number,
                "value": self.value, "limit": self.limit, "on_torque": self.on_torque, "note": self.note,
                "in_operation": self.in_operation}  # fmt: skip
