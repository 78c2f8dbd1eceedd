"""All diagnostics of a moment in one call.

    from particles.diagnostics.grain_diagnostics import grain_diagnostics
    found = grain_diagnostics(dem, totals=dem.run(1000))
    found.coordination.mean, found.fabric.anisotropy, found.profile.solid_fraction

Nothing is changed: a run goes on bit for bit as if it had not been asked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from particles.dem.dem import DEM
from particles.dem.step_totals import StepTotals
from particles.diagnostics.bins import Bins, SlabBins, even_edges, ring_bins
from particles.diagnostics.coordination import Coordination, coordination
from particles.diagnostics.enclosed_space import BoxSpace, Space, enclosed_space
from particles.diagnostics.fabric import Fabric, fabric
from particles.diagnostics.force_chains import ForceChains, force_chains, force_distribution
from particles.diagnostics.grain_energies import GrainEnergies, grain_energies
from particles.diagnostics.inertial_number import inertial_number
from particles.diagnostics.profiles import Profile, profile_of, profile_sums
from particles.diagnostics.stress import Stress, contact_stress
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable


@dataclass(frozen=True, slots=True, eq=False)
class GrainDiagnostics:
    """Diagnostics of the grains at ``time`` [s].

    Attributes
    ----------
    energies : GrainEnergies
        Of the whole device.
    coordination : Coordination
    fabric, force_fabric : Fabric
        Of the contacts between grains, each alike, and weighed by normal force.
    stress : Stress
        Of the contacts, over `space`.
    chains : ForceChains
    force_edges, force_density : ndarray
        P(f) of the normal forces over their mean.
    profile : Profile
        Across the gap: against the radius in a ring, against z in a box.
    inertial_number : float or None
        Of the space as a whole: mean shear rate (by volume of grains) and mean pressure; None where nothing presses.
    space : AnnularBox or BoxSpace
    contacts : ContactTable
    """

    time: float
    energies: GrainEnergies
    coordination: Coordination
    fabric: Fabric
    force_fabric: Fabric
    stress: Stress
    chains: ForceChains
    force_edges: np.ndarray
    force_density: np.ndarray
    profile: Profile
    inertial_number: float | None
    space: Space
    contacts: ContactTable


def grain_diagnostics(
    dem: DEM, *, space: Space | None = None, bins: Bins | None = None, totals: StepTotals | None = None
) -> GrainDiagnostics:
    """Diagnose a DEM as it stands.

    Parameters
    ----------
    space : AnnularBox or BoxSpace, optional
        Where the stress is averaged and the profile taken; default: what the walls enclose.
    bins : optional
        Of the profile; default: one grain's diameter wide, against r in a ring, against z in a box.
    totals : StepTotals, optional
        Of the last run, for the elastic energy.
    """
    grains, sector, contacts = dem.grains, dem.sector, dem.contacts()
    angle = 2.0 * math.pi if sector is None else sector.angle
    where = enclosed_space(grains, dem.walls, ring=True if sector else None) if space is None else space
    volume = where.volume if isinstance(where, BoxSpace) else where.volume(angle)
    across = default_bins(where, 2.0 * float(np.mean(grains.radius)), angle) if bins is None else bins
    profile = profile_of(profile_sums(grains, contacts, across, sector), across, {b.name: b.speed for b in dem.bodies})
    edges, density = force_distribution(grains, contacts, sector)
    return GrainDiagnostics(
        time=dem.time,
        energies=grain_energies(
            grains, dem.gravity_now, sector, elastic=None if totals is None else totals.energy_budget.elastic_energy
        ),
        coordination=coordination(contacts, grains.count),
        fabric=fabric(grains, contacts, sector),
        force_fabric=fabric(grains, contacts, sector, force_weighted=True),
        stress=contact_stress(grains, contacts, volume, sector),
        chains=force_chains(grains, contacts, sector),
        force_edges=edges,
        force_density=density,
        profile=profile,
        inertial_number=mean_inertial_number(profile, grains),
        space=where,
        contacts=contacts,
    )


def default_bins(space: Space, width: float, angle: float) -> Bins:
    """Bins of about ``width`` [m]: against r in a ring (a sector of ``angle`` [rad]), against z in a box."""
    if isinstance(space, BoxSpace):
        side = space.upper - space.lower
        return SlabBins(2, 0, even_edges(space.lower[2], space.upper[2], width), float(side[0] * side[1]))
    return ring_bins(space, width, angle=angle)


def mean_inertial_number(profile: Profile, grains: Grains) -> float | None:
    """Of the whole profile: mean |shear rate| and pressure, each weighed by the grains' volume in the bins."""
    weight = profile.solid_fraction * profile.volume
    known = np.isfinite(profile.shear_rate) & (weight > 0.0)
    if not known.any():
        return None
    rate, pressure = (
        float(np.average(v[known], weights=weight[known])) for v in (np.abs(profile.shear_rate), profile.pressure)
    )
    diameter = 2.0 * float(np.average(grains.radius, weights=grains.volume))
    found = float(inertial_number(rate, diameter, grains.mass.sum() / grains.volume.sum(), pressure))
    return found if math.isfinite(found) else None
