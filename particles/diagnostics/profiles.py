"""Profiles across a gap: fill, flow, stress and torque in bins, averaged over as many moments as wished.

`profile_sums` takes what adds up from one moment; sums of several moments add (``+``); `profile_of` divides. Of a bin
with grains i of mass m_i, a fraction w_i of each by volume:

- flow: with v the velocity along the flow and l the distance from the axis (1 in a box), the angular speed
  q = sum w m l v / sum w m l^2 (in a box the mean velocity) belongs to s = sum w m l^2 s_i / sum w m l^2. A rigid
  rotation gives exactly its speed and no shear; so does a q linear in s its slope.
- shear rate gamma = l dq/ds by differences of neighbouring bins (central, one-sided at the ends).
- fluctuation c = v - v_mean, v_mean interpolated linearly in s at each grain, so that shear across a bin is no
  temperature. Temperature T = sum w m c^2 / (3 sum w m). Taking the mean from the same grains costs a fraction of T of
  about one over the grains in a bin.
- stress sigma = (sum of contacts + sum w m c c)/V, contacts by Love and Weber, -f l with l the branch from
  centre to centre or to the wall, compression positive, along (flow, gradient, third) at each contact's point.
- shear stress tau = -sigma_flow,gradient: positive where the far side (larger s) drives the near one along the flow.
- mu = |tau|/p and I = |gamma| d sqrt(rho/p) (GDR MiDi, Eur. Phys. J. E 14 (2004) 341), p a third of the trace, d the
  mean diameter by volume, rho the density of the grains themselves.
- torque: what the contacts carry across the surfaces s = const of the bin, in the mean over the bin. A contact carries
  (x_c x f)_z across every surface between its two ends. With grains at rest, or in steady flow slow enough that motion
  carries no angular momentum, it is the same across every surface, and at a wall it is the wall's: to round-off.
  Magnetic pair forces and the torques of rolling and twisting friction carry torque as well and are not in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from scipy.sparse import diags_array

from particles.diagnostics.bins import Bins, contact_fractions
from particles.diagnostics.contact_geometry import contact_geometry
from particles.diagnostics.inertial_number import friction_coefficient, inertial_number
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.sector import CyclicSector


@dataclass(frozen=True, slots=True, eq=False)
class ProfileSums:
    """Sums over grains and contacts in each of b bins at one moment, or at several.

    Attributes
    ----------
    moments : ndarray, shape (1,)
        How many were added.
    volume, mass : ndarray, shape (b,)
        Of the grains [m^3, kg].
    lever_mass, lever_position, lever_speed : ndarray, shape (b,)
        Sums of w m l^2 [kg m^2], w m l^2 s, and w m l v.
    diameter, spin : ndarray, shape (b,)
        Sums of w d [m^4] and of w m omega_z [kg rad/s].
    fluctuation, contact : ndarray, shape (b, 3, 3)
        Sums of w m c c and of -f l [N m], along (flow, gradient, third).
    torque : ndarray, shape (b,)
        Carried by the contacts [N m], full ring (a force [N] in a box).
    contacts : ndarray, shape (b,)
        Contacts, each by its part of the line.
    """

    moments: np.ndarray
    volume: np.ndarray
    mass: np.ndarray
    lever_mass: np.ndarray
    lever_position: np.ndarray
    lever_speed: np.ndarray
    diameter: np.ndarray
    spin: np.ndarray
    fluctuation: np.ndarray
    contact: np.ndarray
    torque: np.ndarray
    contacts: np.ndarray

    def __add__(self, other: ProfileSums) -> ProfileSums:
        return ProfileSums(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """Quantities in each of b bins, all shape (b,); nan where a bin has none.

    Attributes
    ----------
    along : str
        Coordinate across: "r", "z", or "x", "y", "z" of a box.
    low, high, position : ndarray
        Edges of the bin, and the mean coordinate of its grains [m].
    volume, solid_fraction : ndarray
        Of the bin in what is simulated [m^3]; fraction of it that grains fill [-].
    velocity, angular_speed, spin : ndarray
        Along the flow [m/s]; angular speed about z [rad/s] (nan in a box); spin of the grains about z [rad/s].
    slip : dict of body -> ndarray
        (angular speed - that of the body) times the distance from the axis [m/s].
    temperature : ndarray
        A third of the mean square of the velocity's fluctuation [m^2/s^2].
    shear_rate : ndarray
        [1/s]
    pressure, normal_stress, shear_stress : ndarray
        A third of the trace; across the gap; tau [Pa].
    mu, inertial_number : ndarray
        |tau|/p and |shear rate| d sqrt(rho/p) [-].
    torque : ndarray
        Carried by contacts, on what is nearer to s = 0 by what is farther, full ring [N m]; a force [N] in a box.
    contacts : ndarray
        Contacts in a bin at a moment.
    moments : int
        Moments in the mean.
    """

    along: str
    low: np.ndarray
    high: np.ndarray
    position: np.ndarray
    volume: np.ndarray
    solid_fraction: np.ndarray
    velocity: np.ndarray
    angular_speed: np.ndarray
    spin: np.ndarray
    slip: dict[str, np.ndarray]
    temperature: np.ndarray
    shear_rate: np.ndarray
    pressure: np.ndarray
    normal_stress: np.ndarray
    shear_stress: np.ndarray
    mu: np.ndarray
    inertial_number: np.ndarray
    torque: np.ndarray
    contacts: np.ndarray
    moments: int


def profile_sums(grains: Grains, contacts: ContactTable, bins: Bins, sector: CyclicSector | None = None) -> ProfileSums:
    """Contribution of one instant to a profile in ``bins``."""
    part = bins.grain_volumes(grains)
    x = grains.position
    s, lever = bins.coordinate(x), bins.lever(x)
    velocity = np.einsum("kab,kb->ka", bins.axes(x), grains.velocity)
    weighed = part @ _diagonal(grains.mass / grains.volume)
    mass, lever_mass = weighed.sum(axis=1), weighed @ lever**2
    lever_position, lever_speed = weighed @ (lever**2 * s), weighed @ (lever * velocity[:, 0])
    q = _over(lever_speed, lever_mass)
    at = _over(lever_position, lever_mass)
    mean = np.stack([lever * _along(s, at, q), *(_along(s, at, _over(weighed @ velocity[:, k], mass)) for k in (1, 2))])
    c = velocity - mean.T

    force, geometry = contacts.force, contact_geometry(grains, contacts, sector)
    start, end = bins.coordinate(geometry.start), bins.coordinate(geometry.end)
    axes = bins.axes(contacts.point)
    f, branch = (np.einsum("kab,kb->ka", axes, v) for v in (force, geometry.branch))
    fraction = contact_fractions(start, end, bins.edges) @ _diagonal(bins.holds(contacts.point).astype(float))
    carried = (end - start) * bins.moment(contacts.point, force)
    return ProfileSums(
        moments=np.ones(1),
        volume=part.sum(axis=1),
        mass=mass,
        lever_mass=lever_mass,
        lever_position=lever_position,
        lever_speed=lever_speed,
        diameter=part @ (2.0 * grains.radius),
        spin=weighed @ grains.angular_velocity[:, 2],
        fluctuation=(weighed @ _products(c, c)).reshape(-1, 3, 3),
        contact=-(fraction @ _products(f, branch)).reshape(-1, 3, 3),
        torque=bins.n_sectors * (fraction @ carried) / np.diff(bins.edges),
        contacts=fraction.sum(axis=1),
    )


def profile_of(sums: ProfileSums, bins: Bins, speeds: Mapping[str, float] | None = None) -> Profile:
    """The profile that ``sums`` hold; ``speeds`` [rad/s] of bodies give the slips (none in a box)."""
    moments = float(sums.moments[0])
    volume = moments * bins.volumes
    q, at = _over(sums.lever_speed, sums.lever_mass), _over(sums.lever_position, sums.lever_mass)
    is_ring = bool(np.any(bins.lever(np.array([[2.0, 0.0, 0.0]])) != 1.0))
    lever = at if bins.along == "r" else np.sqrt(_over(sums.lever_mass, sums.mass))
    rate = lever * _slope(at, q)
    stress = (sums.contact + sums.fluctuation) / volume[:, None, None]
    pressure, tau = np.trace(stress, axis1=1, axis2=2) / 3.0, -stress[:, 0, 1]
    density, diameter = _over(sums.mass, sums.volume), _over(sums.diameter, sums.volume)
    return Profile(
        along=bins.along,
        low=bins.edges[:-1],
        high=bins.edges[1:],
        position=at,
        volume=bins.volumes,
        solid_fraction=sums.volume / volume,
        velocity=lever * q,
        angular_speed=q if is_ring else np.full_like(q, np.nan),
        spin=_over(sums.spin, sums.mass),
        slip={name: lever * (q - speed) for name, speed in (speeds or {}).items()} if is_ring else {},
        temperature=_over(np.trace(sums.fluctuation, axis1=1, axis2=2), 3.0 * sums.mass),
        shear_rate=rate,
        pressure=pressure,
        normal_stress=stress[:, 1, 1],
        shear_stress=tau,
        mu=friction_coefficient(tau, pressure),
        inertial_number=inertial_number(rate, diameter, density, pressure),
        torque=sums.torque / moments,
        contacts=sums.contacts / moments,
        moments=round(moments),
    )


def _diagonal(values: np.ndarray):
    return diags_array(values, format="csr")


def _products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a_k b_l of each row, shape (n, 9)."""
    return (a[:, :, None] * b[:, None, :]).reshape(-1, 9)


