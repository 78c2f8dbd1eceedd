"""Accuracy study: the ladder of a scene's knobs within a budget, and the settings for wanted accuracies."""

from __future__ import annotations

from pathlib import Path

from emclutch.scene.case import Case


def accuracy(case: Case, *, out: str | Path | None = None, threads: int | None = None, progress=None) -> Path:
    """Measure the ladder of a scene (being written)."""
    raise NotImplementedError
