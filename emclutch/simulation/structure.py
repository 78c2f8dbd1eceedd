"""Structure of the grains at the end of a run: contacts per grain, their directions, force chains."""

from __future__ import annotations

import math
from typing import Any

from particles.diagnostics.coordination import coordination
from particles.diagnostics.fabric import fabric
from particles.diagnostics.force_chains import force_chains


def structure_summary(motion: Any) -> dict[str, float | None]:
    """Measures of the packing as the grains stand, see `particles.diagnostics`; None where there is no contact.

    ``coordination`` contacts a grain, walls included; ``rattlers`` share of grains with fewer than two;
    ``fabric_anisotropy`` and ``force_anisotropy`` of the directions of contacts between grains along (r, phi, z), each
    alike and weighed by normal force: 0 isotropic, 1 all parallel; ``in_chains`` share of grains in force chains;
    ``longest_chain`` grains in the longest.
    """
    grains, sector, contacts = motion.grains, motion.sector, motion.contacts()
    standing, chains = coordination(contacts, grains.count), force_chains(grains, contacts, sector)
    weighed = fabric(grains, contacts, sector, force_weighted=True)
    found = {
        "coordination": standing.mean,
        "rattlers": standing.rattlers,
        "fabric_anisotropy": fabric(grains, contacts, sector).ring_anisotropy,
        "force_anisotropy": weighed.ring_anisotropy,
        "in_chains": chains.share,
        "longest_chain": float(chains.lengths.max(initial=0)),
    }
    return {name: float(value) if math.isfinite(value) else None for name, value in found.items()}
