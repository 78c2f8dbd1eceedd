"""State of a coupling window for a user's callback, which may stop the run.

def watch(state: emclutch.WindowState) -> bool:
    return state.row["torque_disc"] > 1.0  # true: stop after this window

emclutch.run(case, callback=watch)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.columns import columns_of

if TYPE_CHECKING:
    from coupling import Simulation, WindowRow


@dataclass(frozen=True, slots=True)
class WindowState:
    """A run after one of its coupling windows.

    Arrays are read-only views of the run's own memory, in the order in which grains lie there now: they hold what they
    say during the call only. Copy what you keep, and know grains by `particle_id`.

    Attributes
    ----------
    time : float
        At the end of the window [s].
    window, windows : int
        Number of the window, from 1, and of the run's last.
    row : mapping of str to float or None
        The window's row of ``history.csv`` by column, see `emclutch.results.COLUMNS`; None is an empty cell.
    position : ndarray (n, 3)
        Centres [m], Cartesian, z along the shaft.
    velocity, angular_velocity : ndarray (n, 3)
        [m/s] and [rad/s], half a step of the grains before `time`.
    radius : ndarray (n,)
        [m].
    particle_id : ndarray (n,)
        Number of each grain.
    magnetic_moment : ndarray (n, 3) or None
        Dipole moments [A m^2]; None in a scene without magnetism.
    """

    time: float
    window: int
    windows: int
    row: Mapping[str, Any]
    position: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    radius: np.ndarray
    particle_id: np.ndarray
    magnetic_moment: np.ndarray | None


def window_state(simulation: Simulation, row: WindowRow, windows: int) -> WindowState:
    """Return the state of a simulation whose run has `windows` windows."""
    grains = simulation.motion.grains
    return WindowState(
        time=simulation.motion.time,
        window=simulation.window,
        windows=windows,
        row=MappingProxyType(columns_of(row)),
        position=_read_only(grains.position),
        velocity=_read_only(grains.velocity),
        angular_velocity=_read_only(grains.angular_velocity),
        radius=_read_only(grains.radius),
        particle_id=_read_only(grains.particle_id),
        magnetic_moment=None if grains.magnetic_moment is None else _read_only(grains.magnetic_moment),
    )


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.flags.writeable = False
    return view


class CallbackError(RuntimeError):
    """The user's callback raised an error; it is the cause of this one."""


@dataclass(slots=True)
class UserCallback:
    """Callback of the loop that calls the user's; `stopped` is true where that one has ended the run.

    Attributes
    ----------
    function : callable
        Gets a `WindowState`; what it returns is taken as a truth value: true stops the run.
    windows : int
        Of the whole run.
    """

    function: Callable[[WindowState], object]
    windows: int
    stopped: bool = False

    def __call__(self, simulation: Simulation, row: WindowRow) -> bool:
        try:
            self.stopped = bool(self.function(window_state(simulation, row, self.windows)))
        except Exception as error:  # a ValueError of the user's is none of the run's
            time = simulation.motion.time
            raise CallbackError(f"the callback failed at t = {time:.4g} s: {type(error).__name__}: {error}") from error
        return self.stopped
