"""lambda(i) of a coil as a fine sweep gives it: the oracle of transients."""

import numpy as np
from scipy.interpolate import PchipInterpolator


def current_of_linkage(problem, turns, largest, points):
    """Current [A] as a function of the flux linkage [Wb], 0 to that of the `largest` current [A]; monotone cubics."""
    currents = largest * np.linspace(0.0, 1.0, points) ** 1.5  # dense at small currents, where iron opens
    linkages, field = np.zeros(points), None
    for k, current in enumerate(currents[1:], start=1):
        field = problem.solve(turns * current, None, field)
        linkages[k] = turns * field.flux_linkage_per_turn
    return PchipInterpolator(linkages, currents)
