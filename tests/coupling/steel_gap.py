"""Grains over a steel face, or between two, in a uniform field: section, walls and the series of their images."""

import numpy as np
from fed_back_grains import A, D, fed_back, powder_problem
from graded_lines import graded_lines
from section_grid import section_grid

from field import MU_0, LinearLaw
from geometry import RevolvedWall

FAR = 300.0 * D


class SteelGap:
    """Steel below z = 0 and, with a `gap` [m], above it, out to where the field is uniform.

    Parameters
    ----------
    radii : (float, float)
        Of the part that holds powder [m].
    gap : float or None
        None: one face only, with 9 d of powder's region over it.
    size : float
        Of the elements there [m].
    """

    def __init__(self, radii, gap=None, *, size=0.5 * D, permeability=1e5):
        self.gap, self.top = gap, 9.0 * D if gap is None else gap
        r = graded_lines(size, radii, (0.0, FAR), 2.0)
        z = graded_lines(self.top / round(self.top / size), (0.0, self.top), (-FAR, FAR), 2.0)
        regions = {"floor": (0.0, FAR, -FAR, 0.0), "powder": (*radii, 0.0, self.top)}
        self.laws = {"floor": LinearLaw(permeability)}
        self.walls = [RevolvedWall("floor", "housing", (radii[0], 0.0), (radii[1], 0.0), magnetic=True)]
        if gap is not None:
            regions["roof"] = (0.0, FAR, gap, FAR)
            self.laws["roof"] = LinearLaw(permeability)
            self.walls.append(RevolvedWall("roof", "housing", (radii[0], gap), (radii[1], gap), magnetic=True))
        self.mesh = section_grid(r, z, regions)
        self._problems = {}

    def fed_back(self, law, position, width, H, **more):
        if width not in self._problems:
            self._problems[width] = powder_problem(self.mesh, law, width, self.laws)
        problem = self._problems[width]
        return fed_back(problem, law, position, A, width, walls=self.walls, boundary_field=MU_0 * H, **more)

    def images(self, most=30):
        """For `all_pairs`: both faces mirror, and mirror each other's images, `most` times."""
        flip, same = np.diag([-1.0, -1.0, 1.0]), np.eye(3)

        def of(x):
            down = x * [1.0, 1.0, -1.0]
            if self.gap is None:
                return [(x, same), (down, flip)]
            result = []
            for k in sorted(range(-most, most + 1), key=abs):
                up = [0.0, 0.0, 2.0 * k * self.gap]
                result += [(x + up, same), (down + up, flip)]
            return result

        return of
