"""The state of the grains, in records as the step reads them.

Velocities are those of the leapfrog: ``velocity`` and ``angular_velocity`` belong to the time half a step
*before* ``position`` (see `particles.dem.step_kernel`).
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.aligned_arrays import aligned_zeros

RECORDS = ("position_radius", "velocity_force", "mass", "particle_id")
"""The arrays of `Grains` that are always there."""

MOMENTS = ("magnetic_moment", "dipole")
"""Vectors of `Grains` that may be there: sorted with the grains, and turned where one is wrapped."""


class Grains:
    """Spheres, in the order in which they lie in memory.

    Attributes
    ----------
    position_radius : ndarray, shape (n, 4)
        Centre and radius [m] in one row: what a neighbour reads first.
    velocity_force : ndarray, shape (n, 12)
        Velocity [m/s], spin [rad/s], and the places where a step gathers force [N] and torque [N m].
    mass : ndarray, shape (n,)
        [kg]; the inertia is that of a solid sphere, 2/5 m R^2.
    particle_id : ndarray of int64, shape (n,)
        Number of each grain; it stays with the grain when the arrays are sorted.
    magnetic_moment : ndarray, shape (n, 3), or None
        Whole moment [A m^2]; None in a scene without magnetism.
    dipole : ndarray, shape (n, 3), or None
        What a dipole at the centre has of it [A m^2]; the rest is that of charges, of flux that leaves through
        contacts. None: all of it.
    """

    __slots__ = ("dipole", "magnetic_moment", "mass", "particle_id", "position_radius", "velocity_force")

    def __init__(
        self,
        position: np.ndarray,
        velocity: np.ndarray,
        angular_velocity: np.ndarray,
        radius: np.ndarray,
        mass: np.ndarray,
        particle_id: np.ndarray,
        magnetic_moment: np.ndarray | None = None,
    ) -> None:
        """From arrays of shapes (n, 3), (n, 3), (n, 3), (n,), (n,), (n,), (n, 3); `create` checks them."""
        self.position_radius = aligned_zeros((len(radius), 4))
        self.position_radius[:, :3], self.position_radius[:, 3] = position, radius
        self.velocity_force = aligned_zeros((len(radius), 12))
        self.velocity_force[:, :3], self.velocity_force[:, 3:6] = velocity, angular_velocity
        self.mass, self.particle_id, self.magnetic_moment = mass, particle_id, magnetic_moment
        self.dipole: np.ndarray | None = None

    @classmethod
    def of_records(cls, records: dict[str, np.ndarray]) -> Grains:
        """Grains of the RECORDS of a checkpoint's state, all of them copied."""
        position_radius, velocity_force = records["position_radius"], records["velocity_force"]
        return cls(
            position_radius[:, :3], velocity_force[:, :3], velocity_force[:, 3:6], position_radius[:, 3],
            records["mass"].copy(), records["particle_id"].copy(),
        )  # fmt: skip

    @property
    def position(self) -> np.ndarray:
        """Centres [m], Cartesian, z along the shaft: a view of `position_radius`, shape (n, 3)."""
        return self.position_radius[:, :3]

    @position.setter
    def position(self, value: np.ndarray) -> None:
        self.position_radius[:, :3] = value

    @property
    def radius(self) -> np.ndarray:
        """Radii [m]: a view of `position_radius`, shape (n,)."""
        return self.position_radius[:, 3]

    @radius.setter
    def radius(self, value: np.ndarray) -> None:
        self.position_radius[:, 3] = value

    @property
    def velocity(self) -> np.ndarray:
        """Velocities of the centres [m/s]: a view of `velocity_force`, shape (n, 3)."""
        return self.velocity_force[:, :3]

    @velocity.setter
    def velocity(self, value: np.ndarray) -> None:
        self.velocity_force[:, :3] = value

    @property
    def angular_velocity(self) -> np.ndarray:
        """Spins [rad/s]: a view of `velocity_force`, shape (n, 3)."""
        return self.velocity_force[:, 3:6]

    @angular_velocity.setter
    def angular_velocity(self, value: np.ndarray) -> None:
        self.velocity_force[:, 3:6] = value

    @classmethod
    def create(
        cls,
        position: np.ndarray,
        radius: float | np.ndarray,
        density: float | np.ndarray,
        *,
        velocity: np.ndarray | None = None,
        angular_velocity: np.ndarray | None = None,
    ) -> Grains:
        """Grains of ``radius`` [m] and ``density`` [kg/m^3] (scalars or shape (n,)), by default at rest.

        Raises
        ------
        ValueError
            For a shape that does not fit, a value that is not finite, or a radius or density that is not
            positive.
        """
        x = np.array(position, dtype=np.float64, order="C").reshape(-1, 3)
        count = len(x)
        if count == 0:
            raise ValueError("no grain was given: position is empty; raise the number of grains to 1 or more")
        r = np.array(np.broadcast_to(np.asarray(radius, dtype=np.float64), (count,)))
        rho = np.broadcast_to(np.asarray(density, dtype=np.float64), (count,))
        for name, value, unit in (("radius", r, "m"), ("density", rho, "kg/m^3")):
            bad = ~(np.isfinite(value) & (value > 0.0))
            if bad.any():
                raise ValueError(f"{name} of a grain must be positive, got {value[bad][0]:g} {unit}")
        v, w = (
            np.zeros((count, 3)) if given is None else np.array(given, dtype=np.float64, order="C").reshape(count, 3)
            for given in (velocity, angular_velocity)
        )
        for name, value in (("position", x), ("velocity", v), ("angular_velocity", w)):
            if not np.isfinite(value).all():
                k = int(np.flatnonzero(~np.isfinite(value).all(axis=1))[0])
                raise ValueError(f"{name} of grain {k} is not finite: {value[k]}")
        return cls(x, v, w, r, rho * (4.0 / 3.0 * np.pi) * r**3, np.arange(count, dtype=np.int64))

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.radius)

    @property
    def volume(self) -> np.ndarray:
        """Volume of each grain [m^3], shape (n,)."""
        return 4.0 / 3.0 * np.pi * self.radius**3

    @property
    def inertia(self) -> np.ndarray:
        """Moment of inertia of each grain about its centre [kg m^2], shape (n,)."""
        return 0.4 * self.mass * self.radius**2

    def kinetic_energy(self) -> float:
        """Translation and spin [J]."""
        velocity, spin = (np.einsum("ij,ij->i", v, v) for v in (self.velocity, self.angular_velocity))
        return 0.5 * float(self.mass @ velocity + self.inertia @ spin)

    def momentum(self) -> np.ndarray:
        """Sum of m v [kg m/s], shape (3,)."""
        return self.mass @ self.velocity

    def angular_momentum_z(self) -> float:
        """Orbital and spin angular momentum about the shaft axis [kg m^2/s]."""
        x, v = self.position, self.velocity
        orbital = self.mass @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])
        return float(orbital + self.inertia @ self.angular_velocity[:, 2])

    def permute(self, order: np.ndarray) -> None:
        """Put grain ``order[k]`` into place k in every array."""
        for name in RECORDS:
            old = getattr(self, name)
            new = aligned_zeros(old.shape) if old.ndim > 1 else np.empty_like(old)
            setattr(self, name, old.take(order, axis=0, out=new, mode="clip"))  # else numpy takes a copy besides
        for name in MOMENTS:
            if (vectors := getattr(self, name)) is not None:
                setattr(self, name, vectors.take(order, axis=0))
