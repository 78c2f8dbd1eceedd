"""A finished run of a hard scene, in memory: what the invariants look at, and what a test may spoil on purpose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas

from emclutch.results import load_result
from emclutch.results.checkpoint import read_checkpoint
from emclutch.scene.case import Case
from geometry.box import Box
from geometry.triangle_wall import TriangleWall
from particles import CyclicSector
from particles.packing.space import Space


@dataclass(slots=True)
class FinishedRun:
    """Scene, history, summary and last state of a run.

    Attributes
    ----------
    case : Case
    history : DataFrame
        A row a coupling window, SI units.
    summary : dict
        ``summary.json``.
    position, velocity, moment, dipole : ndarray, shape (n, 3)
        At the end [m], [m/s] and [A m^2], by id, the moment and its dipole part; zero where there is no field.
    radius : ndarray, shape (n,)
        [m]
    ids : ndarray, shape (n,)
        Sorted.
    """

    case: Case
    history: pandas.DataFrame
    summary: dict
    position: np.ndarray
    velocity: np.ndarray
    moment: np.ndarray
    dipole: np.ndarray
    radius: np.ndarray
    ids: np.ndarray

    @classmethod
    def of(cls, case: Case, folder: Path) -> FinishedRun:
        """What a run has left in its folder; its checkpoint is that of the end."""
        result = load_result(folder)
        state = read_checkpoint(folder / "checkpoint.h5")["dem"]
        order = np.argsort(state["particle_id"])
        where, none = state["position_radius"][order], np.zeros((len(order), 3))
        moment = state["magnetic_moment"][order] if "magnetic_moment" in state else none
        dipole = state["dipole"][order] if "dipole" in state else moment.copy()
        return cls(
            case, result.history, result.summary, where[:, :3].copy(), state["velocity_force"][order, :3].copy(),
            moment, dipole, where[:, 3].copy(), state["particle_id"][order],
        )  # fmt: skip

    def sum_of(self, *columns: str) -> np.ndarray:
        """Sum of those of the columns that the history has, shape (windows,)."""
        return sum((self.history[name].to_numpy() for name in columns if name in self.history), np.zeros(self.windows))

    @property
    def windows(self) -> int:
        """Coupling windows."""
        return len(self.history)

    def into_walls(self) -> np.ndarray:
        """How deep each grain stands in the walls that do not turn or are of revolution, over its radius, (n,)."""
        scene = self.case.scene
        shape = scene.shape()
        boxes = shape if isinstance(shape, Box) else shape.boxes_to_fill(scene.particles.region)
        walls = [wall for wall in shape.walls() if not isinstance(wall, TriangleWall)]
        sector = None if scene.particles.sector is None else CyclicSector(scene.particles.sector)
        return Space.of(boxes, walls, sector).wall_overlap(self.position, self.radius) / self.radius
