"""geometry.kind = "sheared_box": a periodic box of powder that is sheared, whole or between two faces of steel.

See `particles.sheared_box`; the faces are `geometry.box.PeriodicGap`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from emclutch.devices.geometry_section import NO_MATERIALS, GeometrySection
from emclutch.results.steady_stress import steady_stress, stress_summary
from emclutch.results.steady_torque import MIN_AVERAGED_STRAIN, SteadyConditions
from emclutch.scene.errors import Fault
from emclutch.scene.fill import fill_of, grains_volume
from emclutch.scene.partial_scene import PartialScene, size_key
from emclutch.scene.section import Choice, refuse
from emclutch.scene.units import Length, Quantity, format_number, number

if TYPE_CHECKING:
    import pandas

    from emclutch.device_model.device import Device
    from emclutch.effects.effect import Load
    from emclutch.scene.materials import Material
    from emclutch.scene.model import Scene
    from emclutch.simulation.forecast.expected_torque import ExpectedTorque
    from geometry.box import PeriodicBox
    from geometry.dimensioned_views import View
    from particles import Barostat, ShearedBox

_ShearRate = Annotated[float, Quantity("a shear rate", "1/s", "500 1/s", 0.0, 1e7, open_minimum=True)]
_Pressure = Annotated[float, Quantity("a pressure", "Pa", "1 kPa", 0.0, 1e9, open_minimum=True)]

COMPACTED = 0.64
"""Fill of grains without friction under pressure, random close packing: others stay looser."""

DENSEST = 0.58
"""Fill up to which grains are packed at random in a periodic box (`particles.packing.periodic_packing`)."""

LOADED = 4.0
"""Load on a contact of a force chain over pressure times diameter squared, the mean on a grain."""

MIN_LAYERS = 3.0
"""Grains between two faces, at least: fewer have no bulk."""

DAMPING = 10.0
"""Damping of the barostat over stress/rate: a loose packing is pressed together within a strain of some units.

The stress is the pressure, or that of chains in a field or of grains in flight where it is larger: what fluctuates is
of their size, and a box that followed each fluctuation would be shaken.
"""


def _seed(scene: Scene) -> int | None:
    """Return the seed that sizes are drawn with; None where the scene's first section is broken."""
    return None if scene.scene is None else scene.scene.seed


def _packed_at_random(partial: PartialScene) -> Iterator[Fault]:
    """Grains are thrown into the box, whose copies have no room for anything else."""
    particles = partial.scene.particles
    if particles.packing != "random":
        yield partial.fault("particles.packing", "is not available in a periodic box; take packing = 'random'")
    if particles.settle:
        yield partial.fault("particles.settle", "has no meaning in a periodic box, whose grains start with the flow; "
                          "remove it")  # fmt: skip


def _shortest_edge(scene: Scene) -> float:
    """Return the edge [m] below which a grain would meet a neighbour twice."""
    from coupling.sheared_powder import min_edge  # local: the schema itself needs no particles

    attraction = scene.effects.attraction
    return min_edge(None if attraction is None else attraction.cutoff) * scene.grains.largest_diameter


def _wide_enough(partial: PartialScene) -> Iterator[Fault]:
    """No grain may meet a neighbour twice, or itself."""
    scene = partial.scene
    if scene.shape().faults(None):
        return
    attraction, needed = scene.effects.attraction, _shortest_edge(scene)
    size, least = scene.shape().size, MIN_LAYERS * scene.grains.largest_diameter
    shortest = min(size if scene.geometry.walls is None else size[:2])
    if scene.geometry.walls is not None and size[2] < least:  # of a cube the shortest edge is too short as well
        yield partial.fault(
            "geometry.size",
            f"leaves {1e3 * size[2]:.4g} mm between the faces; allowed: at least {1e3 * least:.4g} mm, "
            f"{MIN_LAYERS:g} grains; raise it, or lower particles.{size_key(scene.particles)}",
        )
    if shortest < needed * (1.0 - 1e-12):
        why = "" if attraction is None else f" effects.{attraction.name}.cutoff = {attraction.cutoff:g} or"
        cube = scene.geometry.size is None
        yield partial.fault(
            "particles.count" if cube else "geometry.size",
            f"{'makes' if cube else 'has'} an edge of {1e3 * shortest:.4g} mm, in which a grain would meet a neighbour "
            f"twice; allowed: at least {1e3 * needed:.4g} mm; raise it, or lower{why} "
            f"particles.{size_key(scene.particles)}",
        )


