"""[effects.dipoles]: attraction between magnetised grains (`coupling.mutual_moments`, `coupling.Dipoles`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from emclutch.effects.effect import EffectSection, Load
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import FIELD_STRENGTH_POWDER, STEPS, Column, When
from emclutch.scene.errors import Fault
from emclutch.scene.grain_smear import (
    MIN_WIDTH,
    TRUE_WIDTH,
    layers_change_the_field,
    moments_are_fed_back,
    narrowest_gap,
    smear_width,
)
from emclutch.scene.partial_scene import PartialScene, size_key
from emclutch.scene.section import Automatic, Choice, Integer
from emclutch.scene.units import number

if TYPE_CHECKING:
    from coupling import MagnetisedGrains
    from emclutch.scene.model import Scene
    from geometry.walls import Wall
    from particles import GrainMotion

STRONGEST_FIELD, MOST_CONTACTS = 0.12, 6
"""Of near_field against finite elements: H in the powder over the saturation up to which (200 kA/m in iron), and
contacts of a grain up to which its forces are within 15 % (`coupling.mutual_moments`).
"""

CROWDED = 0.05
"""Fraction of the grains with more contacts that is reported."""

SKIN = 0.25
"""Grain diameters beyond the cut-off: how far rows of neighbours reach."""


def _valid_moments(partial: PartialScene) -> Iterator[Fault]:
    """Check the requirements of mutual magnetisation, and what it excludes."""
    effects, particles = partial.scene.effects, partial.scene.particles
    attraction = effects.attraction
    if attraction is None:
        return
    prescribed = partial.scene.prescribed_field
    if particles.law == "thesis":
        yield Fault(
            "effects.dipoles",
            "",
            "cannot be used with particles.law = 'thesis': M = chi H is not the law of a material, so grains cannot "
            "magnetise one another; remove [effects.dipoles] and keep [effects.magnetic_force], or take law = 'sphere'",
        )
    if attraction.has_necks and not effects.saturate:
        yield partial.fault(
            "effects.dipoles.model",
            f"needs grains that saturate; add {effects.tables(saturates=True)}, or take model = 'mutual'",
        )
    if attraction.has_necks and attraction.cutoff < TRUE_WIDTH:
        yield partial.fault(
            "effects.dipoles.cutoff",
            "is too small: the field of necks reaches further than that of dipoles; allowed "
            f"with model = 'near_field': at least {TRUE_WIDTH:g} diameters",
        )
    elif prescribed is not None and prescribed.is_macroscopic and attraction.cutoff < MIN_WIDTH:
        yield partial.fault(
            "effects.dipoles.cutoff",
            f"is the width over which field.means = 'macroscopic' spreads a grain; allowed: at least {MIN_WIDTH:g} "
            "diameters (2.5 to 3 are usual)",
        )


def _room_for_the_layers(partial: PartialScene) -> Iterator[Fault]:
    """Between steel faces grains are spread over no more than the gap, and over no less than two diameters."""
    scene = partial.scene
    if scene.effects.attraction is None or not layers_change_the_field(scene) or scene.shape().faults(None):
        return
    largest, gap = scene.particles.largest_diameter, narrowest_gap(scene)
    if gap < MIN_WIDTH * largest:
        yield partial.fault(
            "field.means",
            f"spreads each grain over at least {MIN_WIDTH:g} diameters between steel faces, and the gap of "
            f"{1e3 * gap:.3g} mm has {gap / largest:.3g}; take means = 'applied', or lower "
            f"particles.{size_key(scene.particles)}",
        )


TORQUE_FIELD_DIPOLES = Column(
    "torque_field_dipoles", "N m", "part of torque_field from pairs of dipoles, as m x B", When.MEAN
)
MOMENT_RESIDUAL = Column(
    "moment_residual",
    "1",
    "last change in the iteration for the moments, relative to the magnetisation",
    When.LARGEST,
)
MOMENT_SWEEPS = Column("moment_sweeps", "1", "sweeps over the grains' moments", When.SUM)


class DipolesSection(EffectSection):
    """Forces between the grains' moments within a cut-off."""

    name = "dipoles"
    summary = "forces between magnetised grains"
    role = "attraction"
    columns = (TORQUE_FIELD_DIPOLES, MOMENT_RESIDUAL, MOMENT_SWEEPS)
    needs_field = True
    needs_moments = True
    has_lagged_forces = True
    neighbour_ns = 100.0  # quickstart, powder_clutch, lock_up (tests/benchmarks/moment_cost.py)
    CHECKS: ClassVar = (
        (_room_for_the_layers, ("geometry", "particles", "effects", "field")),
        (_valid_moments, ("effects", "particles")),
    )

    model: Annotated[str, Choice(("mutual", "near_field"))] = Field(
        default="near_field",
        description="mutual: grains magnetise one another as dipoles and saturate; near_field: also the flux between "
        "grains that nearly touch, without which their attraction is too weak",
    )
    cutoff: Annotated[float, number("3", 1.1, 10.0)] = Field(
        default=3.0, description="range of the forces, in grain diameters"
    )
    update_every: Annotated[Annotated[int, Integer(1, 10_000, "10")] | None, Automatic()] = Field(
        default=None, description="steps between two evaluations of the magnetic forces, which are constant in between"
    )
    tolerance: Annotated[float, number("1e-3", 1e-12, 0.05)] = Field(
        default=1e-3, description="residual of the moments, relative to the magnetisation"
    )
    surface_gap: Annotated[float, number("0.003", 3e-4, 0.5)] = Field(
        default=3e-3,
        description="near_field: gap between surfaces that touch (oxide, roughness), in grain radii; a gap of 0.02 "
        "reduces the force in a chain by a half at 18 kA/m and by a seventh at 80 kA/m",
    )

    @property
    def has_necks(self) -> bool:
        """True if near contacts have the flux in their necks, and a force that follows every step."""
        return self.model == "near_field"

    @property
    def methods_compared(self) -> str:
        """What both entries of `contact.method` were measured to take with necks; empty without."""
        if not self.has_necks:
            return ""
        return (
            "DEM is cheaper than DVI: a sheared box of magnetised powder took 26 to 40 s of processor time by DVI, "
            "14 to 17 s by DEM (docs/explanation/contact.md)"
        )

    def acting(self, scene, bodies):
        """Yield the forces between moments."""
        from coupling import Dipoles  # local: the schema itself needs no particles

        yield Dipoles()

    def magnetised_grains(
        self, scene: Scene, sampler: Any, walls: Sequence[Wall], motion: GrainMotion
    ) -> MagnetisedGrains:
        """Build what gives the grains their moments: the field, the other grains, and their images where there are any.

        Parameters
        ----------
        scene : Scene
        sampler : FieldSampler
            Of the field without the grains, or with all of them spread out where moments are fed back.
        walls : sequence of Wall
        motion : GrainMotion
        """
        from coupling import MutuallyMagnetisedGrains, MutualMoments, NearAttraction, grain_table
        from coupling.grain_law_table import FARTHEST_GAP
        from coupling.near_attraction import NEAR_GAP
        from emclutch.device_model.materials import grain_law

        law, fed_back = grain_law(scene), moments_are_fed_back(scene)
        spread = fed_back or layers_change_the_field(scene)
        solver = MutualMoments(
            grain_table(law, self.model),
            near=self.has_necks,
            reach=smear_width(scene) if spread else self.cutoff * scene.grains.largest_diameter,
            smear=fed_back or (scene.prescribed_field is not None and scene.prescribed_field.is_macroscopic),
            smallest_gap=self.surface_gap,
        )
        mirrors = None if scene.effects.images is None else walls
        near = None
        if solver.near:
            near = NearAttraction(solver, walls, NEAR_GAP if motion.box is None else FARTHEST_GAP)
        return MutuallyMagnetisedGrains(
            sampler, law, solver=solver, tolerance=self.tolerance, mirrors=mirrors, near=near
        )

    def warnings(self, scene):
        """Yield a gap between steel faces that is too narrow for the width that charges of necks need."""
        if scene.particles is None or not (self.has_necks and layers_change_the_field(scene)):
            return
        width = smear_width(scene) / scene.particles.largest_diameter
        if width < TRUE_WIDTH - 1e-9:
            yield (
                f"field.means = 'macroscopic' spreads a grain over {width:.3g} diameters, as much as the gap allows: "
                f"below {TRUE_WIDTH:g} forces on grains that nearly touch are wrong by 5 %; use smaller grains"
            )

    def magnetisation_in_chains(self, scene: Scene, M_max: float) -> float:
        """Magnetisation of grains in chains of dipoles [A/m], from that of single ones; that of necks stays."""
        from coupling import chain_magnetisation
        from emclutch.device_model.materials import grain_law

        return M_max if self.has_necks or M_max <= 0.0 else chain_magnetisation(grain_law(scene), M_max)

    def neck_stiffness(self, scene: Scene) -> float:
        """Negative stiffness of saturated necks between near grains [N/m]; 0 where they are not simulated."""
        from coupling import neck_stiffness
        from emclutch.device_model.materials import grain_law

        if not self.has_necks:
            return 0.0
        at_walls = scene.effects.images is not None
        return neck_stiffness(grain_law(scene), scene.grains.largest_diameter, at_walls=at_walls)

    def limits(self, scene, field_strength):
        """Yield a field in which the forces of necks are too strong."""
        from emclutch.device_model.materials import grain_law
        from field.spheres.lone_sphere import saturation

        if self.has_necks:
            yield from _too_strong(field_strength, saturation(grain_law(scene)))

    def loads(self, scene, device, M_max):
        """Yield the force of necks, and the stiffness that keeps them from closing by themselves."""
        if not self.has_necks:
            return
        from coupling.expected_load import NECK_MARGIN, neck_load
        from emclutch.device_model.materials import grain_law

        d, contact = scene.grains.largest_diameter, scene.contact
        force = neck_load(grain_law(scene), M_max, d, self.surface_gap)
        yield Load(self.name, force, f"necks between grains magnetised to {M_max / 1e3:.4g} kA/m")
        if contact.needs_a_load:
            neck = self.neck_stiffness(scene)
            text = f"{NECK_MARGIN:g} times the stiffness of saturated necks, {neck:.3g} N/m,"
            yield Load(self.name, NECK_MARGIN * neck * contact.max_overlap * d, text)

    def step_ns(self):
        """Return the processor time of near pairs in a grain's step [ns]: that of a neighbour in an update."""
        return self.neighbour_ns if self.has_necks else 0.0

    def neighbours_in_bulk(self, scene, device) -> float:
        """Return the neighbours within the cut-off and a skin, at the density of the filled space, far from walls."""
        d, reach = scene.grains.largest_diameter, self.cutoff + SKIN
        return device.fill.solid_fraction * 8.0 * reach**3 * (pi / 6.0 * d**3 / scene.grains.grain_volume)

    def neighbours(self, scene, device):
        """Return the neighbours that the walls leave.

        In a gap of width w a sphere of radius R around a grain lies outside of it by 3 R/(8 w) of its volume on average
        (the mean of both caps over the width, for R < w); narrower gaps hold a disc of it.
        """
        whole = self.neighbours_in_bulk(scene, device)
        share = (self.cutoff + SKIN) * scene.grains.largest_diameter / device.narrowest_gap
        return whole * (1.0 - 0.375 * share if share < 1.0 else 0.625 / share)

    def summarise(self, history, simulation):
        """Convergence of the moments, and strength of necks relative to the contact's stiffness."""
        from coupling import MutuallyMagnetisedGrains
        from particles import DEM, depth_warning, pull_stiffness_ratio

        if MOMENT_RESIDUAL not in history:
            return {}
        sweeps = float(history[MOMENT_SWEEPS].sum())
        moments: dict[str, Any] = {
            "model": self.model,
            "tolerance": self.tolerance,
            "worst_residual": float(history[MOMENT_RESIDUAL].max()),
            "sweeps_per_update": sweeps * simulation.steps_per_update / history[STEPS].sum(),
        }
        warnings: list[str | None] = []
        motion = simulation.motion
        if isinstance(motion, DEM) and motion.attraction is not None:
            moments["strongest_near_pull"] = motion.attraction.strongest
            moments["necks_over_contact_stiffness"] = pull_stiffness_ratio(
                motion.attraction, motion.laws, motion.grains.radius
            )
            warnings += [depth_warning(motion.attraction, motion.laws, motion.grains.radius)]
        magnetised = simulation.magnetised
        if isinstance(magnetised, MutuallyMagnetisedGrains) and magnetised.field_strength is not None:
            moments |= _extremes(motion, magnetised.solver.table.scale)
            between_poles = FIELD_STRENGTH_POWDER in history
            moments["field_strength"] = (
                float(history[FIELD_STRENGTH_POWDER].max()) if between_poles else magnetised.field_strength
            )
            warnings += _outside(moments, magnetised.solver.table.scale) if self.has_necks else []
        if any(warnings):
            moments["warnings"] = [text for text in warnings if text is not None]
        return {"moments": moments}

    @classmethod
    def omitted_effects(cls, at):
        """Yield the pull of touching grains over their weight."""
        if at.M > 0.0:
            yield OmittedEffect(
                cls.name, OFF, "attraction of touching grains divided by weight", at.pull / at.weight, 0.1
            )


