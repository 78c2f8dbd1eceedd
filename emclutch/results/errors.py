"""Errors of a run and of what it writes; each message names the remedy."""

from __future__ import annotations


class OutputError(Exception):
    """A file or the folder of a run cannot be read, written or resumed."""


class RunError(RuntimeError):
    """A run failed: a solver did not converge, grains do not fit, memory is too small."""


class Interrupted(RunError):
    """The user stopped the run; a checkpoint lies in its folder."""
