"""The space that grains are put into: boxes, the walls that keep them in, a sector of the ring."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geometry.box import Box
from geometry.centrifugal import Chamber
from geometry.triangle_wall import TriangleWall
from geometry.walls import AnnularBox, Wall
from particles.bodies import Body
from particles.errors import PackingError
from particles.sector import CyclicSector
from particles.walls.triangle_kernels import push_off_triangles, winding_number
from particles.walls.triangle_search import TriangleSearch
from particles.walls.wall_kernels import push_off_walls
from particles.walls.wall_table import triangle_table, wall_rows

Place = AnnularBox | Box
Near = tuple[np.ndarray, np.ndarray]  # triangles near each grain, in compressed rows

_RETHROWS = 200  # a place that is solid to nine tenths still gets all but 1e-9 of its grains


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """Space of a packing.

    Attributes
    ----------
    places : tuple of AnnularBox or Box
        What is to be filled; they do not overlap.
    walls : tuple of Wall
        Kept clear of.
    sector : CyclicSector or None
        The wedge of the ring that is simulated.
    """

    places: tuple[Place, ...]
    walls: tuple[Wall, ...]
    sector: CyclicSector | None = None
    _rows: np.ndarray = field(init=False, repr=False)
    _triangles: TriangleSearch = field(init=False, repr=False)
    _solids: tuple[np.ndarray, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        bodies = [Body(name) for name in dict.fromkeys(wall.body for wall in self.walls)]  # all at angle 0
        solids = [wall for wall in self.walls if isinstance(wall, TriangleWall) and wall.is_closed]
        object.__setattr__(self, "_rows", wall_rows(self.walls))
        object.__setattr__(self, "_triangles", TriangleSearch(triangle_table(self.walls, bodies)))
        rows = [triangle_table([solid], [Body(solid.body)]).rows for solid in solids]
        middle = np.array([_middle(place) for place in self.places])
        holds = [bool((np.abs(winding_number(middle, r, 0, len(r))) > 0.5).any()) for r in rows]
        object.__setattr__(self, "_solids", tuple(r for r, full in zip(rows, holds, strict=True) if not full))

    @classmethod
    def of(cls, boxes: Sequence[Place] | Place, walls: Sequence[Wall], sector: CyclicSector | None = None) -> Space:
        """The space of one box or several.

        Raises
        ------
        PackingError
            If there is no box.
        """
        places = (boxes,) if isinstance(boxes, AnnularBox | Box) else tuple(boxes)
        if not places:
            raise PackingError("no box to fill was given; name one at least")
        return cls(places, tuple(walls), sector)

    @property
    def angle(self) -> float:
        """Angle of the wedge [rad], 2 pi without a sector."""
        return 2.0 * math.pi if self.sector is None else self.sector.angle

    @property
    def volumes(self) -> np.ndarray:
        """Volume of each place inside the sector [m^3]."""
        return np.array([p.volume if isinstance(p, Box) else p.volume(self.angle) for p in self.places])

    @property
    def volume(self) -> float:
        """Volume of all places inside the sector [m^3]."""
        return float(self.volumes.sum())

    def solid_fraction(self, radius: np.ndarray) -> float:
        """Fraction of the volume that grains of ``radius`` (n,) [m] take."""
        return float(np.sum(4.0 / 3.0 * np.pi * radius**3) / self.volume)

    def triangles_near(self, position: np.ndarray, reach: np.ndarray) -> Near | None:
        """The triangles within ``reach`` (n,) [m] of each centre (n, 3) [m]; None where no wall is made of any."""
        table = self._triangles.table
        return self._triangles.near(position, reach, [0.0] * (len(table.first) - 1)) if table.count else None

    def push_off(self, position: np.ndarray, radius: np.ndarray, near: Near | None = None) -> float:
        """Move centres (n, 3) [m] out of the walls that they overlap, in place; the largest overlap met [m].

        ``near`` are triangles that `triangles_near` has found; looked for where they are not given.
        """
        worst = float(push_off_walls(position, radius, self._rows))
        near = self.triangles_near(position, radius) if near is None else near
        if near is not None:
            worst = max(worst, float(push_off_triangles(position, radius, self._triangles.table.rows, *near)))
        return worst

    def wall_overlap(self, position: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """Displacement by the walls of each grain [m], shape (n,); 0 where it is clear of all."""
        clear = np.array(position, dtype=float, order="C")
        self.push_off(clear, np.ascontiguousarray(radius))
        return np.sqrt(np.sum((clear - position) ** 2, axis=1))

    def in_solids(self, position: np.ndarray) -> np.ndarray:
        """True where centres lie inside a watertight triangle wall (a vane, a rib): bool, shape (n,).

        A triangle wall that holds a place to fill inside it, a drum, is a container and no solid.
        """
        inside = np.zeros(len(position), dtype=bool)
        for rows in self._solids:
            inside |= np.abs(winding_number(np.ascontiguousarray(position), rows, 0, len(rows))) > 0.5
        return inside

    def require_positive(self, radius: np.ndarray) -> np.ndarray:
        """Return the radii as floats (n,) [m].

        Raises
        ------
        PackingError
            If there is none, or one is not positive and finite.
        """
        size = np.array(radius, dtype=float).reshape(-1)
        if not len(size) or not (np.isfinite(size) & (size > 0.0)).all():
            raise PackingError(f"{len(size)} grains of radius {radius} m cannot be packed; both must be positive")
        return size

    def require_room(self, radius: np.ndarray, densest: float, why: str) -> None:
        """Refuse grains of ``radius`` (n,) [m] above a solid fraction.

        Raises
        ------
        PackingError
            If they fill more than ``densest``; ``why`` is the reason for that limit.
        """
        fraction = self.solid_fraction(radius)
        half_a_grain = 2.0 / 3.0 * np.pi * radius.max(initial=0.0) ** 3  # numbers are whole
        if fraction > densest + half_a_grain / self.volume:
            raise PackingError(
                f"{len(radius)} grains would fill {fraction:.3f} of the space of {self.volume * 1e9:.4g} mm^3; "
                f"allowed: at most {densest:.2f} ({why}); at this size at most "
                f"{int(len(radius) * densest / fraction)} grains fit: lower their number"
            )

    def throw(self, rng: np.random.Generator, radius: np.ndarray) -> np.ndarray:
        """Uniform random centres (n, 3) [m], a radius away from the faces of the boxes, not from those of the sector.

        Every place gets its part of the grains by volume.

        Raises
        ------
        PackingError
            If a place is thinner than the thickest grain.
        """
        counts = _counts_by_volume(self.volumes, len(radius))
        owner = np.repeat(np.arange(len(self.places)), counts)
        return np.concatenate([self._spread(rng, k, radius[owner == k]) for k in range(len(self.places)) if counts[k]])

    def scatter(self, rng: np.random.Generator, radius: np.ndarray) -> np.ndarray:
        """Throw grains as `throw`, but every grain draws its place by volume."""
        owner = rng.choice(len(self.places), len(radius), p=self.volumes / self.volume)
        centre = np.empty((len(radius), 3))
        for k in np.unique(owner):
            centre[owner == k] = self._spread(rng, int(k), radius[owner == k])
        return centre

    def _spread(self, rng: np.random.Generator, k: int, radius: np.ndarray) -> np.ndarray:
        """Uniform random centres in place k, none in a solid."""
        place = self.places[k]
        require_thickness(place, 2.0 * float(radius.max()))
        centre = self._spread_once(rng, place, radius)
        if self._solids:
            for _ in range(_RETHROWS):
                again = np.flatnonzero(self.in_solids(centre))
                if not len(again):
                    break
                centre[again] = self._spread_once(rng, place, radius[again])
        return centre

    def _spread_once(self, rng: np.random.Generator, place: Place, radius: np.ndarray) -> np.ndarray:
        u = rng.random((len(radius), 3))
        if isinstance(place, Box):
            low, high = place.lower + radius[:, None], place.upper - radius[:, None]
            return low + u * (high - low)
        inner, outer = place.r0 + radius, place.r1 - radius
        r = np.sqrt(inner**2 + u[:, 0] * (outer**2 - inner**2))
        first, last = opening(place, self.angle)
        theta = first + (last - first) * u[:, 1]
        if isinstance(place, Chamber):  # its two faces are walls
            side = np.minimum(np.arcsin(np.minimum(radius / r, 1.0)), 0.5 * (last - first))
            theta = first + side + (last - first - 2.0 * side) * u[:, 1]
        return np.stack([
            r * np.cos(theta), r * np.sin(theta),
            place.z0 + radius + u[:, 2] * (place.z1 - place.z0 - 2.0 * radius),
        ], axis=1)  # fmt: skip


def _counts_by_volume(volumes: np.ndarray, count: int) -> np.ndarray:
    """Whole numbers in proportion to ``volumes`` that add up to ``count`` (largest remainders)."""
    exact = count * volumes / volumes.sum()
    counts = np.floor(exact).astype(int)
    counts[np.argsort(counts - exact, kind="stable")[: count - counts.sum()]] += 1
    return counts


def _middle(place: Place) -> np.ndarray:
    """A point inside [m], shape (3,)."""
    if isinstance(place, Box):
        return 0.5 * (place.lower + place.upper)
    r, theta = 0.5 * (place.r0 + place.r1), 0.5 * sum(opening(place, 0.0))
    return np.array([r * math.cos(theta), r * math.sin(theta), 0.5 * (place.z0 + place.z1)])


def opening(place: AnnularBox, angle: float) -> tuple[float, float]:
    """First and last theta [rad] of a ring in a sector of ``angle``, or of a chamber between two vanes."""
    return (place.theta0, place.theta1) if isinstance(place, Chamber) else (0.0, angle)


def require_thickness(place: Place, thickest: float) -> None:
    """Refuse a place that a grain of diameter ``thickest`` [m] does not fit into.

    Raises
    ------
    PackingError
        If it is thinner.
    """
    thinnest = min(place.size) if isinstance(place, Box) else min(place.r1 - place.r0, place.z1 - place.z0)
    if thinnest < thickest:
        raise PackingError(
            f"the space is {thinnest * 1e3:.4g} mm thin, a grain is {thickest * 1e3:.4g} mm thick: none "
            "fits; lower the diameter or widen the gap"
        )