def _extremes(motion: GrainMotion, saturation: float) -> dict[str, float]:
    """Largest magnetisations over ``saturation`` [A/m] and fraction of crowded grains at the end of a run.

    A moment includes the flux that leaves its grain through contacts, and may exceed that of saturation; its dipole
    part does not.
    """
    table, moments, dipoles = motion.contacts(), motion.grains.magnetic_moment, motion.grains.dipole
    assert moments is not None  # of the last evaluation
    touched = np.concatenate((table.i, table.j[table.j >= 0]))
    contacts = np.bincount(touched, minlength=motion.grains.count)

    def largest(of: np.ndarray) -> float:
        return float((np.linalg.norm(of, axis=1) / motion.grains.volume).max(initial=0.0) / saturation)

    return {
        "largest_magnetisation_over_saturation": largest(moments if dipoles is None else dipoles),
        "largest_moment_with_contact_flux_over_saturation": largest(moments),
        "grains_of_more_than_six_contacts": float(np.mean(contacts > MOST_CONTACTS)),
    }


def _outside(moments: dict[str, Any], saturation: float) -> list[str]:
    """Warnings where the grains are outside of what near_field holds for."""
    warnings = list(_too_strong(moments["field_strength"], saturation))
    crowded = moments["grains_of_more_than_six_contacts"]
    if crowded > CROWDED:
        warnings.append(
            f"{100.0 * crowded:.2g} % of the grains have more than {MOST_CONTACTS} contacts: forces of their necks are "
            "off by up to a third"
        )
    return warnings


def _too_strong(field_strength: float, saturation: float) -> Iterator[str]:
    """Yield a warning of a mean field in the powder [A/m] beyond which necks are too strong."""
    strongest = STRONGEST_FIELD * saturation
    if field_strength > strongest:
        yield (
            f"the mean field in the powder is {field_strength / 1e3:.4g} kA/m, above the limit of "
            f"{strongest / 1e3:.4g} kA/m. There effects.dipoles.model = 'near_field' overestimates the attraction of "
            "grains with several contacts by 12 %, in stronger fields by more. The torque may be too large; no "
            "interval contains this error"
        )
