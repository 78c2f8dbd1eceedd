"""The grains' moments in the field of a device with slots or teeth: see `coupling.powder_feedback`.

The field stands still in the frame of the slotted body, into which the grains are turned; their smear
(`coupling.smeared_grains_3d`) has the symmetry of its mesh. A grain takes H = -grad of the total potential, which has
no jump where powder begins.

At a steel face the smear is folded back as in the section, where the mirror point lies in steel: not over a slot, and
with k of the teeth. The pairs' images have one k for a face, its mean over teeth and slots.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from coupling.powder_feedback import PowderFeedback
from coupling.smear_region import magnetic_regions
from coupling.smeared_grains_3d import smear_3d
from coupling.turning_sampler import TurningSampler, turn_of
from field import MU_0, PowderState
from field.three_d import Field3D


class PowderFeedback3D(PowderFeedback):
    """Deposits grains on the powder's tetrahedra; see `PowderFeedback`, whose `problem` is a `Problem3D`."""

    DIMENSIONS = 3

    def _place(self) -> np.ndarray:
        basis = self.problem.powder_basis
        self._points = np.ascontiguousarray(np.asarray(basis.global_coordinates()).reshape(3, -1).T)
        self._mirrored = [self._mirror(row) for row in self._steel]
        self._every = np.concatenate((self._points, *(mirror for _, mirror, _, _ in self._mirrored)))
        return basis.dx

    def _mirror(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points whose mirror in a wall lies in steel: which, their mirrors, R/r of both, and the wall's normals."""
        problem, x = self.problem, self._points
        r0, z0, t_r, t_z, length, _ = row
        r = np.hypot(x[:, 0], x[:, 1])
        along, h = (r - r0) * t_r + (x[:, 2] - z0) * t_z, -(r - r0) * t_z + (x[:, 2] - z0) * t_r
        R = r + 2.0 * h * t_z
        near = np.flatnonzero((along >= 0.0) & (along <= length) & (np.abs(h) < self.width) & (R > 0.0))
        ratio = (R / np.where(r > 0.0, r, 1.0))[near]
        mirror = np.column_stack((x[near, :2] * ratio[:, None], x[near, 2] - 2.0 * h[near] * t_r))
        steel = np.zeros(len(problem.mesh.tetrahedra), dtype=bool)
        for region in magnetic_regions(problem.laws):
            steel[problem.mesh.regions[region]] = True
        element, _ = problem.locator.find(mirror)
        kept = (element >= 0) & steel[element]
        own = near[kept]
        normal = np.column_stack((-t_z * x[own, :2] / r[own, None], np.full(len(own), t_r)))
        return own, np.ascontiguousarray(mirror[kept]), ratio[kept], normal

    def _spread(self, position: np.ndarray, volume: np.ndarray, moment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert self.carrier is not None  # of every field in 3D
        turn = turn_of(self.carrier)
        copies = 2.0 * np.pi / self.angle / self.problem.mesh.n_sectors
        amounts = copies * np.column_stack((volume, moment @ turn))
        smeared = smear_3d(self._every, position @ turn, amounts, self.width, self.problem.fold)
        total, begin = smeared[:, : len(self._points)].copy(), len(self._points)
        for (own, mirror, ratio, normal), row in zip(self._mirrored, self._steel, strict=True):
            there = ratio * smeared[:, begin : begin + len(mirror)]
            begin += len(mirror)
            across = (there[1:] * normal.T).sum(axis=0)
            total[0, own] += there[0]
            total[1:, own] += row[5] * (2.0 * across * normal.T - there[1:])
        shape = self._volume.shape
        return total[0].reshape(shape), np.ascontiguousarray(total[1:].reshape(3, *shape).transpose(1, 0, 2))

    def _take_smear(self, position: np.ndarray, volume: np.ndarray, moment: np.ndarray) -> None:
        pass  # H at the grains is that of the potential

    def _law_part(self, powder: PowderState, H: np.ndarray) -> np.ndarray:
        size = np.sqrt((H * H).sum(axis=1))
        phi, N = powder.arguments
        against = (self.law.demagnetising_factors(phi)[0] if N is None else N) - phi
        M = phi * self.law.from_flux(MU_0 * size, phi, against)[0]
        return np.divide(M, size, out=np.zeros_like(size), where=size > 0.0)[:, None, :] * H

    def _strength(self, field: Field3D) -> np.ndarray:
        basis = self.problem.powder_basis
        T0 = self.problem.elements.split(self.problem.unit_T0)[-1]
        return (field.ampere_turns * T0 - basis.interpolate(field.phi).grad).transpose(1, 0, 2)

    def magnetisation(self, field: Field3D) -> np.ndarray:
        """Magnetisation (m, 3, q) [A/m] of the powder in a solved field."""
        powder = field.powder
        if powder is None:
            return np.zeros_like(self._M)
        by_law = self._law_part(powder, self._strength(field))
        return by_law if powder.source is None else by_law + powder.source

    def _is_on(self, field: Field3D) -> bool:
        return bool(field.phi.any())

    def sampler_after_solve(self, field: Field3D) -> TurningSampler:
        """Sampler of H at grains in a solved field."""
        return self.sampler(field)

    def sampler(self, field: Field3D) -> TurningSampler:
        """The sampler of the last `sampler_after_solve`."""
        assert self.carrier is not None
        return TurningSampler(field.sampler(), self.carrier)

    def _of_the_sampler(self) -> dict[str, Any]:
        return {}
