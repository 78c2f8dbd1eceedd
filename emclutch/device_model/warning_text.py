"""A line of a plan that holds warnings: text, and the fact that it warns as data."""

from __future__ import annotations


class WarningText(str):
    """Text with at least one warning in it."""

    __slots__ = ()


def with_warnings(text: str, *warnings: str) -> str:
    """Append warnings, each marked; a `WarningText` where there is one, else the text as it is."""
    if not any(warnings):
        return text
    before = [text] if text else []
    return WarningText("; ".join([*before, *(f"WARNING: {warning}" for warning in warnings if warning)]))
