"""Common interface of `particles.DEM` and `particles.DVI`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from geometry.walls import Wall
from particles.bodies import Body
from particles.dem.step_totals import StepTotals
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.sector import CyclicSector

Gravity = np.ndarray | Sequence[float] | Callable[[np.ndarray], np.ndarray]


def gravity_at(gravity: Gravity | None, times: np.ndarray) -> np.ndarray:
    """Acceleration [m/s^2] at ``times`` (k,) [s]: shape (k, 3), (1, 3) where it does not change, (0, 3) without."""
    if gravity is None:
        return np.zeros((0, 3))
    if callable(gravity):
        return np.ascontiguousarray(gravity(times), dtype=float).reshape(len(times), 3)
    return np.array(gravity, dtype=float).reshape(1, 3)


def held_force(force: np.ndarray | None, count: int) -> np.ndarray:
    """The held force [N] of so many grains as the kernels take it: (n, 3), or (0, 3) without; else a ValueError."""
    if force is None:
        return np.zeros((0, 3))
    held = np.ascontiguousarray(force, dtype=float)
    if held.shape != (count, 3):
        raise ValueError(f"external_force has shape {held.shape}; it must be ({count}, 3)")
    return held


class GrainMotion(Protocol):
    """Grains moving between walls.

    Attributes
    ----------
    grains : Grains
        In the present order, which a renewed list may change.
    walls, bodies
        Walls refer to bodies by name.
    dt : float
        Step [s].
    external_force : ndarray, shape (n, 3), or None
        Force on each grain [N] in the present order, held until it is set again; sorted along with the grains.
    step_count : int
        Steps done.
    order_version, list_version : int
        How often the grains have been put in another order, and how often the neighbour list was made.
    """

    grains: Grains
    walls: list[Wall]
    bodies: list[Body]
    dt: float
    external_force: np.ndarray | None
    step_count: int
    order_version: int
    list_version: int

    @property
    def time(self) -> float:
        """Time [s] of the positions."""
        ...

    @property
    def gravity(self) -> Gravity | None:
        """Acceleration [m/s^2], shape (3,), or a callable that takes times (k,) [s] and returns it (k, 3)."""
        ...

    @property
    def gravity_now(self) -> np.ndarray | None:
        """Acceleration of gravity [m/s^2] at this time, shape (3,)."""
        ...

    @property
    def list_skin(self) -> float:
        """Return how much further than touching the present list reaches [m]."""
        ...

    @property
    def sector(self) -> CyclicSector | None:
        """The wedge of the ring that is simulated; None: all of it."""
        ...

    @property
    def n_sectors(self) -> int:
        """Sectors in the full ring (1 without a sector)."""
        ...

    @property
    def contact_force(self) -> np.ndarray:
        """Sum of the contact forces on each grain in the last step [N], shape (n, 3)."""
        ...

    def run(self, n_steps: int) -> StepTotals:
        """Advance by ``n_steps`` steps; raises `particles.DemError` where a grain is in trouble."""
        ...

    def contacts(self) -> ContactTable:
        """The contacts with their forces; changes nothing."""
        ...

    def invalidate(self) -> None:
        """Say that positions were changed from outside: the list is renewed before the next step."""
        ...

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to go on bit for bit."""
        ...

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into an engine that was made with the same walls, bodies and contact; else a ValueError."""
        ...

    def begin_with(self, state: dict[str, np.ndarray]) -> None:
        """Begin at time 0 with the grains of a `state` and the angles of its bodies, under this engine's own step,
        contact and speeds; a ValueError where contacts of the state remember something else."""
        ...
