"""Errors of a run and of what it writes; each message names the remedy."""

from __future__ import annotations


class OutputError(Exception):
    """A run's folder cannot be written, read or resumed."""


class RunError(RuntimeError):
    """The run failed for a reason of physics or numerics."""


class Interrupted(RunError):
    """The user stopped the run; a checkpoint lies in its folder."""