def _one_amount(partial: PartialScene) -> Iterator[Fault]:
    """A cube that holds a number of grains needs that number; a box of a given size no second fill."""
    geometry, particles = partial.scene.geometry, partial.scene.particles
    if geometry.size is None and particles.count is None:
        yield partial.fault(
            "geometry.solid_fraction",
            "makes the cube that holds particles.count grains; give that in place of the amount in [particles], or "
            "geometry.size in place of this",
        )


def _check_compliant_contacts(partial: PartialScene) -> Iterator[Fault]:
    """Check that contacts are compliant: a box under pressure does work on them, which rigid ones cannot store."""
    geometry, contact = partial.scene.geometry, partial.scene.contact
    if contact.method == "dvi" and geometry.pressure is not None and not contact.dvi.springs:
        yield partial.fault(
            "contact.dvi.springs",
            "= false cannot be combined with geometry.pressure: the box follows the stress of contacts on springs; "
            "take springs = true, or a given volume",
        )


def _faces(partial: PartialScene) -> Iterator[Fault]:
    """Between faces the height is given, and magnetised grains see their images in the steel."""
    scene = partial.scene
    if scene.geometry.walls is None:
        return
    if scene.geometry.pressure is not None:
        yield partial.fault(
            "geometry.pressure",
            "cannot be combined with geometry.walls = 'steel': the distance of the faces is given, and the pressure "
            "on them is a result; remove one of the two",
        )
    if scene.effects.attraction is not None and scene.effects.images is None:
        yield Fault(
            "effects.wall_images",
            "",
            "is missing: magnetised grains see their images in the faces of geometry.walls = 'steel'; add the table "
            "[effects.wall_images], or remove geometry.walls",
        )


def _check_excluded_effects(partial: PartialScene) -> Iterator[Fault]:
    """Check that no effect needs an origin or an end: weight, a fluid at rest, surfaces."""
    scene = partial.scene
    weight = scene.effects.weight
    if weight is not None:
        yield Fault(
            f"effects.{weight.name}",
            "",
            "cannot be used in a periodic box, in which grains would fall for ever; remove the table",
        )
    for one in scene.effects.present:
        if one.role == "drag":
            yield Fault(
                f"effects.{one.name}",
                "",
                "cannot be used in a periodic box, whose copies move past a fluid at rest at different speeds; remove "
                "the table",
            )
    for name in scene.surfaces:
        yield Fault(f"surfaces.{name}", "", "cannot be in a periodic box, which has no walls; remove the table")


def _no_profiles(partial: PartialScene) -> Iterator[Fault]:
    """All heights of the box are alike."""
    if partial.scene.output.profiles:
        yield partial.fault("output.profiles", "has no meaning in a periodic box, in which all heights are equivalent; "
                          "remove it")  # fmt: skip


def _field_across(partial: PartialScene) -> Iterator[Fault]:
    """The macroscopic field stands across the flow."""
    field = partial.scene.prescribed_field
    if field is None:
        return
    if not field.is_macroscopic:
        yield partial.fault(
            "field.means",
            "is the applied field, which is undefined for unbounded powder; take means = 'macroscopic'",
        )
    if field.direction not in ("z", "axial", "radial"):  # radial has its own fault
        yield partial.fault(
            "field.direction", "is not across the flow, whose gradient is along z; take direction = 'z'"
        )


def _stress_for_the_rate(partial: PartialScene) -> Iterator[Fault]:
    """A rate follows from an inertial number and a stress only."""
    geometry, scene = partial.scene.geometry, partial.scene
    if geometry.inertial_number is None or geometry.pressure is not None:
        return
    field = scene.prescribed_field
    if scene.effects.attraction is None or field is None or field.field_strength == 0.0:
        yield partial.fault(
            "geometry.inertial_number",
            "needs a stress: without geometry.pressure, and without a field in which grains attract one another, it "
            "follows from the solid fraction alone; give geometry.shear_rate or geometry.pressure",
        )


