"""A decision for a run: its text, and what is doubtful about it as data."""

from __future__ import annotations

from collections.abc import Mapping


class Decision(str):
    """What was decided and why.

    Attributes
    ----------
    warnings : tuple of str
        What is doubtful about it; empty where nothing is.
    """

    warnings: tuple[str, ...]

    def __new__(cls, text: str, *warnings: str) -> Decision:
        found = super().__new__(cls, text)
        found.warnings = tuple(warning for warning in warnings if warning)
        return found


def warnings_of(decisions: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the warnings of decisions by their labels; of those that have any."""
    found = {label: list(getattr(text, "warnings", ())) for label, text in decisions.items()}
    return {label: texts for label, texts in found.items() if texts}