def _over(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a/b, nan where b is 0: a bin without grains has no mean."""
    return np.divide(a, b, out=np.full(np.shape(a), np.nan), where=b > 0.0)


def _along(s: np.ndarray, at: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Piecewise linear through the bins' means, continued beyond the first and the last; at each s."""
    known = np.isfinite(at)
    at, value = at[known], value[known]
    apart = _apart(at)
    at, value = at[apart], value[apart]
    if len(at) < 2:
        return np.full(len(s), value[0] if len(value) else 0.0)
    k = np.clip(np.searchsorted(at, s) - 1, 0, len(at) - 2)
    return value[k] + (value[k + 1] - value[k]) / (at[k + 1] - at[k]) * (s - at[k])


def _slope(at: np.ndarray, value: np.ndarray) -> np.ndarray:
    """d value/d at over the bins that have grains; nan where fewer than two have, or the same ones."""
    slope, known = np.full(len(at), np.nan), np.isfinite(at)
    apart = _apart(at[known])
    if np.count_nonzero(apart) > 1:
        gradient = np.gradient(value[known][apart], at[known][apart])
        slope[known] = gradient[np.cumsum(apart) - 1]
    return slope


def _apart(at: np.ndarray) -> np.ndarray:
    """True where the increasing means lie beyond the one before; a lone grain in two bins is the mean of both."""
    return np.append(True, np.diff(at) > 1e-9 * np.abs(at).max(initial=0.0))[: len(at)]
