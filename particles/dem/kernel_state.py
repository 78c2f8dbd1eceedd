"""State of the compiled step: named tuples of arrays.

Each is one argument of `particles.dem.step_kernel.run_steps`. Numba knows a tuple by its class, so classes stand at the
level of a module, and a field that is left out of the compiled code is None in every step of that kind.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from particles.dem.attraction_kernel import LaggedAttraction
from particles.dem.contact_kernel import Resistance
from particles.neighbours.partition import Chunks
from particles.shafts import Shafts


class Call(NamedTuple):
    """One call of the step: how far, and what stops it.

    Attributes
    ----------
    n_steps : int
    dt : float
        [s]
    last : bool
        The last of these steps is the last of the run: it leaves what the run reports.
    squared_travel : float
        Square of the displacement of a grain since the list was made, at which it is rebuilt [m^2].
    wall_travel : float
        Displacement of a triangle since then [m].
    overlap : float
        Fraction of the diameter.
    speed : float
        Largest allowed [m/s].
    threads : int
        That may share the work.
    """

    n_steps: int
    dt: float
    last: bool
    squared_travel: float
    wall_travel: float
    overlap: float
    speed: float
    threads: int


class Now(NamedTuple):
    """The present step of a call: its number, dt [s], and whether it is the last of the run."""

    step: int
    dt: float
    last: bool


class GrainState(NamedTuple):
    """Grains and what is constant during the call.

    Attributes
    ----------
    position_radius, velocity_force, mass : ndarray, shapes (n, 4), (n, 12), (n,)
        As in `particles.grains.Grains`.
    species : ndarray of int64, shape (n,) or (0,)
        Material of each grain; empty where there is one.
    gravity : ndarray, shape (k, 3)
        Acceleration [m/s^2]: a row a step, one row for all of them, or none.
    external : ndarray, shape (n, 3) or (0, 3)
        Lagged force [N]; empty without.
    reference : ndarray, shape (n, 3)
        Centres at which the list was made [m].
    net : ndarray, shape (n, 3)
        Contact force on each grain in the last step of the run [N].
    flow, virial : ndarray, shapes (N_FLOW,), (c, N_VIRIAL, 8), or None
        Of a sheared box, and its sums in a step (`particles.dem.box_kernel`); None outside of one.
    """

    position_radius: np.ndarray
    velocity_force: np.ndarray
    mass: np.ndarray
    species: np.ndarray
    gravity: np.ndarray
    external: np.ndarray
    reference: np.ndarray
    net: np.ndarray
    flow: np.ndarray | None
    virial: np.ndarray | None


class PairSlots(NamedTuple):
    """Slots of the half list, row by row.

    Attributes
    ----------
    start, row, other : ndarray, shapes (n + 1,) int64, (p,) uint32, (p,) uint32
        Grain i has the slots ``start[i]`` up to ``start[i + 1]``; ``row`` is i for each. Without a sign, because the
        compiler looks after numbers below zero wherever they may be.
    shift : ndarray of int8, shape (p,), or None
        Which image of the partner it is (`particles.periodicity`); None where space does not repeat.
    turn : ndarray, shape (2,), or None
        Cosine and sine of a sector's angle; None without a sector.
    images : ndarray, shape (2 m + 1, 6), or None
        Of a sheared box, at the time of the step; None without one.
    law_row : ndarray of int64, shape (s, s)
        Row of the law's table by species.
    touching, history : ndarray, shapes (p,) uint8, (p, columns)
        Whether the pair touches, and what it remembers (`particles.dem.contact_kernel`).
    record : ndarray, shape (p, 3) or (0, 3)
        Where forces [N] are left, if they are asked for.
    noted : ndarray of int32, shape (c, N_NOTED, ROOM)
        Scratch of each chunk (`particles.dem.pair_search`).
    """

    start: np.ndarray
    row: np.ndarray
    other: np.ndarray
    shift: np.ndarray | None
    turn: np.ndarray | None
    images: np.ndarray | None
    law_row: np.ndarray
    touching: np.ndarray
    history: np.ndarray
    record: np.ndarray
    noted: np.ndarray


class WallSlots(NamedTuple):
    """Slots of (grain, wall), row by row, as in `PairSlots`.

    Attributes
    ----------
    record : ndarray, shape (s, 7) or (0, 3)
        Force [N], overlap [m] and unit vector towards the wall, if they are asked for.
    contact, near : ndarray, shapes (c, m, N_CONTACT), (c, m, N_NEAR)
        Scratch of each chunk: what grains touch, and what may pull them (`particles.dem.wall_contacts`).
    """

    start: np.ndarray
    other: np.ndarray
    touching: np.ndarray
    history: np.ndarray
    record: np.ndarray
    contact: np.ndarray
    near: np.ndarray


class WallState(NamedTuple):
    """Walls on bodies that turn.

    Attributes
    ----------
    smooth, triangle : ndarray
        As in `particles.walls.device_walls.DeviceWalls`.
    law_row : ndarray of int64, shape (s, walls)
        Row of the law's table by species and wall.
    body : ndarray of int64, shape (walls,)
        Body of each wall.
    speed : ndarray, shape (n_bodies,)
        Of the bodies [rad/s], that of `Shafts`.
    turn : ndarray, shape (n_bodies, 2)
        Cosine and sine of their angles; kept where there are triangles.
    """

    smooth: np.ndarray
    triangle: np.ndarray
    law_row: np.ndarray
    body: np.ndarray
    speed: np.ndarray
    turn: np.ndarray


class Totals(NamedTuple):
    """Sums over steps (`particles.dem.total_columns`), and those of the chunks in one step that they are added from.

    Attributes
    ----------
    run, bodies : ndarray, shapes (N_SUMS,), (n_bodies, N_BODY_SUMS)
    chunk, chunk_bodies : ndarray, shapes (c, N_SUMS), (c, n_bodies, N_CHUNK_BODY)
    box : ndarray, shape (N_BOX_SUMS,), or None
        Sums over steps in a sheared box (`particles.dem.box_kernel`).
    """

    run: np.ndarray
    bodies: np.ndarray
    chunk: np.ndarray
    chunk_bodies: np.ndarray
    box: np.ndarray | None


class Tally(NamedTuple):
    """Sums over the contacts of a chunk so far in one step.

    Attributes
    ----------
    contacts : int
    energies : tuple of 6 floats
        Energy of the springs, losses to normal and tangential damping, sliding, rolling and twisting [J].
    released_energy : tuple of 4 floats
        Losses where a grain left a wall: to normal damping, sliding, rolling and twisting [J].
    max_overlap, argmax_overlap : float, int
        Largest overlap [fraction of the diameter], and the grain that has it.
    """

    contacts: int
    energies: tuple[float, float, float, float, float, float]
    released_energy: tuple[float, float, float, float]
    max_overlap: float
    argmax_overlap: int


class StepArguments(NamedTuple):
    """The arguments of `run_steps`, in its order."""

    call: Call
    law: Any
    resistance: Resistance | None
    energy_column: int | None
    attraction: LaggedAttraction | None
    grains: GrainState
    pairs: PairSlots
    slots: WallSlots
    walls: WallState
    shafts: Shafts
    chunks: Chunks
    totals: Totals
