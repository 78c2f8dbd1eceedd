"""A tabulated attraction of near grains, its drive lagged: the step takes its own gap, and the drive of a slot.

For forces that change within a few hundredths of a radius, such as that of two magnetised grains whose flux gathers in
their neck: lagged by some steps, as `DEM.external_force` is, they would follow the gap too late, and pump energy into
whatever swings in it. The pull of a pair along its line of centres is

    F = amplitude T(ln g, column) + across_amplitude A(ln g),   g = max((r - r_i - r_j)/a, smallest_gap),

with a = 2 r_i r_j/(r_i + r_j), T (``values``) bilinear and A (``across``) linear in ln g; constant below the grid, 0
from the last gap on. At a smooth wall, towards its nearest point at the distance h, F = amplitude T(ln g, column) with
g = max(2 (h - r_i)/r_i, smallest_gap): that of a grain and its mirror image. `DEM` takes the pull at the gap of each
step, `DVI`, whose steps are longer, its mean over the way that the gap goes in a step at the present velocities.

**Lagged:** amplitudes and columns. They belong to the slots of the engine's list: every pair nearer than touching and a
skin when it was made. Grains may come nearer to each other by a skin before the next one is made; so the list reaches
further by ``near_gap``, and up to that gap it holds every pair at every step. It is rebuilt, and the grains sorted
and wrapped, inside a run: the engine asks for the drives by a callable that finds them from arrays of the grains, and
it keeps these arrays in the present order.

**Each pair once.** Pairs that the list does not hold are the caller's, as lagged forces. A list rebuilt inside a run
holds others than the last one: `drives` may then set `GrainMotion.external_force`, it is read afterwards.

**Energy budget.** Pulls are no contact forces: friction is limited by the contact's repulsion alone, which they raise
by pressing the grains together. Their work counts as external work. Action and reaction are equal, bit for bit, and
central, so momentum and angular momentum are conserved to round-off. A wall's body gets nothing: a pull along the
normal of a coaxial wall, or of a plane that cannot swing, has no torque about the axis and does no work on a turning
body; the force along the axis is not reported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from particles.dem.attraction_kernel import ACROSS, AMPLITUDE, COLUMN, LaggedAttraction
from particles.laws.contact_law import ContactLaw
from particles.laws.pair_table import PairLaws

if TYPE_CHECKING:
    from particles.grain_motion import GrainMotion
    from particles.neighbours.contact_list import ContactList
    from particles.neighbours.neighbour_list import PairList
    from particles.periodicity import Periodicity

DEEPEST = 0.01  # of a radius: how far a pull may press a contact before `depth_warning` speaks
PREFIX = "attraction_"


@dataclass(slots=True, eq=False)
class Attraction:
    """Table, drives and what they follow from; see the module.

    Attributes
    ----------
    gap_start, gap_step : float
        Grid of the table: natural logarithm of the first gap [radii], and its step.
    values : ndarray, shape (ng, nh)
        Pull over amplitude, by gap and column; two or more of each.
    across : ndarray, shape (ng,)
        The same of the second part, which has no column.
    smallest_gap : float
        Gap of grains that touch [radii].
    drives : callable
        Takes the engine and returns (p, 3) and (s, 2): column (a place among those of ``values``, with fraction),
        amplitude [N] and amplitude across [N] of each pair of its `listed_pairs`; column and amplitude of each slot of
        its `listed_walls`. It is called before a step wherever the list is new, or after `renew`.
    near_gap : float
        Gap [radii] up to which every pair, and every wall, has its slot at every step.
    per_grain : dict of ndarray, shapes (n, ...)
        What `drives` needs of each grain, in the present order of the engine: sorted with the grains, and those of
        shape (n, 3) turned as vectors where a grain is wrapped; ``position`` as what it says.
    strain : float
        Strain of a sheared box at which ``position`` was taken: its images are those of then, see
        `Periodicity.at_strain`.
    pair_drive, wall_drive : ndarray or None
        The present drives; None until the next step asks for them.
    listed : bool
        Whether the present list reaches as far as `near_gap` asks.
    """

    gap_start: float
    gap_step: float
    values: np.ndarray
    across: np.ndarray
    smallest_gap: float
    drives: Callable[[GrainMotion], tuple[np.ndarray, np.ndarray]]
    near_gap: float = 0.0
    per_grain: dict[str, np.ndarray] = field(default_factory=dict)
    strain: float = 0.0
    pair_drive: np.ndarray | None = field(default=None, init=False)
    wall_drive: np.ndarray | None = field(default=None, init=False)
    listed: bool = field(default=False, init=False)
    _checked: tuple[PairList, np.ndarray, np.ndarray] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.values = np.ascontiguousarray(self.values, dtype=float)
        self.across = np.ascontiguousarray(self.across, dtype=float)
        if self.values.ndim != 2 or min(self.values.shape) < 2 or self.across.shape != self.values.shape[:1]:
            raise ValueError(
                f"values has shape {self.values.shape} and across {self.across.shape}; they must be (ng, nh) and (ng,) "
                "with two or more of each"
            )
        if not (np.isfinite(self.values).all() and np.isfinite(self.across).all() and np.isfinite(self.gap_start)):
            raise ValueError("the table of an attraction has numbers that are not finite")
        for name in ("gap_step", "smallest_gap"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} = {getattr(self, name)}; allowed: more than 0")
        if not 0.0 <= self.near_gap < np.inf:
            raise ValueError(f"near_gap = {self.near_gap} radii; allowed: 0 or more")
        self.listed = self.near_gap == 0.0

    @property
    def last_gap(self) -> float:
        """Gap at which the pull ends [radii]."""
        return float(np.exp(self.gap_start + (len(self.across) - 1) * self.gap_step))

    @property
    def stiffest(self) -> float:
        """Largest fall of a pull with the distance, -dF/dr [N/m], that a present slot can meet at any gap.

        A negative stiffness in parallel with the contact's. Where the two parts do not fall steepest at the same gap
        it is a little more. 0 before the first step.
        """
        low = np.exp(self.gap_start + self.gap_step * np.arange(len(self.across) - 1))
        reachable = low * np.exp(self.gap_step) > self.smallest_gap  # the others lie below the smallest gap
        width = self.gap_step * np.maximum(low, self.smallest_gap)[reachable]
        return self._largest(
            -np.diff(self.values, axis=0)[reachable] / width[:, None], -np.diff(self.across)[reachable] / width, True
        )

    @property
    def strongest(self) -> float:
        """Largest pull [N] that a present slot can meet at any gap; 0 before the first step."""
        x = (np.log(self.smallest_gap) - self.gap_start) / self.gap_step
        first = min(max(int(x), 0), len(self.across) - 1)  # the node at or below the smallest gap
        return self._largest(self.values[first:], self.across[first:], False)

    def _largest(self, values: np.ndarray, across: np.ndarray, by_length: bool) -> float:
        """Largest over slots of amplitude times the extremes over gaps (k, nh), (k,); over a length where asked."""
        if self.pair_drive is None or self.wall_drive is None or self._checked is None or not len(values):
            return 0.0
        pairs, wall_start, radius = self._checked
        own, others = np.repeat(radius, np.diff(pairs.start)), radius[pairs.other]
        lengths = 2.0 * own * others / (own + others), 0.5 * np.repeat(radius, np.diff(wall_start))

        def part(amplitude: np.ndarray, most: np.ndarray | float, least: np.ndarray | float) -> np.ndarray:
            return np.maximum(amplitude * np.where(amplitude > 0.0, most, least), 0.0)

        places, most, least = np.arange(values.shape[1]), values.max(axis=0), values.min(axis=0)
        largest = 0.0
        for drive, length in zip((self.pair_drive, self.wall_drive), lengths, strict=True):
            at = drive[:, COLUMN]
            pull = part(drive[:, AMPLITUDE], np.interp(at, places, most), np.interp(at, places, least))
            if drive.shape[1] > ACROSS:
                pull += part(drive[:, ACROSS], float(across.max()), float(across.min()))
            if by_length:
                pull /= length
            largest = max(largest, float(pull.max(initial=0.0)))
        return largest

    def renew(self) -> None:
        """Say that what the drives follow from has changed: they are asked for before the next step."""
        self.pair_drive = self.wall_drive = None

    # -- what an engine calls

    def fetch(self, motion: GrainMotion) -> None:
        """Ask for the drives where they are not known, and check them.

        Raises
        ------
        ValueError
            For a shape that does not fit, a column outside of the table, a driven triangle.
        """
        n = motion.grains.count
        for name, array in self.per_grain.items():
            if len(array) != n:
                raise ValueError(f"{name} of the attraction has {len(array)} rows; it must have {n}, one a grain")
        if self.pair_drive is None or self.wall_drive is None:
            pair, wall = (np.ascontiguousarray(drive, dtype=float) for drive in self.drives(motion))
            slots = motion.listed_walls
            for name, drive, shape in (
                ("pairs", pair, (motion.listed_pairs.count, 3)),
                ("wall slots", wall, (len(slots.wall), 2)),
            ):
                if drive.shape != shape:
                    raise ValueError(f"the drives of {name} have shape {drive.shape}; they must be {shape}")
                at = drive[:, COLUMN]
                if not (np.isfinite(drive).all() and np.all((at >= 0.0) & (at <= self.values.shape[1] - 1))):
                    raise ValueError(
                        f"a drive of {name} is not finite, or its column is not one of 0 to {self.values.shape[1] - 1}"
                    )
            if wall[~slots.smooth, AMPLITUDE].any():
                raise ValueError("a triangle is driven; only planes and walls of revolution attract grains")
            self.pair_drive, self.wall_drive = pair, wall
            self._checked = None
        if self._checked is None:
            self._checked = motion.listed_pairs, motion.listed_walls.start, motion.grains.radius

    def permute(self, order: np.ndarray) -> None:
        """Put row ``order[k]`` of `per_grain` into place k."""
        for name, array in self.per_grain.items():
            self.per_grain[name] = np.ascontiguousarray(array[order])

    def wrap(self, rows: np.ndarray, wraps: np.ndarray, periodicity: Periodicity) -> None:
        """Take the vectors of the grains ``rows`` to their images by the shifts ``wraps``."""
        place = periodicity.at_strain(self.strain).place
        for name, array in self.per_grain.items():
            if array.ndim == 2 and array.shape[1] == 3:
                to_image = place if name == "position" else periodicity.turn
                array[rows] = to_image(array[rows], wraps)

    def lagged(self, contacts: ContactList, n: int, driven: bool = True) -> LaggedAttraction:
        """The argument of a step for ``n`` grains; not ``driven``: all amplitudes 0."""
        pair, wall = self.pair_drive, self.wall_drive
        if not driven or pair is None or wall is None:
            pair, wall = np.zeros((contacts.pairs.count, 3)), np.zeros((len(contacts.wall_other), 2))
        return LaggedAttraction(
            float(self.gap_start), 1.0 / self.gap_step, float(self.smallest_gap), self.last_gap, self.values,
            self.across, pair, wall, np.zeros((n, 4)), np.zeros((len(contacts.chunks.reaction), 4)),
        )  # fmt: skip

    def state(self) -> dict[str, np.ndarray]:
        """Drives and arrays of the grains, for the engine's state; the table and the callable are the caller's."""
        arrays = {f"{PREFIX}of_{name}": array.copy() for name, array in self.per_grain.items()}
        if self.pair_drive is not None and self.wall_drive is not None:
            arrays |= {f"{PREFIX}pair_drive": self.pair_drive.copy(), f"{PREFIX}wall_drive": self.wall_drive.copy()}
        return arrays | {f"{PREFIX}listed": np.array([self.listed]), f"{PREFIX}strain": np.array([self.strain])}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """The inverse of `state`."""
        first, self._checked = f"{PREFIX}of_", None
        self.per_grain = {name.removeprefix(first): state[name].copy() for name in state if name.startswith(first)}
        self.listed, self.strain = bool(state[f"{PREFIX}listed"][0]), float(state[f"{PREFIX}strain"][0])
        pair, wall = state.get(f"{PREFIX}pair_drive"), state.get(f"{PREFIX}wall_drive")
        self.pair_drive, self.wall_drive = None if pair is None else pair.copy(), None if wall is None else wall.copy()


def pull_stiffness_ratio(attraction: Attraction, contact: ContactLaw | PairLaws, radius: float | np.ndarray) -> float:
    """Negative stiffness of the present pulls over the contacts' own, of grains of ``radius`` [m], the smallest count.

    Own is that at the depth to which the strongest pull presses the softest contact. 0 without pulls.
    """
    if attraction.strongest == 0.0:
        return 0.0
    _, stiffness = _softest(attraction, contact, float(np.min(radius)))
    return attraction.stiffest / stiffness


def depth_warning(
    attraction: Attraction, contact: ContactLaw | PairLaws, radius: float | np.ndarray, limit: float = DEEPEST
) -> str | None:
    """Return a warning where the strongest pull presses a contact by more than ``limit`` of a radius; else None.

    A pull that holds on from a gap of some thousandths of a radius must not be drowned in the overlap of the contact.
    """
    smallest, pull = float(np.min(radius)), attraction.strongest
    if pull == 0.0:
        return None
    depth, stiffness = _softest(attraction, contact, smallest)
    if depth <= limit * smallest:
        return None
    percent = 100.0 * depth / smallest
    return (
        f"near grains attract each other with up to {pull:.3g} N, which presses a contact by {percent:.2g} % of the "
        f"radius (k_n = {stiffness:.3g} N/m); at most {100.0 * limit:g} % is usual: raise the stiffness"
    )


def _softest(attraction: Attraction, contact: ContactLaw | PairLaws, radius: float) -> tuple[float, float]:
    """Depth [m] of the softest contact under the strongest pull, and its stiffness there [N/m]."""
    table = contact if isinstance(contact, PairLaws) else PairLaws.of_one(contact)
    pressed = []
    for rows, r_eff in ((table.pair, 0.5 * radius), (table.wall, radius)):
        for law in (table.laws[k] for k in np.unique(rows)):
            depth = law.overlap_under(attraction.strongest, 1.0, 0.0, r_eff)
            pressed.append((depth, law.stiffness_at(depth, r_eff)))
    return max(depth for depth, _ in pressed), min(stiffness for _, stiffness in pressed)
