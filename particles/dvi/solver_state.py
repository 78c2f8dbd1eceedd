"""State of the compiled step of rigid grains: named tuples of arrays.

Each is one argument of `particles.dvi.step_kernel.run_steps`; the bodies' is that of the DEM (`particles.shafts`). What
a function takes as an argument of its own may be None, and numba leaves its branches out; what is None inside a tuple
it would compile. An array that a loop over `numba.prange` only writes to is an argument of its own as well: numba takes
one out of a tuple for a local array, and leaves out what fills it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geometry.kernels.device_functions import device_function
from particles.shafts import Shafts

if TYPE_CHECKING:
    from particles.dvi.near_pulls import NearPulls
    from particles.dvi.sweep_chunks import SweepChunks


class SolverSettings(NamedTuple):
    """Settings of the solver of a step.

    Attributes
    ----------
    method : int
        GAUSS_SEIDEL or ANDERSON (`particles.dvi.accelerated`).
    tolerance : float
        On the natural map [m/s].
    cap : int
        Most sweeps.
    """

    method: int
    tolerance: float
    cap: int


class DviCall(NamedTuple):
    """One call of the step: how far, by which rules, and what stops it.

    Attributes
    ----------
    n_steps : int
    h : float
        Step [s].
    theta : float
        Weight of the new velocity in the drift.
    travel, wall_travel : float
        Displacement of a grain, and of a triangle, since the list was made, at which it is rebuilt [m].
    overlap : float
        Fraction of the diameter.
    slop : float
        Fraction of the radius.
    margin : float
        Fraction of the fastest grain's displacement that contacts are looked for beyond their own.
    law : ndarray, shape (2, 5)
        Friction, restitution and its threshold [m/s] between grains, at walls (`particles.dvi.dvi_contact`); pull [N]
        and pull by radius [N/m] (`particles.laws.cohesion`).
    pull : int
        First column of a contact's pull in its impulse; 0 where nothing adheres.
    settings : SolverSettings
    n_contacts : ndarray of int64, shape (2,)
        Pairs and wall contacts of the last step; written.
    """

    n_steps: int
    h: float
    theta: float
    travel: float
    wall_travel: float
    overlap: float
    slop: float
    margin: float
    law: np.ndarray
    pull: int
    settings: SolverSettings
    n_contacts: np.ndarray


class Horizon(NamedTuple):
    """Search for contacts in the present step of h [s]: up to ``margin`` [m] beyond the grains' own travel.

    ``slop`` and ``law`` are those of `DviCall`.
    """

    h: float
    margin: float
    slop: float
    law: np.ndarray


class DviGrains(NamedTuple):
    """Grains and what is constant during the call.

    Attributes
    ----------
    position, velocity, spin : ndarray, shape (n, 3)
        [m], [m/s], [rad/s]
    radius, mass : ndarray, shape (n,)
        [m], [kg]
    gravity : ndarray, shape (k, 3)
        Acceleration [m/s^2]: a row a step, one row for all of them, or none.
    external : ndarray, shape (n, 3) or (0, 3)
        Lagged force [N]; empty without. With `particles.dvi.near_pulls` it is written in each step.
    reference : ndarray, shape (n, 3)
        Centres at which the list was made [m].
    bound : ndarray, shape (n,)
        Scratch: the speed that a grain may have within the step [m/s].
    flow : ndarray, shape (N_FLOW,) or (0,)
        Of a sheared box (`particles.dem.box_kernel`); empty outside of one.
    """

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    gravity: np.ndarray
    external: np.ndarray
    reference: np.ndarray
    bound: np.ndarray
    flow: np.ndarray


class PairImpulses(NamedTuple):
    """Slots of the half list, row by row.

    Attributes
    ----------
    start, other : ndarray, shapes (n + 1,), (p,)
        Grain i has the slots ``start[i]`` up to ``start[i + 1]``.
    impulse : ndarray, shape (p, 3), (p, 6) or (p, 9)
        Of the last step [N s], on the first grain (`particles.dvi.impulse_list`).
    contact_slot : ndarray of int32, shape (p,)
        Slot of each contact of the step.
    shift : ndarray of int8, shape (p,)
        Which image of the partner it is (`particles.periodicity`).
    images : ndarray, shape (2 m + 1, 6)
        Table of images; one row where space does not repeat, and nobody reads a shift.
    """

    start: np.ndarray
    other: np.ndarray
    impulse: np.ndarray
    contact_slot: np.ndarray
    shift: np.ndarray
    images: np.ndarray


class WallImpulses(NamedTuple):
    """Slots of (grain, wall), row by row, as in `PairImpulses`; no images.

    Attributes
    ----------
    triangle_contact, tally : ndarray, shapes (s, N_CONTACT), (s, 2), or no rows without triangles
        What grains meet of triangles (`particles.dvi.triangle_contacts`).
    """

    start: np.ndarray
    other: np.ndarray
    impulse: np.ndarray
    contact_slot: np.ndarray
    triangle_contact: np.ndarray
    tally: np.ndarray


class DviWalls(NamedTuple):
    """Walls on bodies that turn.

    Attributes
    ----------
    smooth, triangle, body : ndarray
        As in `particles.walls.device_walls.DeviceWalls`.
    turn : ndarray, shape (n_bodies, N_TURN)
        Where they have turned to (`particles.dvi.triangle_contacts`); kept where there are triangles.
    """

    smooth: np.ndarray
    triangle: np.ndarray
    body: np.ndarray
    turn: np.ndarray


class SolverContacts(NamedTuple):
    """Input of the sweeps: the contacts of a step and their bodies (columns: `particles.dvi.gauss_seidel`).

    Attributes
    ----------
    grain, body : ndarray, shapes (n, N_GRAIN), (n_bodies, N_BODY)
        Velocities and inverse masses.
    pair_index, wall_index : ndarray of int32, shapes (p, 2), (s, 2)
        Both grains; grain and body.
    pair, wall : ndarray, shapes (p, columns), (s, columns)
        Geometry, impulse and law of each contact.
    pair_group, wall_group : ndarray of int32, shapes (p, N_GROUP, 8), (s, N_GROUP, 8)
        In which order they are visited (`particles.dvi.contact_groups`): groups of the contacts from the k-th on begin
        at row k. Where they are fewer than the contacts, -1 follows them. One that is not full repeats its first.
    membership : ndarray of int64, shape (n, 2)
        Scratch: in which groups a grain is, as bits, and the group that these count from.
    pair_shift, images : ndarray, shapes (p,) int8, (2 m + 1, 6)
        Which image of its second grain a pair meets, and the table of images, as of `PairImpulses`.
    """

    grain: np.ndarray
    body: np.ndarray
    pair_index: np.ndarray
    pair: np.ndarray
    wall_index: np.ndarray
    wall: np.ndarray
    pair_group: np.ndarray
    wall_group: np.ndarray
    membership: np.ndarray
    pair_shift: np.ndarray
    images: np.ndarray


class Torques(NamedTuple):
    """Resistance to rolling and twisting (`particles.dvi.contact_torques`).

    Attributes
    ----------
    law : ndarray, shape (2, 2) or (0, 2)
        mu_r and mu_w between grains, at walls; no rows where nothing resists, and nothing is done.
    pair, wall : ndarray
        Records of the torques, at least as many as contacts.
    """

    law: np.ndarray
    pair: np.ndarray
    wall: np.ndarray


class Part(NamedTuple):
    """A part of the contacts and of whom they move: pairs p0 to p1, walls w0 to w1, grains i0 to i1, with 1 shafts."""

    p0: int
    p1: int
    w0: int
    w1: int
    i0: int
    i1: int
    shafts: int


class SweepThreads(NamedTuple):
    """Threads of the sweeps: one, ``serial`` True and ``chunk`` None; or threads in chunks, ``serial`` None."""

    chunk: SweepChunks | None
    serial: bool | None


class DviSums(NamedTuple):
    """Sums over steps (`particles.dvi.end_of_step`).

    Attributes
    ----------
    run, bodies : ndarray, shapes (N_SUMS,), (n_bodies, N_BODY_SUMS)
    springs : ndarray, shape (4,)
        Present energy [J] in the normal and tangential springs, in those of rolling and of twisting.
    box : ndarray, shape (N_BOX_SUMS,) or (0,)
        Of a sheared box (`particles.dvi.flow_in_box`); empty outside of one.
    """

    run: np.ndarray
    bodies: np.ndarray
    springs: np.ndarray
    box: np.ndarray


class DviArguments(NamedTuple):
    """The arguments of `run_steps`, in its order."""

    call: DviCall
    convex: bool | None
    compliance: np.ndarray | None
    grains: DviGrains
    near: NearPulls
    pairs: PairImpulses
    slots: WallImpulses
    walls: DviWalls
    shafts: Shafts
    records: SolverContacts
    contact_torques: Torques
    threads: SweepThreads
    totals: DviSums


@device_function(error_model="numpy")
def first_of(records, pairs, walls):
    """The records of the first contacts, so many pairs and walls."""
    return SolverContacts(
        records.grain, records.body, records.pair_index[:pairs], records.pair[:pairs], records.wall_index[:walls],
        records.wall[:walls], records.pair_group, records.wall_group, records.membership, records.pair_shift,
        records.images,
    )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy")
def all_of(records):
    """Return all contacts and grains as one part."""
    none, one = np.int64(0), np.int64(1)  # plain numbers are types of their own
    pairs, walls, grains = records.pair.shape[0], records.wall.shape[0], records.grain.shape[0]
    return Part(none, pairs, none, walls, none, grains, one)  # type: ignore[arg-type]
