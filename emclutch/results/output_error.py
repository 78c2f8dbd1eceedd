"""Error of writing or reading results, with the path and a remedy."""

from __future__ import annotations


class OutputError(Exception):
    """A run's folder cannot be written, read or resumed; the message names the path and the remedy."""
