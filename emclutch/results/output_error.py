"""What goes wrong when results are written or read: always with the path and a remedy."""

from __future__ import annotations


class OutputError(Exception):
    """A run's folder cannot be written, read or resumed; the message names the path and the remedy."""