class ShearedBoxGeometry(GeometrySection):
    """A box that repeats in all directions and is sheared: flow along x, vorticity along y, gradient along z.

    Its volume stays, or with `pressure` its height follows the normal stress along z. With `walls` it is the gap
    between two flat faces of steel, of which the upper one moves along x, and repeats along x and y only. A field is
    uniform, along z, and means the macroscopic one of the powder.
    """

    has_axis = False
    is_periodic = True
    largest_fill = DENSEST
    measured = "stress"
    excluded_roles = ("weight", "images", "drag")
    why_no_sector = "needs a shape with an axis; remove it: a periodic box repeats by itself"
    CHECKS: ClassVar = (
        (_packed_at_random, ("particles",)),
        (_one_amount, ("geometry", "particles")),
        (_wide_enough, ("geometry", "particles", "effects")),
        (_check_compliant_contacts, ("geometry", "contact")),
        (_faces, ("geometry", "effects")),
        (_check_excluded_effects, ("effects", "surfaces")),
        (_no_profiles, ("output",)),
        (_field_across, ("field",)),
        (_stress_for_the_rate, ("geometry", "effects", "field")),
    )

    kind: Literal["sheared_box"]
    size: tuple[Length, Length, Length] | None = Field(
        default=None,
        description="edges along the flow x, the vorticity y and the gradient z; with `pressure` those of the start",
    )
    solid_fraction: Annotated[float, number("0.45", 0.0, DENSEST, above=True)] | None = Field(
        default=None, description="of the cube that holds `particles.count` grains, instead of size"
    )
    shear_rate: _ShearRate | None = Field(default=None, description="dv_x/dz; or inertial_number")
    inertial_number: Annotated[float, number("0.01", 0.0, 1.0, above=True)] | None = Field(
        default=None,
        description="I = rate d sqrt(density/stress), instead of shear_rate; the stress is `pressure`, or without it "
        "the shear stress that is expected in the field",
    )
    pressure: _Pressure | None = Field(
        default=None, description="imposed normal stress of the grains along z; default: the volume stays"
    )
    walls: Annotated[str, Choice(("steel",))] | None = Field(
        default=None,
        description="steel: flat faces at z = 0 and at the box's height, in which grains see their images; default: "
        "the box repeats along z too",
    )

    @model_validator(mode="after")
    def _has_one_size(self) -> Self:
        if self.size is None and self.solid_fraction is None:
            raise refuse("is missing; give three lengths, e.g. size = ['2 mm', '2 mm', '2 mm'], or solid_fraction for "
                         "the cube that holds particles.count grains", key="size")  # fmt: skip
        if self.size is not None and self.solid_fraction is not None:
            raise refuse("conflicts with size; keep one of the two", key="solid_fraction")
        return self

    @model_validator(mode="after")
    def _has_one_rate(self) -> Self:
        if self.shear_rate is None and self.inertial_number is None:
            raise refuse("is missing; give shear_rate, e.g. '500 1/s', or inertial_number, e.g. 0.01",
                         key="shear_rate")  # fmt: skip
        if self.shear_rate is not None and self.inertial_number is not None:
            raise refuse("conflicts with shear_rate; keep one of the two", key="inertial_number")
        return self

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> PeriodicBox:
        """Return the shape for volumes where its size is given; see `shape_in`."""
        assert self.size is not None  # else the grains have it
        return self._of_size(self.size)

    def _of_size(self, size: tuple[float, float, float]) -> PeriodicBox:
        from geometry.box import PeriodicBox, PeriodicGap

        return PeriodicBox(size) if self.walls is None else PeriodicGap(size)

    @property
    def may_have_steel_faces(self) -> bool:
        """True between faces."""
        return self.walls is not None

    def shape_in(self, scene: Any) -> PeriodicBox:
        """See `GeometrySection.shape_in`: the box of its size, or the cube that holds the scene's grains."""
        particles = scene.particles
        if self.size is not None or particles is None or particles.count is None:
            return self._of_size(self.size or 3 * (1.0,))  # what is missing is a fault of its own
        assert self.solid_fraction is not None
        edge = (grains_volume(particles, _seed(scene)) / self.solid_fraction) ** (1.0 / 3.0)
        return self._of_size((edge, edge, edge))

    def expected_stress(self, scene: Scene) -> float | None:
        """Shear stress [Pa] that is expected in the field, within a factor of two; None where grains do not attract."""
        from coupling.sheared_powder import chain_load, expected_stress
        from emclutch.device_model.materials import saturation_of

        attraction, H = scene.effects.attraction, self._field_strength(scene)
        if attraction is None or H is None:
            return None
        d, fill = scene.grains.mean_diameter, fill_of(scene.shape(), scene.grains).solid_fraction
        # of grains that do not saturate the load is in proportion to Ms^-0.2
        load = chain_load(saturation_of(scene), H, d, necks=attraction.has_necks)
        return expected_stress(load, fill, d)

    @staticmethod
    def _field_strength(scene: Scene) -> float | None:
        """Strength [A/m] of the field along z; None without one."""
        field = scene.prescribed_field
        return abs(field.field_strength) or None if field is not None else None

    def dimension_views(self, shape: PeriodicBox) -> list[View]:
        """See `GeometrySection.dimension_views`."""
        from geometry.dimensioned_views import box_views

        return box_views(shape.size)

    def rate(self, scene: Scene) -> float:
        """See `GeometrySection.rate`: as asked, or from the inertial number."""
        from particles.diagnostics.inertial_number import shear_rate_of

        if self.shear_rate is not None:
            return self.shear_rate
        stress = self.pressure or self.expected_stress(scene)
        assert self.inertial_number is not None and stress is not None  # by the checks above
        return shear_rate_of(self.inertial_number, scene.grains.mean_diameter, scene.grains.density, stress)

    def periodic_box(self, scene: Scene) -> ShearedBox:
        """See `GeometrySection.periodic_box`."""
        from particles import GapBox, ShearedBox

        shape, rate = scene.shape(), self.rate(scene)
        if self.walls is None:
            return ShearedBox(np.array(shape.size), rate)
        return GapBox(np.array(shape.size), rate, shape.lower)

    def face_speeds(self, scene: Scene) -> dict[str, float]:
        """See `GeometrySection.face_speeds`: the lower face stands, the upper one moves along x."""
        if self.walls is None:
            return {}
        shape = scene.shape()
        return {"upper": self.rate(scene) * shape.size[2] / (shape.axis - 0.5 * shape.size[1])}

    def barostat(self, scene: Scene) -> Barostat | None:
        """See `GeometrySection.barostat`."""
        from particles import Barostat

        if self.pressure is None:
            return None
        stress = max(self.pressure, self.expected_stress(scene) or 0.0, self._stress_of_flight(scene))
        return Barostat(self.pressure, DAMPING * stress / self.rate(scene))

    def _stress_of_flight(self, scene: Scene) -> float:
        """Return the stress [Pa] that grains in flight have, density (rate d)^2: an inertial number of 1."""
        return scene.grains.density * (self.rate(scene) * scene.grains.mean_diameter) ** 2

    def _lowest(self, scene: Scene) -> float:
        """Return the height [m] of the box when its grains are `COMPACTED`."""
        shape = scene.shape()
        return shape.size[2] * min(1.0, fill_of(shape, scene.grains).solid_fraction / COMPACTED)

    def loads(self, scene: Scene) -> Iterator[Load]:
        """Yield the imposed pressure's."""
        from emclutch.effects.effect import Load

        if self.pressure is not None:
            force = LOADED * self.pressure * scene.grains.largest_diameter**2
            yield Load("pressure", force, f"force chains under the imposed {format_number(self.pressure)} Pa")

    def words(self, scene: Scene, end: float) -> Iterator[tuple[str, str]]:
        """Yield the box, its rate with the inertial number, the strain and the stress that is expected."""
        from emclutch.device_model.decision import Decision
        from emclutch.scene.start_up import start_up_strain
        from particles.diagnostics.inertial_number import inertial_number

        d, density, rate = scene.grains.mean_diameter, scene.grains.density, self.rate(scene)
        edges = " x ".join(f"{edge / d:.3g}" for edge in scene.shape().size)
        repeats = "periodic" if self.walls is None else "between faces of steel, periodic along x and y"
        text = f"{edges} diameters, {repeats}; flow along x, gradient along z, "
        if self.pressure is None:
            yield "box", f"{text}its volume stays"
        else:
            low, needed = self._lowest(scene), _shortest_edge(scene)
            too_low = (
                f"at a fill of {COMPACTED:g} the box would be {1e3 * low:.3g} mm high, and a run stops below "
                f"{1e3 * needed:.3g} mm, where a grain would meet a neighbour twice: make it higher, or fill it more"
            )
            text += f"its height follows {format_number(self.pressure)} Pa"
            yield "box", Decision(text, too_low if low < needed else "")
        stress, text = self.expected_stress(scene), f"rate {rate:.4g} 1/s, strain {rate * end:.3g} at the end"
        if self.pressure is not None:
            text += f"; inertial number {float(inertial_number(rate, d, density, self.pressure)):.2g} of the pressure"
        elif stress is not None:
            about = float(inertial_number(rate, d, density, stress))
            text += f"; inertial number about {about:.2g} of the expected stress"
        else:
            text += "; inertial number unknown: at a given volume it follows from the pressure that the run finds"
        needed = start_up_strain(scene) + MIN_AVERAGED_STRAIN
        short = f"no stress counts as known below a strain of {needed:g}: raise time.end to {1.2 * needed / rate:.2g} s"
        flight = self._stress_of_flight(scene)
        apart = (
            f"grains fly apart, and the box grows with them, below a pressure of {format_number(flight)} Pa, an "
            "inertial number of 1: raise geometry.pressure, or lower geometry.shear_rate"
        )
        flies = self.pressure is not None and self.pressure < flight
        yield "shear", Decision(text, short if rate * end < needed else "", apart if flies else "")
        if stress is not None:
            yield "expected stress", f"{format_number(stress)} Pa within a factor of two, of chains along the field"

    def summarise(
        self, histories: Sequence[pandas.DataFrame], conditions: SteadyConditions, scene: Scene
    ) -> dict[str, Any]:
        """See `GeometrySection.summarise`: stress, effective friction, inertial numbers."""
        found = steady_stress(histories, conditions)
        grains = scene.grains
        summary = stress_summary(found, histories, self.rate(scene), grains.mean_diameter, grains.density)
        permeability, H = summary.get("relative_permeability"), self._field_strength(scene)
        if self.walls is None or permeability is None or H is None:
            return summary
        from emclutch.device_model.materials import grain_law
        from field.laws.reluctivity import MU_0

        M = (permeability - 1.0) * H / fill_of(scene.shape(), scene.grains).solid_fraction
        inside = float(grain_law(scene).field_inside(np.array([M]))[0])  # infinite from saturation on
        factor = (H - inside) / M if np.isfinite(inside) and M > 0.0 else None
        return summary | {"flux_density": MU_0 * permeability * H, "magnetisation": M, "demagnetising_factor": factor}

    def friction_torque(self, scene: Any, device: Device) -> ExpectedTorque:
        """None: nothing turns; the stress and the magnetisation that are expected."""
        from emclutch.device_model.materials import grain_law
        from emclutch.simulation.forecast.expected_torque import ExpectedTorque

        law, stress = "a periodic box has no shaft, its result is a stress", self.expected_stress(scene)
        pressure, of = stress or 0.0, "expected shear stress"
        if self.pressure is not None:
            pressure, of = self.pressure, "imposed pressure"
        if stress is None:
            return ExpectedTorque(None, law, pressure=pressure, pressure_of=of)
        H = abs(scene.prescribed_field.field_strength)
        M = float(grain_law(scene).magnetisation(np.array([H]), np.zeros(1))[0])
        return ExpectedTorque(None, law, stress=stress, H=H, M=M, magnetic=True, pressure=pressure, pressure_of=of)
