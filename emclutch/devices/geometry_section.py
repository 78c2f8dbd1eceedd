"""The base of a kind of device: its table [geometry], and all that generic code may ask of it.

A kind is one module of this package; its shape is one of `geometry` (`geometry.device_shape.DeviceShape`). Generic code
asks the table that the scene has and knows none by name. A shape that a method takes is the kind's own.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, get_args

from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Section

if TYPE_CHECKING:
    import pandas

    from emclutch.device_model.device import Device
    from emclutch.device_model.device_3d import Solid
    from emclutch.device_model.pole_zone import GapZone, PoleZone
    from emclutch.effects.effect import Load
    from emclutch.results.steady_torque import SteadyConditions
    from emclutch.scene.materials import Material
    from emclutch.scene.model import Scene
    from emclutch.simulation.forecast.expected_torque import ExpectedTorque
    from field import Law
    from field.coil.magnetic_circuit import FilledPowder, MagneticCircuit
    from geometry.dimensioned_views import View
    from geometry.fault import GeometryFault
    from geometry.section import SectionMesh
    from geometry.walls import AnnularBox
    from particles import Barostat, ShearedBox

Check = Callable[[PartialScene], Iterator[Fault]]

NO_MATERIALS: Mapping[str, Material] = MappingProxyType({})

ONE_CARRIER = "the field would depend on the angle between both, but it is solved once per current"
"""Why only one body may have slots."""


class GeometrySection(Section):
    """Table [geometry] of a kind; what is said here holds of most, a kind overrides what is otherwise with it.

    Attributes
    ----------
    CHECKS : tuple of (check, sections)
        Checks of this kind against the other sections, and the sections that must be valid for each
        (`emclutch.scene.consistency`).
    has_coil : bool
        Whether it has a winding and parts of materials, so that the field of its coil can be solved.
    has_poles : bool
        Whether the field has pole faces to pass, under which the flux density is a quantity of its own.
    has_axis : bool
        Whether its shafts turn about an axis.
    has_regions : bool
        Whether `particles.region` chooses where its powder is.
    is_periodic : bool
        Whether it is a box of powder that repeats, in all directions or between two faces: its result is a stress.
    largest_fill : float
        Solid fraction up to which grains are packed in it, whatever the packing allows.
    measured : str
        What comes to a steady mean in its runs, `torque` or `stress` (`time.until`); empty: nothing.
    is_annulus : bool
        Whether it is the space between two cylinders, across which a field may be prescribed.
    is_from_file : bool
        Whether it is read from a file: of the grains' space only the boxes that are filled are known.
    is_seen_along_axis : bool
        Whether its grains are drawn as seen along the axis, and not along the gap.
    excluded_roles : tuple of str
        Roles of effects that it cannot have (`EffectSection.role`), so that none of them is missing.
    methods_compared : str
        What both entries of `contact.method` were measured to take in it, in a sentence for `check`; empty: nothing.
    why_no_sector : str
        What is wrong with a cyclic sector of it, and what to do; empty where there may be one.
    """

    CHECKS: ClassVar[tuple[tuple[Check, tuple[str, ...]], ...]] = ()
    has_coil: ClassVar[bool] = False
    has_poles: ClassVar[bool] = False
    has_axis: ClassVar[bool] = True
    has_regions: ClassVar[bool] = False
    is_periodic: ClassVar[bool] = False
    largest_fill: ClassVar[float] = 1.0
    measured: ClassVar[str] = "torque"
    is_annulus: ClassVar[bool] = False
    is_from_file: ClassVar[bool] = False
    is_seen_along_axis: ClassVar[bool] = False
    excluded_roles: ClassVar[tuple[str, ...]] = ()
    methods_compared: ClassVar[str] = ""
    why_no_sector: ClassVar[str] = ""

    @classmethod
    def name(cls) -> str:
        """Return its entry of `geometry.kind`."""
        return get_args(cls.model_fields["kind"].annotation)[0]

    # what the checks ask

    @property
    def may_have_steel_faces(self) -> bool:
        """True if grains may touch walls of steel, in which they see their images."""
        return self.has_coil

    @property
    def key_of_3d(self) -> str:
        """The key for which its coil's field is solved in 3D; empty where that of a section is."""
        return ""

    @property
    def is_solved_in_3d(self) -> bool:
        """True if its coil's field is solved in 3D, and not in the section of a device of revolution."""
        return bool(self.key_of_3d)

    @property
    def is_meshed(self) -> bool:
        """True if it comes with a finished mesh, which is taken as it is."""
        return False

    @property
    def files(self) -> dict[str, Path]:
        """Files that it is read from, by the key that names them."""
        return {}

    def warnings(self, scene: Any) -> Iterator[str]:
        """Yield what is allowed and yet likely not meant."""
        yield from ()

    def why_not_sheared(self, scene: Any) -> str:
        """Return why no two bodies shear the powder; empty where the geometry itself has two."""
        return ""

    def bodies_in_words(self, scene: Any) -> str:
        """Return the bodies of a geometry whose bodies are chosen by the scene; empty of others."""
        return ""

    def false_mirrors(self, shape: Any) -> str:
        """Where images of dipoles in its walls are mirrored in what is no steel; empty where nowhere."""
        return ""

    def check_valid_dimensions(
        self, unknown: set[str], own: Mapping[str, Material], diameter: float | None
    ) -> list[GeometryFault]:
        """Check the valid dimensions against the largest grain [m] where those at the keys `unknown` are invalid."""
        return []

    # what it is built of

    def region_materials(self, regions: Iterable[str]) -> dict[str, str]:
        """Name of the material of each of the mesh's `regions` that has one."""
        return {}

    @abstractmethod
    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> Any:
        """Return the shape for walls and volumes, and for meshing; `own`: the scene's own materials by name."""

    def shape_in(self, scene: Any) -> Any:
        """Return the shape in a scene; of kinds whose size follows from other sections, with these."""
        return self.shape(scene.materials)

    def dimension_views(self, shape: Any) -> list[View]:
        """Return views of the shape with its dimensions and their keys; empty where its file has the dimensions."""
        return []

    def mesh(self, shape: Any, gap_layers: int, size_factor: float) -> SectionMesh:
        """Mesh its section; of kinds with a coil."""
        raise NotImplementedError

    def solid(self, shape: Any, gap_layers: int, size_factor: float, order: int, arc: float = math.inf) -> Solid:
        """Mesh it in 3D, the gap's elements at most `arc` [m] long along the angle; of kinds whose field is so."""
        raise NotImplementedError

    # how its powder is sheared where it has no shafts

    def rate(self, scene: Scene) -> float | None:
        """Return the shear rate [1/s] that is imposed on its powder; None where shafts shear it, or nothing does."""
        return None

    def periodic_box(self, scene: Scene) -> ShearedBox | None:
        """Return the box or repeated gap that the grains are in, sheared at its rate; None where space ends."""
        return None

    def face_speeds(self, scene: Scene) -> dict[str, float]:
        """Return the speeds [rad/s] of bodies that the kind drives itself; those of shafts are in [motion]."""
        return {}

    def barostat(self, scene: Scene) -> Barostat | None:
        """Return what makes the box's height follow an imposed pressure; None where there is none."""
        return None

    def loads(self, scene: Scene) -> Iterator[Load]:
        """Yield forces that press grains together by themselves, those of effects aside."""
        yield from ()

    def words(self, scene: Scene, end: float) -> Iterator[tuple[str, str]]:
        """Yield label and text of what the plan of a run to `end` [s] says of this kind besides."""
        yield from ()

    # what is measured and estimated

    def summarise(
        self, histories: Sequence[pandas.DataFrame], conditions: SteadyConditions, scene: Scene
    ) -> dict[str, Any]:
        """Return entries of ``summary.json`` from the histories of all replicas."""
        return {}

    def pole_zone(self, shape: Any, region: str) -> PoleZone | None:
        """Return the powder's zone between the pole faces; None without pole faces."""
        return None

    def gap_zone(self, shape: Any, region: str) -> GapZone | None:
        """Return the gap that is sheared as a whole: it has a fill and an inertial number; None without."""
        return None

    def gap_key(self, shape: Any, region: str) -> str | None:
        """Return the key of the width of the gap that is sheared; None where no single key sets it."""
        return None

    @property
    def shaft_at_powder(self) -> str:
        """Shaft whose speed is that of a map."""
        return "rotor"

    def magnetic_circuit(self, shape: Any, laws: Mapping[str, Law], powder: FilledPowder | None) -> MagneticCircuit:
        """Return the circuit of reluctances that estimates its field; of kinds with poles."""
        raise NotImplementedError

    def cooled_surface(self, shape: Any) -> float | None:
        """Surface [m^2] that still air cools; None where it is not known."""
        return None

    def clearances(self, shape: Any) -> list[AnnularBox] | None:
        """Return the rings of still air between its solid parts, through which heat is conducted; None: not known."""
        return None

    def impact_radius(self, shape: Any) -> float | None:
        """Radius [m] of what meets grains at rest; None where they are sheared in layers."""
        return None

    def friction_torque(self, scene: Any, device: Device) -> ExpectedTorque | None:
        """Return the torque that it has without a field; None where it is that of friction in a sheared gap."""
        return None
