"""[effects.back_reaction]: the grains' moments are part of the solved field (`coupling.powder_feedback`)."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When
from emclutch.scene.errors import Fault
from emclutch.scene.fill import fill_of
from emclutch.scene.grain_smear import MIN_WIDTH, TRUE_WIDTH, moments_are_fed_back, narrowest_gap, smear_width
from emclutch.scene.partial_scene import PartialScene, size_key
from emclutch.scene.units import number

if TYPE_CHECKING:
    from coupling import PowderFeedback
    from emclutch.scene.model import Scene
    from field.section.axisymmetric import AxisymmetricProblem
    from field.three_d import Problem3D
    from particles import Body


def _solved_field_and_moments(partial: PartialScene) -> Iterator[Fault]:
    """Feedback needs moments, and a field that is solved."""
    scene = partial.scene
    if scene.effects.feedback is None or partial.is_of_the_field_alone:
        return
    prescribed, needed = scene.prescribed_field is not None, scene.effects.tables(role="attraction")
    if scene.effects.attraction is None and not prescribed:
        yield Fault(
            "effects.back_reaction",
            "",
            f"needs grains that magnetise one another, whose moments it gives to the field; add {needed}, or "
            "remove its table",
        )
    if prescribed:
        yield Fault(
            "effects.back_reaction",
            "",
            "needs a field that is solved, and field.source = 'uniform' is "
            "prescribed; take field.source = 'coil', or remove its table",
        )


def _all_parts_of_the_feedback(partial: PartialScene) -> Iterator[Fault]:
    """Effects that hold a part of the attraction between grains whose moments are fed back to the field.

    The solved field then has every grain in it, spread out over the cut-off and mirrored in steel. Pairs within the
    cut-off add what that smear misses; what it has itself acts as `magnetic_force`, and its mirror images are taken
    out for those of the grains by `wall_images`. Without one of them a part is missing or counts twice.
    """
    effects = partial.scene.effects
    if not moments_are_fed_back(partial.scene):
        return
    stands = f"is missing with [effects.back_reaction] and effects.dipoles.model = '{effects.attraction.model}'"
    if "magnetic_force" not in effects.active:
        yield Fault(
            "effects.magnetic_force",
            "",
            f"{stands}: add it, or remove [effects.back_reaction]. The field's gradient contains the forces between "
            "distant grains; without it axial forces of pairs are 4 to 41 % too strong",
        )
    if effects.images is None and partial.scene.geometry.may_have_steel_faces:
        yield Fault(
            "effects.wall_images",
            "",
            f"{stands}: add it, or remove [effects.back_reaction]. The solved field contains images of the spread "
            "grains in the steel; images of single grains correct them",
        )


def _room_for_the_smear(partial: PartialScene) -> Iterator[Fault]:
    """Room that spreading the grains' moments over the section needs: two diameters of gap, and about the axis."""
    scene = partial.scene
    if not (moments_are_fed_back(scene) and scene.geometry.has_coil):
        return
    shape = scene.shape()
    if shape.faults(None) or scene.prescribed_field is not None:
        return
    largest, gap = scene.particles.largest_diameter, narrowest_gap(scene)
    if gap < MIN_WIDTH * largest:
        yield partial.fault(
            "effects.back_reaction",
            f"spreads each grain over at least {MIN_WIDTH:g} diameters, and the gap of {1e3 * gap:.3g} mm has "
            f"{gap / largest:.3g}; remove its table (the field then ignores the grains), or lower "
            f"particles.{size_key(scene.particles)}",
        )
        return
    width = max(smear_width(scene), MIN_WIDTH * largest)
    if scene.effects.attraction.cutoff < MIN_WIDTH:
        yield partial.fault(
            "effects.dipoles.cutoff",
            f"is the width over which back_reaction spreads a grain; allowed: at least {MIN_WIDTH:g} diameters (2.5 "
            "to 3 are usual)",
        )
    radius = fill_of(shape, scene.particles).inner_radius
    if radius < 4.0 * width:
        yield partial.fault(
            "effects.back_reaction",
            f"cannot spread grains so near the axis: powder begins at {1e3 * radius:.3g} mm, allowed are 4 widths, "
            f"{4e3 * width:.3g} mm; remove its table, or lower effects.dipoles.cutoff",
        )


