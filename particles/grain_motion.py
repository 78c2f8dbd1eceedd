"""Base of the engines `particles.DEM` and `particles.DVI`: grains, walls on bodies, gravity, lists, checkpoints."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from geometry.walls import Wall
from particles import run_errors
from particles.attraction import PREFIX as ATTRACTION
from particles.attraction import Attraction
from particles.bodies import Body
from particles.grains import MOMENTS, RECORDS, Grains
from particles.neighbours.contact_list import ListedWalls, reaches
from particles.neighbours.contact_table import ContactTable
from particles.neighbours.neighbour_list import PairList
from particles.neighbours.slot_list import SlotList
from particles.periodicity import Periodicity
from particles.sector import CyclicSector
from particles.sheared_box import GapBox, ShearedBox
from particles.step_status import DONE
from particles.step_totals import StepTotals
from particles.walls.device_walls import DeviceWalls
from particles.walls.wall_table import Enclosure

Gravity = np.ndarray | Sequence[float] | Callable[[np.ndarray], np.ndarray]
LIST = "list_"  # before the names of the list's arrays in a state


def gravity_at(gravity: Gravity | None, times: np.ndarray) -> np.ndarray:
    """Acceleration [m/s^2] at ``times`` (k,) [s]: shape (k, 3), (1, 3) where it does not change, (0, 3) without."""
    if gravity is None:
        return np.zeros((0, 3))
    if callable(gravity):
        return np.ascontiguousarray(gravity(times), dtype=float).reshape(len(times), 3)
    return np.array(gravity, dtype=float).reshape(1, 3)


def lagged_force(force: np.ndarray | None, count: int) -> np.ndarray:
    """The lagged force [N] of so many grains as the kernels take it: (n, 3), or (0, 3) without; else a ValueError."""
    if force is None:
        return np.zeros((0, 3))
    lagged = np.ascontiguousarray(force, dtype=float)
    if lagged.shape != (count, 3):
        raise ValueError(f"external_force has shape {lagged.shape}; it must be ({count}, 3)")
    return lagged


def array_of(state: dict[str, np.ndarray], name: str) -> np.ndarray | None:
    """Return a copy of an array that a state may have."""
    value = state.get(name)
    return None if value is None else value.copy()


class GrainMotion(ABC):
    """Grains moving between walls on turning bodies.

    What moves grains need not know which of the engines does; these differ in how they find contact forces.

    Parameters
    ----------
    grains : Grains
        Taken over: its arrays are replaced, sorted and advanced.
    walls, bodies
        Walls refer to bodies by name.
    dt : float
        Step [s].
    gravity : array_like, shape (3,), or callable, optional
        Acceleration [m/s^2]; a callable takes times (k,) [s] and returns (k, 3).
    periodicity : Periodicity or None
        How the space repeats that is simulated: a wedge of the ring, a sheared box; None: all of it is.
    skin : float
        Of the neighbour list [m].
    overlap_limit : float
        Overlap, as a fraction of the diameter, at which the run is stopped.

    Attributes
    ----------
    external_force : ndarray, shape (n, 3), or None
        Force on each grain [N] in the present order, constant until it is set again (lagged); sorted with the grains.
    attraction : Attraction or None
        Pull of near grains and walls from the gap of every step, its drive lagged (`particles.attraction`).
    step_count : int
        Steps done.
    order_version, list_version : int
        How often the grains have been put in another order, and how often the neighbour list was made.
    """

    PER_GRAIN: ClassVar[dict[str, bool]] = {"external_force": True}
    """Arrays with a row a grain, or None: whether rows are vectors, which a wrap may turn."""

    def __init__(
        self,
        grains: Grains,
        walls: Sequence[Wall],
        bodies: Sequence[Body],
        *,
        dt: float,
        gravity: Gravity | None,
        periodicity: Periodicity | None,
        skin: float,
        overlap_limit: float,
    ) -> None:
        self.grains, self.walls, self.bodies = grains, list(walls), list(bodies)
        self.dt, self.periodicity, self.overlap_limit = float(dt), periodicity, overlap_limit
        self.gravity: Gravity | None = gravity
        if gravity is not None and not callable(gravity):
            self.gravity = np.array(gravity, dtype=float).reshape(3)
        if self.box is not None and (self.walls or gravity is not None):
            raise ValueError(
                "walls or gravity in a sheared box; it repeats in all directions, grains would fall for ever"
            )
        if self.sector is not None and isinstance(self.gravity, np.ndarray) and self.gravity[:2].any():
            raise ValueError(
                f"gravity = {self.gravity} m/s^2 turns from sector to sector; allowed with a sector: along z only"
            )
        self.skin = float(skin)
        if not 0.0 < self.skin < np.inf:
            raise ValueError(f"skin = {self.skin * 1e3:g} mm; allowed: more than 0")
        self.external_force: np.ndarray | None = None
        self.attraction: Attraction | None = None
        self.step_count = self.order_version = self.list_version = 0
        self._device = DeviceWalls(self.walls, self.bodies)
        # a device that does not hold its grains at the start (a bare disc, a belt) cannot lose them either
        enclosure = Enclosure(self.walls)
        self._enclosure = None if enclosure.outside(grains.position, 0.0).any() else enclosure
        self._stale = True

    @property
    def time(self) -> float:
        """Time [s] of the positions."""
        return self.step_count * self.dt

    @property
    def sector(self) -> CyclicSector | None:
        """The wedge of the ring that is simulated, if it is one."""
        return self.periodicity if isinstance(self.periodicity, CyclicSector) else None

    @property
    def box(self) -> ShearedBox | None:
        """The sheared box that the grains are in, if it is one without walls."""
        whole = isinstance(self.periodicity, ShearedBox) and self.gap_box is None
        return self.periodicity if whole else None  # type: ignore[return-value]

    @property
    def gap_box(self) -> GapBox | None:
        """The repeated gap between walls that the grains are in, if it is one."""
        return self.periodicity if isinstance(self.periodicity, GapBox) else None

    @property
    def n_sectors(self) -> int:
        """Sectors in the full ring (1 without a sector)."""
        return 1 if self.sector is None else self.sector.n_sectors

    @property
    def gravity_now(self) -> np.ndarray | None:
        """Acceleration of gravity [m/s^2] at this time, shape (3,)."""
        pull = gravity_at(self.gravity, np.array([self.time]))
        return pull[0] if len(pull) else None

    @property
    def list_skin(self) -> float:
        """Reach of the present list beyond touching [m]."""
        return self.skin

    @property
    def listed_pairs(self) -> PairList:
        """Pairs of the present list; see `renew_list`, and `Attraction.near_gap` for how far they reach.

        Of row i: the images by ``shift`` of the partners ``other``, all in the present order of the grains.
        """
        return self._list.pairs

    @property
    def listed_walls(self) -> ListedWalls:
        """Walls near each grain in the present list."""
        number = self._list.wall_other
        return ListedWalls(self._list.wall_start, self._device.wall[number], number < len(self._device.rows))

    @property
    def _peculiar_velocity(self) -> np.ndarray:
        """Velocities less the flow of a sheared box [m/s], (n, 3)."""
        g = self.grains
        return g.velocity if self.box is None else g.velocity - self.box.flow(g.position[:, 2])

    @property
    @abstractmethod
    def contact_force(self) -> np.ndarray:
        """Sum of the contact forces on each grain in the last step [N], shape (n, 3)."""

    @abstractmethod
    def run(self, n_steps: int) -> StepTotals:
        """Advance by ``n_steps`` steps; raises `particles.DemError` where a grain is in trouble."""

    @abstractmethod
    def contacts(self) -> ContactTable:
        """The contacts with their forces; changes nothing."""

    @abstractmethod
    def begin_with(self, state: dict[str, np.ndarray]) -> None:
        """Begin at time 0 with the grains of a `state` and the angles of its bodies, under this engine's own step,
        contact and speeds; a ValueError where contacts of the state remember something else."""

    def invalidate(self) -> None:
        """Say that positions were changed from outside: the list is rebuilt before the next step."""
        self._stale = True

    def renew_list(self) -> bool:
        """Make the neighbour list again if it is outdated, as `run` would; whether it was.

        For who needs to know, before a run, which pairs its list holds. Grains may be sorted and wrapped.
        """
        if not self._outdated:
            return False
        self._rebuild()
        return True

    def stretch(self, factor: float) -> None:
        """Make the sheared box higher by ``factor``: centres move with it, peculiar velocities stay.

        Raises
        ------
        ValueError
            The grains are in no sheared box, or a factor that is not above 0.
        """
        if self.box is None or not 0.0 < factor < np.inf:
            raise ValueError(f"factor = {factor} of a box; allowed: above 0, for grains in a sheared box")
        g, box, reference = self.grains, self.box, self._list.reference
        g.velocity[:, 0] += box.rate * (factor - 1.0) * g.position[:, 2]
        g.position[:, 2] *= factor
        if self.attraction is not None and "position" in self.attraction.per_grain:
            self.attraction.per_grain["position"][:, 2] *= factor
        reference[:, 2] *= factor
        box.stretch(factor)
        reach = self._interaction + 0.5 * self.list_skin
        nearer = box.approach(g.position, reference, box.list_strain, box.height, reach) + box.stretched * reach
        if nearer > self.list_skin:
            self.invalidate()

    def state(self) -> dict[str, np.ndarray]:
        """Everything that `restore` needs to continue bit for bit."""
        arrays = {name: getattr(self.grains, name).copy() for name in RECORDS}
        own = {name.lstrip("_"): getattr(self, name) for name in self.PER_GRAIN}
        moments = {name: getattr(self.grains, name) for name in MOMENTS}
        for name, value in (moments | own).items():
            if value is not None:
                arrays[name] = value.copy()
        arrays |= {f"{LIST}{name}": value.copy() for name, value in self._list.arrays().items()}
        if self.periodicity is not None:
            arrays |= self.periodicity.state()
        if self.attraction is not None:
            arrays |= self.attraction.state()
        arrays["bodies"] = np.array([[b.angle, b.speed, b.external_torque] for b in self.bodies]).reshape(-1, 3)
        arrays["counters"] = np.array(
            [self.step_count, self.order_version, self._stale, self.list_version], dtype=np.int64
        )
        return arrays

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Put a `state` into an engine that was made with the same walls, bodies, contact and `attraction`.

        Raises
        ------
        ValueError
            If the state has another number of grains or bodies, its contacts remember something else, or it has an
            attraction whose table is not known here.
        """
        attracts = any(name.startswith(ATTRACTION) for name in state)
        if attracts and self.attraction is None:
            raise ValueError(
                f"the state's grains attract each other; give this {type(self).__name__} the same `attraction` first"
            )
        self._restore_grains(state)
        if self.periodicity is not None:
            self.periodicity.restore(state)
        for name in self.PER_GRAIN:
            setattr(self, name, array_of(state, name.lstrip("_")))
        self._restore_list({name.removeprefix(LIST): v for name, v in state.items() if name.startswith(LIST)})
        for body, (angle, speed, torque) in zip(self.bodies, state["bodies"], strict=True):
            body.angle, body.speed, body.external_torque = float(angle), float(speed), float(torque)
        self.step_count, self.order_version, stale, self.list_version = (int(v) for v in state["counters"][:4])
        self._stale = bool(stale)
        if self.attraction is not None and attracts:
            self.attraction.restore(state)
        else:
            self.attraction = None

    # -- for the engines

    @property
    @abstractmethod
    def _list(self) -> SlotList:
        """The present list, with what contacts remember."""

    @property
    @abstractmethod
    def _interaction(self) -> float:
        """Largest distance [m] at which a pair acts that the present list must hold."""

    @property
    def _outdated(self) -> bool:
        """True if the list must be rebuilt before the next step."""
        return self._stale or (self.attraction is not None and not self.attraction.listed)

    @property
    def _near_gap(self) -> float:
        """Gap [radii] up to which a list made now holds every pair at every step."""
        return 0.0 if self.attraction is None else self.attraction.near_gap

    def _reaches(self, skin: float) -> tuple[np.ndarray, float]:
        """Reach of each grain (n,) [m] in a list of this ``skin`` [m], and the largest distance of a pair [m]."""
        return reaches(self.grains.radius, skin, self._near_gap)

    @abstractmethod
    def _rebuild(self) -> None:
        """Sort the grains by cells, list their neighbours again, and carry over what contacts remember."""

    @abstractmethod
    def _restore_list(self, arrays: dict[str, np.ndarray]) -> None:
        """Take over the list of a state, by its ``arrays``."""

    @abstractmethod
    def _raise_stopped(self, status: int, totals: np.ndarray) -> None:
        """Raise the error that explains the ``status`` of a step, or what its ``totals`` show."""

    def _body_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Angles [rad] and speeds [rad/s] of the bodies, shapes (n_bodies,)."""
        return np.array([b.angle for b in self.bodies]), np.array([b.speed for b in self.bodies])

    def _march(self, n_steps: int, totals: np.ndarray, call: Callable[[int, Any, Any], tuple[int, int]]) -> int:
        """Advance by ``n_steps``, list by list; returns how many lists were made.

        ``call(steps left, angle, speed)`` does some of the steps and brings the bodies' arrays forward; it returns the
        step's status and how many it has done.
        """
        rebuilds, left = 0, n_steps
        angle, speed = self._body_state()
        while left > 0:
            if self._outdated:
                self._rebuild()
                rebuilds += 1
            status, done = call(left, angle, speed)
            left -= done
            self.step_count += done
            for body, a, w in zip(self.bodies, angle, speed, strict=True):
                body.angle, body.speed = float(a), float(w)
            self._stale = status != DONE
            self._raise_stopped(status, totals)
        return rebuilds

    def _wrap(self, periodicity: Periodicity) -> np.ndarray:
        """Bring back into the copy of space what has left it; by which shift each grain, a row each."""
        periodicity.begin_list()
        g, wraps = self.grains, periodicity.wraps(self.grains.position)
        moved = np.flatnonzero(wraps.reshape(g.count, -1).any(axis=1))
        shift = wraps[moved]
        g.position[moved] = periodicity.place(g.position[moved], shift)
        g.velocity[moved] = periodicity.sweep(g.velocity[moved], shift)
        own = [getattr(self, name) for name, turns in self.PER_GRAIN.items() if turns]
        for array in (g.angular_velocity, g.magnetic_moment, g.dipole, *own):
            if array is not None:
                array[moved] = periodicity.turn(array[moved], shift)
        if self.attraction is not None:
            self.attraction.wrap(moved, shift, periodicity)
        return wraps

    def _refuse_escaped(self, margin: float, remedy: str) -> None:
        """Raise DemError where a grain is farther than ``margin`` [m] outside of the device."""
        if self._enclosure is not None:
            outside = np.flatnonzero(self._enclosure.outside(self.grains.position, margin))
            if len(outside):
                raise run_errors.escaped(self.grains, outside, self.time, remedy)

    def _sort(self, order: np.ndarray) -> None:
        """Put grain ``order[k]`` into place k in everything that has a row a grain."""
        self.grains.permute(order)
        for name in self.PER_GRAIN:
            if (array := getattr(self, name)) is not None:
                setattr(self, name, array.take(order, axis=0))
        if self.attraction is not None:
            self.attraction.permute(order)
        self.order_version += 1

    def _note_list(self) -> None:
        """Note that a list has been made."""
        self.list_version += 1
        self._stale = False
        if self.attraction is not None:
            self.attraction.renew()
            self.attraction.listed = True

    def _restore_grains(self, state: dict[str, np.ndarray]) -> None:
        """Give the grains the arrays of a state; a ValueError where it has another number of grains or bodies."""
        if len(state["mass"]) != self.grains.count or len(state["bodies"]) != len(self.bodies):
            raise ValueError(
                f"the state has {len(state['mass'])} grains and {len(state['bodies'])} bodies, this "
                f"{type(self).__name__} {self.grains.count} and {len(self.bodies)}; restore it into the scene that it "
                "came from"
            )
        for name in RECORDS:
            setattr(self.grains, name, state[name].copy())
        for name in MOMENTS:
            setattr(self.grains, name, array_of(state, name))
