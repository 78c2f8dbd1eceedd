"""geometry.kind = "cad": a device from a CAD file or a finished mesh (`geometry.cad_shape`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from emclutch.devices.geometry_section import NO_MATERIALS, ONE_CARRIER, GeometrySection
from emclutch.scene.errors import Fault
from emclutch.scene.grain_smear import ELEMENTS_A_WIDTH, moments_are_fed_back, smear_width
from emclutch.scene.magnetic_regions import magnetic_regions
from emclutch.scene.motion import HELD
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Choice, did_you_mean, refuse
from emclutch.scene.units import number

if TYPE_CHECKING:
    from emclutch.device_model.device_3d import Solid
    from emclutch.device_model.pole_zone import PoleZone
    from emclutch.scene.materials import Material
    from geometry.cad_meshing import CadSection
    from geometry.cad_shape import CadShape
    from geometry.section import SectionMesh

_Body = Annotated[str, Choice(("rotor", "disc", "housing"))]
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 25.4e-3}
_UNIT_OF_SHAPES = "mm"
_RPM = 30.0 / math.pi  # for 1 rad/s
# Of the rows that are meshed here across the width: triangles of another mesher are not all equilateral.
_ENOUGH = 0.75
_KEYS = {"open_boundary": "field.open_boundary", "air_factor": "geometry.air_factor"}


def _finished_mesh(partial: PartialScene) -> Iterator[Fault]:
    """Keys that would size a mesh that is taken as it is, and whether its air can be continued."""
    geometry, source = partial.scene.geometry, partial.scene.coil_field
    if not geometry.is_meshed or source is None:
        return
    for key in ("gap_layers", "size_factor"):
        if getattr(source, key) != type(source).model_fields[key].default:
            reason = "sizes a mesh that is made here, but geometry.file is a finished one; remove it, mesh the file "
            yield partial.fault(f"field.{key}", f"{reason}more finely, or refine it by field.tolerance")
    if source.open_boundary:
        from field.section.open_boundary import check_reach  # local: the schema itself needs no field
        from geometry.fault import with_keys

        try:
            check_reach(geometry.mesh(partial.scene.shape(), source.gap_layers, source.size_factor))
        except ValueError as error:
            reason = with_keys(str(error), lambda name: _KEYS.get(name, f"`{name}`"))
            yield partial.fault("geometry.file", f"has too little air, or air of a wrong outline: {reason}")


def _fine_enough_for_moments(partial: PartialScene) -> Iterator[Fault]:
    """Rows of triangles across the width over which back_reaction spreads a grain."""
    scene = partial.scene
    geometry, source = scene.geometry, scene.coil_field
    if geometry.is_solved_in_3d and source is not None and scene.effects.feedback is not None:
        reason = "is not available with geometry.three_dimensional: the elements of solids of any shape are not meshed "
        reason += "as finely as moments of single grains need; remove one of them"
        yield Fault(f"effects.{scene.effects.feedback.name}", "", reason)
        return
    if not geometry.is_meshed or source is None:
        return
    if not moments_are_fed_back(scene) or scene.shape().faults(None):
        return
    mesh = geometry.mesh(scene.shape(), source.gap_layers, source.size_factor)
    # of an equilateral triangle of the same area: its height is 3^(1/4) sqrt(A)
    row = 3.0**0.25 * float(np.sqrt(np.median(mesh.element_area()[mesh.regions["powder"]])))
    width = smear_width(scene)
    if row > (allowed := width / (_ENOUGH * ELEMENTS_A_WIDTH)):
        reason = f"is too coarse for effects.{scene.effects.feedback.name}, which spreads a grain over "
        reason += f"{1e3 * width:.3g} mm: the powder's triangles are {1e3 * row:.3g} mm high, allowed are "
        reason += f"{1e3 * allowed:.3g} mm; mesh it more finely, or remove the effect's table"
        yield partial.fault("geometry.file", reason)


def _one_carrier(partial: PartialScene) -> Iterator[Fault]:
    """The field stands still in the frame of one body: no other may have parts that are not of revolution."""
    if partial.scene.coil_field is None or not partial.scene.geometry.is_solved_in_3d or "geometry" in partial.broken:
        return
    shape = partial.scene.shape()
    if len(shape.carriers) > 1:
        parts = ", ".join(f"{region} ({shape.body(region)})" for region in sorted(shape.section.odd))
        reason = f"several parts are not bodies of revolution: {parts}; {ONE_CARRIER}; let one of them have all"
        yield Fault("geometry.bodies", "", reason)


def _no_sector_of_solids(partial: PartialScene) -> Iterator[Fault]:
    """Where the field of solids of any shape repeats, if it does, is not known."""
    scene = partial.scene
    if scene.particles.sector is not None and scene.coil_field is not None and scene.geometry.is_solved_in_3d:
        reason = "needs a field that repeats from sector to sector, and the periodicity of the solids of "
        reason += "geometry.three_dimensional is unknown; remove it: the full ring is simulated"
        yield partial.fault("particles.sector", reason)


def _moves_the_powder(partial: PartialScene) -> Iterator[Fault]:
    """The slip is that between both shafts, so where powder lies at the housing the other shaft must be held."""
    scene, own = partial.scene, partial.scene.geometry.shaft_at_powder
    other = "rotor" if own == "disc" else "disc"
    motion = getattr(scene.motion, other)
    if scene.shape().bodies_at_powder == {own, "housing"} and (motion.free or motion.largest_speed):
        reason = f"does not move the powder, which lies between {own} and housing; remove it and set motion.{own}.speed"
        yield partial.fault(f"motion.{other}.{'free' if motion.free else 'speed'}", reason)


class CadGeometry(GeometrySection):
    """A device of revolution from a CAD file or a finished mesh, its regions by the names of the parts.

    A CAD file holds the faces of the half section (x is the radius, y or z the axis), or solids of revolution; what no
    part fills is air. A mesh holds the triangles of the half section and of the air around it, by physical groups
    (.msh), cell sets or a column of tags. Tag 3, and group 3 of a mesh or .geo file without a name, is `tag3`; a third
    part without a name, as all are of a BREP file, is `part3`. `coil` and `powder` are the winding and the space of the
    grains. Parts named disc and shaft_out turn with the disc, housing, yoke and coil stand still, all others turn with
    the rotor.

    With `three_dimensional` the file holds solids of any shape, and the field is solved in 3D. `powder` and
    `coil` are of revolution about z even then, the coil a ring of rectangular section whose current flows around z;
    all parts that are not belong to one body, with which the field turns. Walls are those of the half-plane y = 0,
    x > 0.
    """

    has_coil = True
    is_from_file = True
    CHECKS: ClassVar = (
        (_finished_mesh, ("geometry", "field")),
        (_fine_enough_for_moments, ("geometry", "particles", "effects", "field")),
        (_one_carrier, ("field",)),
        (_no_sector_of_solids, ("field", "particles")),
        (_moves_the_powder, ("geometry", "motion", "particles")),
    )

    kind: Literal["cad"]
    file: str = Field(
        min_length=1,
        description="STEP (names are those of PRODUCT), IGES, BREP or trusted .geo; or a mesh: .msh, .vtu, .vtk, .inp, "
        ".mesh, .med; from the scene's folder",
    )
    materials: dict[str, str] = Field(description="a material's name for each part but coil and powder")
    names: dict[str, str] = Field(default={}, description="region for a part's name in the file, where they differ")
    bodies: dict[str, _Body] = Field(
        default={},
        description="body of a part; default: disc for disc and shaft_out, housing for housing, yoke and coil, rotor "
        "for all others; air at the powder stands still and is no body, unless it is named here",
    )
    axis: Annotated[str, Choice(("x", "y", "z"))] = Field(default="z", description="axis of revolution of solids")
    unit: Annotated[str, Choice(tuple(_UNITS))] | None = Field(
        default=None, description="of a file that does not say it; default: mm for BREP and .geo, m for meshes"
    )
    scale: Annotated[float, number("0.001", 1e-9, 1e9)] = Field(default=1.0, description="factor on the file's lengths")
    air_factor: Annotated[float, number("3", 1.5, 20.0)] = Field(
        default=3.0, description="air box / device size; a mesh has its air with it"
    )
    three_dimensional: bool = Field(default=False, description="solve in 3D: solids of any shape, see the text above")
    _trust_scripts: bool = PrivateAttr(default=False)  # the caller's word: no scene may give it to itself

    @field_validator("file")
    @classmethod
    def _from_the_scenes_folder(cls, given: str, info: ValidationInfo) -> str:
        """Make the path absolute, so that a resolved scene finds the file from anywhere."""
        return str(((info.context or {}).get("folder", Path()) / given).resolve())

    @model_validator(mode="after")
    def _is_a_device(self, info: ValidationInfo) -> Self:
        """Read the file once, so that what is wrong with it is reported with the scene's other errors."""
        self._trust_scripts = bool((info.context or {}).get("trust_scripts", False))
        self._refuse_what_the_file_says()
        try:
            section = self._section()[1]
        except (ValueError, OSError) as error:
            from geometry.fault import with_keys

            reason = str(error).removeprefix(self.file).lstrip(": ")
            keys = type(self).model_fields
            reason = with_keys(reason, lambda name: f"geometry.{name}" if name in keys else f"`{name}`")
            raise refuse(reason, key="file") from None
        names = [*(part.region for part in section.parts), *sorted(section.odd)]
        parts = list(dict.fromkeys(name for name in names if name != "powder"))
        for name in self.bodies:
            if name not in (*parts, "air"):
                hint = did_you_mean(name, parts)
                raise refuse(f"is no part; {hint}parts: {', '.join(parts)}, and air", key=f"bodies.{name}")
        return self

    @property
    def is_meshed(self) -> bool:
        """True if the file is a finished mesh, which is taken as it is."""
        from geometry.section_import import MESH_SUFFIXES

        return Path(self.file).suffix.lower() in MESH_SUFFIXES

    @property
    def key_of_3d(self) -> str:
        """Solids of any shape are solved in 3D."""
        return "three_dimensional" if self.three_dimensional else ""

    def false_mirrors(self, shape: CadShape) -> str:
        """The slots of parts that are not of revolution."""
        where = "all around in what is steel in the half-plane y = 0, x > 0: in the slots of the other parts too"
        return where if shape.carriers else ""

    @property
    def files(self) -> dict[str, Path]:
        """The drawing or mesh."""
        return {"geometry.file": Path(self.file)}

    def region_materials(self, regions: Iterable[str]) -> dict[str, str]:
        """Name of the material of each part; the mesh's regions are those of the file."""
        return dict(self.materials)

    def _refuse_what_the_file_says(self) -> None:
        """Refuse keys that a file of this kind leaves nothing to say about."""
        suffix = Path(self.file).suffix.lower()
        if self.unit is not None and suffix in (".step", ".stp", ".iges", ".igs"):
            raise refuse(f"is not for {suffix} files, which say their own unit; remove it, or correct a wrong one by "
                         "geometry.scale", key="unit")  # fmt: skip
        for key in ("axis", "air_factor"):
            if self.is_meshed and getattr(self, key) != type(self).model_fields[key].default:
                raise refuse(f"is for CAD files, and {Path(self.file).name} is a mesh: its radius is x, and it has its "
                             "air with it; remove it", key=key)  # fmt: skip
        if self.three_dimensional and self.is_meshed:
            reason = "needs solids of a CAD file, which are meshed here; take STEP, or a section"
            raise refuse(reason, key="three_dimensional")
        if self.three_dimensional and self.axis != "z":
            reason = "is of sections; with geometry.three_dimensional turn the parts about z in the CAD program"
            raise refuse(reason, key="axis")

    def warnings(self, scene: Any) -> Iterator[str]:
        """Yield powder that no two bodies shear, or not the disc."""
        if reason := self.why_not_sheared(scene):
            yield reason
        elif scene.particles is not None and self.shape().bodies_at_powder == {"rotor", "housing"}:
            yield ("geometry.bodies: the torque is measured on the disc, and no part that borders the powder belongs "
                   "to it; give one the body 'disc'")  # fmt: skip
    def why_not_sheared(self, scene: Any) -> str:
        """Return that all walls of the powder are of one body, or that both bodies have one speed."""
        bodies = sorted(self.shape().bodies_at_powder)
        if scene.particles is not None and len(bodies) < 2:
            return self.one_body_at_powder()
        motions = [getattr(scene.motion, body, HELD) for body in bodies]
        values = {motion.initial_speed for motion in motions}
        constant = all(motion.speed is not None and motion.speed.is_constant for motion in motions)
        if scene.particles is None or len(bodies) > 2 or len(values) > 1 or not constant:
            return ""
        return (f"motion.{self.shaft_at_powder}.speed: the powder lies between {' and '.join(bodies)}, both at "
                f"{_RPM * values.pop():.4g} rpm; a run shears nothing and gives 0 N m; set another speed, or "
                "the body of a part in geometry.bodies")  # fmt: skip

    def one_body_at_powder(self) -> str:
        """Return that all walls of the powder are of one body, and what to do; empty where they are of more."""
        body = "".join(bodies := self.shape().bodies_at_powder)
        if len(bodies) > 1:
            return ""
        remedy = {"disc": "'housing' or 'rotor'", "": "'disc' and another one 'housing' or 'rotor'"}.get(body, "'disc'")
        own = f"all parts that border the powder belong to the {body}" if body else "the powder is in air"
        return f"geometry.bodies: {own}; nothing shears it; give one the body {remedy}"

    @property
    def shaft_at_powder(self) -> str:
        """The disc where the powder lies between it and the housing."""
        return "disc" if self.shape().bodies_at_powder == {"disc", "housing"} else "rotor"

    def pole_zone(self, shape: CadShape, region: str) -> PoleZone | None:
        """The gaps between steel of two bodies; None without, and where their widths differ by more than 5 %."""
        from emclutch.device_model.pole_zone import PoleZone
        from geometry.cad_shape import mean_radius

        parts = shape.pole_parts()
        if not parts or max(part.width for part in parts) > 1.05 * min(part.width for part in parts):
            return None
        return PoleZone(tuple(part.box for part in parts), sum(part.area for part in parts), mean_radius(parts))

    def bodies_in_words(self, scene: Any) -> str:
        """Return each body with its speed and parts, and between which bodies the powder lies."""
        shape = self.shape()
        parts = {part.region: shape.body(part.region) for part in shape.section.parts if part.region != "powder"}
        found = []
        for body in dict.fromkeys(("disc", "rotor", "housing", *parts.values())):
            motion = getattr(scene.motion, body, HELD)
            constant = motion.speed is not None and motion.speed.is_constant
            speed = f"{_RPM * motion.initial_speed:.4g}" if constant else f"up to {_RPM * motion.largest_speed:.4g}"
            own = ", ".join(part for part, of in parts.items() if of == body)
            found += [f"{body} ({speed} rpm): {own}"] if own else []
        bodies = sorted(shape.bodies_at_powder)
        alone = f"borders {f'the {bodies[0]}' if bodies else 'air'} alone"
        place = f"lies between {' and '.join(bodies)}" if len(bodies) > 1 else alone
        return f"{'; '.join(found)}. The powder {place}"

    def options(self) -> dict[str, Any]:
        """Arguments of the import other than the path; see `geometry.cad_parts.CadFile`."""
        native = "m" if self.is_meshed else _UNIT_OF_SHAPES
        return {
            "names": self.names,
            "needed": tuple(dict.fromkeys(("coil", *(self.materials or ())))),
            "known": ("powder", "air"),
            "axis": self.axis,
            "scale": self.scale * _UNITS[self.unit or native] / _UNITS[native],
            "trust_scripts": self._trust_scripts,
        }

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> CadShape:
        """Return the shape for walls and volumes; `own`: the scene's own materials by name."""
        from geometry.cad_shape import CadShape

        return CadShape(self._section()[1], self.bodies, magnetic_regions(self.materials, own))

    def mesh(self, shape: CadShape, gap_layers: int, size_factor: float) -> SectionMesh:
        """Mesh the section; see `geometry.cad_meshing.mesh_cad`. A finished mesh is taken as it is."""
        from geometry.cad_meshing import mesh_cad

        finished = self._section()[0]
        if finished is not None:
            return finished
        options = self.options() | {"gap_layers": gap_layers, "size_factor": size_factor, "air_factor": self.air_factor}
        return mesh_cad(self.file, **options)

    def solid(self, shape: CadShape, gap_layers: int, size_factor: float, order: int, arc: float = math.inf) -> Solid:
        """Mesh the device in 3D; see `geometry.cad_solid.mesh_cad_solids`."""
        from emclutch.device_model.device_3d import Solid, under_the_poles
        from field.three_d import FlatCoil
        from geometry.cad_solid import mesh_cad_solids

        (coil,) = (part for part in shape.section.parts if part.region == "coil")  # by `check_device_3d`
        options = {key: entry for key, entry in self.options().items() if key != "axis"}
        options |= {"gap_layers": gap_layers, "size_factor": size_factor, "air_factor": self.air_factor}
        mesh = mesh_cad_solids(self.file, section=shape.section, order=order, **options)
        outer = mesh.points[mesh.boundaries["outer"]][..., 2]
        line = under_the_poles(shape)
        (r0, z0), (r1, z1) = coil.lower, coil.upper
        ring, carrier = FlatCoil.ring((r0, r1), (z0, z1)), next(iter(shape.carriers), "housing")
        middle = 0.5 * float(outer.min() + outer.max())
        return Solid(mesh, ring, carrier=carrier, pole_line=line, face_line=line, centre_z=middle)

    def _section(self) -> tuple[SectionMesh | None, CadSection]:
        options = self.options() | ({"any_shape": True} if self.three_dimensional else {})
        path = Path(self.file)
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        options["names"] = tuple(sorted(self.names.items()))
        return _read_section(self.file, changed, self.is_meshed, **options)


@lru_cache(maxsize=8)
def _read_section(
    file: str, changed: int, is_meshed: bool, *, names: tuple[tuple[str, str], ...], **options: Any
) -> tuple[SectionMesh | None, CadSection]:
    """Read a file once for the many that ask; `changed` is its time, so that a new export is seen."""
    from geometry.cad_meshing import cad_section
    from geometry.cad_solid import check_device_3d
    from geometry.section_import import meshed_section

    if not is_meshed:
        section = cad_section(file, names=dict(names), **options)
        if options.get("any_shape"):
            check_device_3d(file, section)
        return None, section
    del options["axis"], options["trust_scripts"]
    return meshed_section(file, names=dict(names), **options)