FEEDBACK_RESIDUAL = Column(
    "feedback_residual",
    "1",
    "difference of the magnetisation of the grains from that in the solved field, relative, rms",
    When.END,
)
FEEDBACK_ACROSS = Column(
    "feedback_across",
    "1",
    "magnetisation that the solve took as constant, relative: component across the field",
    When.FIELD,
)
FEEDBACK_CLIPPED = Column(
    "feedback_clipped",
    "1",
    "magnetisation that the solve took as constant, relative: where the demagnetising factor is at a limit",
    When.FIELD,
)
FEEDBACK_LAGGED = Column(
    "feedback_lagged", "1", "the same: variation within an element and delay of the demagnetising factor", When.FIELD
)


class BackReactionSection(EffectSection):
    """The powder changes the field: the grains' moments are part of its solution."""

    name = "back_reaction"
    summary = "the powder changes the field"
    role = "feedback"
    columns = (FEEDBACK_RESIDUAL, FEEDBACK_ACROSS, FEEDBACK_CLIPPED, FEEDBACK_LAGGED)
    needs_field = True
    window_solves = 0.2  # 0.13 to 0.29 in quickstart and powder_clutch
    CHECKS: ClassVar = (
        (_solved_field_and_moments, ("effects",)),
        (_all_parts_of_the_feedback, ("effects", "particles")),
        (_room_for_the_smear, ("geometry", "particles", "effects", "field")),
    )

    tolerance: Annotated[float, number("0.02", 1e-6, 1.0)] = Field(
        default=0.02,
        description="accepted relative difference between the magnetisation in the field and that of the grains",
    )

    def powder_feedback(
        self, scene: Scene, problem: AxisymmetricProblem | Problem3D, walls, carrier: Body | None = None
    ) -> PowderFeedback | None:
        """Build what gives the grains' moments to the field of `problem` and back; None without moments.

        `carrier` is the slotted body of a field in 3D.
        """
        if not moments_are_fed_back(scene):
            return None
        from coupling import PowderFeedback, PowderFeedback3D
        from emclutch.device_model.materials import grain_law

        kind = PowderFeedback if carrier is None else PowderFeedback3D
        return kind(problem, grain_law(scene), smear_width(scene), scene.grains.sector or 2 * pi, walls, carrier)

    def warnings(self, scene):
        """Yield a width at which the field still knows single grains around the axis as if they were an even ring."""
        fed_back = scene.particles is not None and moments_are_fed_back(scene)
        if not (fed_back and scene.coil_field is not None):
            return
        largest = scene.particles.largest_diameter
        width, cutoff = smear_width(scene) / largest, scene.effects.attraction.cutoff
        if width < TRUE_WIDTH - 1e-9:
            remedy = (
                f"raise effects.dipoles.cutoff = {cutoff:g} to {TRUE_WIDTH:g}"
                if width > cutoff - 1e-9
                else "the gap allows no more; use smaller grains"
            )
            yield (
                f"[effects.back_reaction] spreads a grain over {width:.3g} diameters: below {TRUE_WIDTH:g} forces "
                "on grains next to steel are wrong by up to 3 %, on grains that nearly touch by 5 %, on single ones in "
                f"loose powder by 12 %; {remedy}"
            )

    def summarise(self, history, simulation):
        """Difference of the solved field's powder from its grains: the largest, and its parts at the end."""
        if FEEDBACK_RESIDUAL not in history:
            return {}
        return {
            "feedback": {
                "tolerance": simulation.source.powder_tolerance,
                "worst_residual": float(history[FEEDBACK_RESIDUAL].max()),
                "across": float(history[FEEDBACK_ACROSS].iloc[-1]),
                "clipped": float(history[FEEDBACK_CLIPPED].iloc[-1]),
                "lagged": float(history[FEEDBACK_LAGGED].iloc[-1]),
            }
        }

    @classmethod
    def omitted_effects(cls, at):
        """Yield the powder's magnetisation over H."""
        if at.M > 0.0 and at.solved:
            yield OmittedEffect(cls.name, OFF, "magnetisation of the powder over H", at.powder_susceptibility, 0.1)
