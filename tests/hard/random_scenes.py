"""Random scenes: hypothesis strategies over the whole schema, most of them right, all of them small.

A scene is nested dictionaries as TOML reads them, with the files that it names. Amounts, sizes and times are drawn so
that most runs take a second or less; which of them are run is decided by what they are foretold (`scene_verdict`). They
are broken on purpose by `random_faults`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from hypothesis import strategies as st
from random_agreement import agreed

Table = dict[str, Any]


@dataclass(frozen=True, slots=True)
class RandomScene:
    """A scene, or a study of it, as a user would hand it in.

    Attributes
    ----------
    data : dict
        The scene.
    files : dict of str to str
        Text of each file that lies beside it, by name.
    study : dict or None
        The study file, if there is one.
    named : tuple of str
        Keys that are wrong for certain: a refusal has to name each.
    breaks : tuple of str
        What was done to it, in words.
    cut : float or None
        Share of the file's bytes after which it ends, with one that is no text.
    """

    data: Table
    files: dict[str, str] = field(default_factory=dict)
    study: Table | None = None
    named: tuple[str, ...] = ()
    breaks: tuple[str, ...] = ()
    cut: float | None = None


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers of four digits."""
    return st.floats(low, high, allow_nan=False).map(lambda value: float(f"{value:.4g}"))


def quantities(low: float, high: float, unit: str, per_si: float = 1.0) -> st.SearchStrategy[float | str]:
    """From `low` to `high` in SI, as a bare number or as a text in a unit of which `per_si` make one of SI."""
    return numbers(low, high) | numbers(low, high).map(lambda value: f"{value * per_si:.4g} {unit}")


def lengths(low: float, high: float) -> st.SearchStrategy[float | str]:
    return quantities(low, high, "mm", 1e3)


def courses(values: st.SearchStrategy) -> st.SearchStrategy:
    """One value, or a table in time of it."""
    tables = st.lists(numbers(1e-5, 1e-3), min_size=1, max_size=4, unique=True).flatmap(
        lambda times: st.fixed_dictionaries(
            {"times": st.just(sorted(times)), "values": st.lists(values, min_size=len(times), max_size=len(times))}
        )
    )
    return values | values | tables


def some(**optional: st.SearchStrategy) -> st.SearchStrategy[Table]:
    """A table of which every key may be left out."""
    return st.fixed_dictionaries({}, optional=optional)


def seldom(strategy: st.SearchStrategy) -> st.SearchStrategy:
    """Mostly None."""
    return st.sampled_from((0, 0, 0, 1)).flatmap(lambda on: strategy if on else st.none())


titles = st.sampled_from(
    ("A scene", "50 % of 3 $ & 4 $", "$\\nonsense{", "<b>Größe</b> μ₀ 漢字 🧲", "[red]x[/nope]", "x" * 150)
)
shares = numbers(0.05, 0.9)
speeds = quantities(-200.0, 200.0, "rpm", 9.549)
materials = st.sampled_from(("steel_1010", "aluminium", "cast_iron", "stainless_304", "armco_iron", "mine"))

FRICTION = {
    "friction": numbers(0.0, 1.0), "wall_friction": numbers(0.0, 1.0),
    "restitution": shares, "wall_restitution": shares, "max_overlap": numbers(1e-3, 0.02),
}  # fmt: skip
LAWS: dict[str, dict[str, st.SearchStrategy]] = {
    "linear": {"tangential_ratio": numbers(0.0, 1.0), "stiffness": quantities(1e3, 1e6, "kN/m", 1e-3),
               "wall_stiffness": quantities(1e4, 1e6, "kN/m", 1e-3)},
    "hertz_mindlin": {"youngs_modulus": quantities(1e7, 1e9, "MPa", 1e-6), "poisson_ratio": numbers(0.0, 0.5),
                      "wall_youngs_modulus": quantities(1e7, 1e9, "MPa", 1e-6), "wall_poisson_ratio": numbers(0.0, 0.5),
                      "shear_modulus": quantities(1e7, 1e9, "MPa", 1e-6),
                      "wall_shear_modulus": quantities(1e7, 1e9, "MPa", 1e-6)},
    "hertz": {"hertz_stiffness": quantities(1e6, 1e9, "N/m^1.5"), "reference_speed": quantities(0.01, 1.0, "m/s"),
              "wall_hertz_stiffness": quantities(1e6, 1e9, "N/m^1.5"), "tangential_ratio": numbers(0.0, 1.0)},
    "thesis": {"stiffness": quantities(1e4, 1e6, "kN/m", 1e-3), "overlap_factor": st.sampled_from(("sqrt", "one")),
               "wall_stiffness": quantities(1e4, 1e6, "kN/m", 1e-3), "tangential_ratio": numbers(0.0, 1.0),
               "reference_speed": quantities(0.01, 1.0, "m/s")},
    "walton_braun": {"stiffness": quantities(1e3, 1e5, "kN/m", 1e-3), "tangential_ratio": numbers(0.0, 1.0),
                     "unloading_stiffness": quantities(1e5, 1e6, "kN/m", 1e-3),
                     "wall_stiffness": quantities(1e3, 1e5, "kN/m", 1e-3),
                     "wall_unloading_stiffness": quantities(1e5, 1e6, "kN/m", 1e-3)},
}  # fmt: skip
rigid = some(
    friction_law=st.sampled_from(("coulomb", "convex")),
    solver=st.sampled_from(("accelerated", "accelerated", "gauss_seidel")),
    springs=st.booleans(),
    tolerance=quantities(1e-6, 1e-3, "mm/s", 1e3),
    max_sweeps=st.integers(1, 500),
    allowed_misses=numbers(0.0, 1.0),
    step=quantities(1e-6, 1e-4, "us", 1e6),
    allow_long_step=st.booleans(),
    theta=numbers(0.5, 1.0),
    threshold=quantities(1e-4, 1e-2, "mm/s", 1e3),
)


@st.composite
def contacts(draw: st.DrawFn, method: str) -> Table:
    law = draw(st.sampled_from(("linear", "linear", *LAWS)))
    table = draw(some(**FRICTION)) | {"law": law, "method": method}
    if draw(st.booleans()):
        table |= draw(some(**LAWS[law]))
    if method == "dvi" or draw(st.booleans()):
        table["dvi"] = draw(rigid)
    return table


def shafts(free: bool) -> st.SearchStrategy[Table]:
    motor = st.fixed_dictionaries(
        {"stall_torque": quantities(1e-3, 10.0, "N m"), "no_load_speed": quantities(1.0, 100.0, "rpm", 9.549)},
        optional={"switched_on": numbers(0.0, 1e-3)},
    )
    inertia = {"inertia": quantities(1e-6, 1.0, "kg m^2")}
    load = {"load_torque": courses(quantities(0.0, 1.0, "N m")), "initial_speed": speeds}
    by_torque = st.fixed_dictionaries(
        inertia, optional=load | {"drive_torque": quantities(-1.0, 1.0, "N m")}
    ) | st.fixed_dictionaries(inertia | {"motor": motor}, optional=load)
    driven = st.fixed_dictionaries({"speed": courses(speeds)})
    return driven | st.fixed_dictionaries({"free": by_torque}) if free else driven


gravity = some(
    acceleration=quantities(0.0, 20.0, "m/s^2"),
    direction=st.sampled_from(([0.0, 0.0, -1.0], [0, -1, 0], [1.0, 2.0, 3.0], [0, 0, 1e-5])),
)
dipoles = some(
    model=st.sampled_from(("fixed", "mutual", "near_field")),
    cutoff=numbers(1.5, 4.0),
    update_every=st.integers(1, 20) | st.just("auto"),
    tolerance=numbers(1e-6, 0.01),
    surface_gap=numbers(1e-3, 0.1),
)
couples = some(coefficient=numbers(0.0, 1.0), wall_coefficient=numbers(0.0, 1.0))
cohesion = st.fixed_dictionaries({"force": quantities(0.0, 1e-2, "mN", 1e3)}) | st.fixed_dictionaries(
    {"model": st.sampled_from(("dmt", "jkr")), "work_of_adhesion": quantities(0.0, 0.1, "J/m^2")}
)
PLAIN = {"gravity": gravity, "rolling_friction": couples, "twisting_friction": couples, "cohesion": cohesion}
MAGNETIC = {"dipoles": dipoles, "magnetic_force": st.just({}), "saturation": st.just({}), "wall_images": st.just({})}
OF_A_COIL = {
    "back_reaction": some(tolerance=numbers(0.01, 0.5) | st.just("auto")),
    "coil_circuit": some(begin=st.sampled_from(("off", "steady")), tolerance=numbers(0.01, 0.5)),
    "eddy_currents": some(
        begin=st.sampled_from(("off", "steady")),
        tolerance=numbers(0.02, 0.5),
        conductivity=some(steel_1010=quantities(0.0, 1e7, "MS/m", 1e-6)),
    ),
}


@st.composite
def effects(draw: st.DrawFn, *groups: dict[str, st.SearchStrategy]) -> Table:
    """Weight more often than not; of the others each now and then, those of a group that is there half the time."""
    found = {"gravity": draw(gravity)} if draw(st.sampled_from((True, True, False))) else {}
    for number, group in enumerate(groups):
        for name, table in group.items():
            if draw(st.sampled_from((True, False) if number else (True, False, False, False))):
                found.setdefault(name, draw(table))
    return found


def times(known: bool) -> st.SearchStrategy[Table]:
    """[time]; `known`: there is a torque that can be known."""
    until = st.sampled_from(("torque 20 %", "torque 1 N m", "torque 5 % or 0.1 N m"))

    def with_window(end: float) -> st.SearchStrategy[Table]:
        return st.fixed_dictionaries(
            {"end": st.sampled_from((end, f"{1e3 * end:.4g} ms"))},
            optional={
                "window": st.sampled_from((end / 2, end / 5, "auto")),
                "step": st.sampled_from((end / 1000, "auto", "auto", "auto")),
                "steps_per_contact": numbers(10.0, 40.0),
                "average_from": st.sampled_from((0.0, 0.5 * end)),
            }
            | ({"until": until} if known else {}),
        )

    return numbers(5e-5, 2e-3).flatmap(with_window)


output = some(
    snapshots=st.integers(0, 3),
    formats=st.sampled_from(([], ["vtk"], ["hdf5"], ["vtk", "hdf5"])),
    energy_budget=st.sampled_from((True, True, True, False)),
    profiles=st.booleans(),
    checkpoint=st.booleans(),
)


def header() -> st.SearchStrategy[Table]:
    return st.fixed_dictionaries(
        {"title": titles},
        optional={"seed": st.integers(0, 2**63 - 1), "description": st.sampled_from(("", "two\nlines", '""" \' \\'))},
    )


material = some(
    density=quantities(1000.0, 8000.0, "g/cm^3", 1e-3),
    susceptibility=numbers(1.0, 1000.0),
    saturation=quantities(1e5, 2e6, "kA/m", 1e-3),
    law=st.sampled_from(("sphere", "thesis")),
)


@st.composite
def grains(draw: st.DrawFn, thickness: float, most: int) -> Table:
    """Grains for a space of that least thickness [m], at most so many of them."""
    d = draw(numbers(thickness / 8, thickness / 2.2))
    table: Table = {"count": draw(st.integers(1, most))}
    if draw(st.sampled_from((True, False, False))):
        table = draw(st.sampled_from(({"solid_fraction": 0.02}, {"solid_fraction": 0.2}, {"mass": "1 g"})))
    sizes = {
        "uniform": {"min": 0.8 * d, "max": d},
        "normal": {"mean": 0.9 * d, "deviation": 0.02 * d},
        "log_normal": {"median": 0.8 * d, "spread": 1.05},
        "list": {"diameters": [0.6 * d, d], "shares": [1, 3], "by": "mass"},
        "file": {"file": "sizes.csv"},
    }
    kind = draw(seldom(st.sampled_from(tuple(sizes))))
    table |= (
        {"diameter": draw(st.sampled_from((d, f"{1e3 * d:.4g} mm")))}
        if kind is None
        else {"sizes": {"kind": kind} | sizes[kind]}
    )
    table |= draw(material)
    packing = draw(st.sampled_from(("random", "random", "grow", "lattice", "pour")))
    table["packing"] = packing
    if packing == "lattice":
        table |= draw(some(lattice=st.sampled_from(("sc", "fcc", "hcp")), noise=numbers(0.0, 1.0)))
    if draw(st.sampled_from((True, False, False, False))):
        table |= {"settle": draw(st.booleans()), "settle_longest": "1 ms", "settle_kinetic": 0.05}
    return table


def millimetres(**low_and_high: tuple[float, float]) -> st.SearchStrategy[Table]:
    return st.fixed_dictionaries({name: lengths(1e-3 * a, 1e-3 * b) for name, (a, b) in low_and_high.items()})


GAPS = {"gap": (1.0, 1.5), "face_gap": (1.0, 1.5)}
SECTION = {
    "disc_radius": (19.0, 22.0), "disc_thickness": (7.0, 9.0), **GAPS, "seal_radius": (17.0, 18.5),
    "rotor_wall": (2.5, 4.0), "ring_width": (2.0, 4.0), "cover_thickness": (2.0, 3.0), "clearance": (0.3, 0.6),
    "coil_width": (4.0, 6.0), "coil_height": (4.0, 6.0), "yoke": (3.0, 5.0), "shaft_radius": (3.0, 5.0),
}  # fmt: skip
SHOT = {
    "drum_radius": (30.0, 40.0), "width": (15.0, 25.0), "hub_radius": (8.0, 12.0), "vane_thickness": (1.0, 2.0),
    "tip_clearance": (0.5, 1.0), "side_clearance": (0.3, 0.6),
}  # fmt: skip
slots = st.fixed_dictionaries(
    {"count": st.sampled_from((6, 12, 90)), "depth": lengths(1e-3, 2e-3)}, optional={"share": numbers(0.3, 0.6)}
)
uniform_field = st.fixed_dictionaries(
    {
        "source": st.just("uniform"),
        "field_strength": quantities(-2e5, 2e5, "kA/m", 1e-3),
        "direction": st.sampled_from(("x", "y", "z", "axial", "radial")),
    },
    optional={"means": st.sampled_from(("applied", "macroscopic"))},
)
coil_field = st.fixed_dictionaries(
    {"source": st.just("coil"), "size_factor": numbers(3.0, 4.0)},
    optional={
        "order": st.integers(1, 3), "gap_layers": st.integers(3, 4), "open_boundary": st.booleans(),
        "newton_tolerance": numbers(1e-10, 1e-4),
    },
)  # fmt: skip
own_material = st.sampled_from(
    (
        {"law": "linear", "relative_permeability": 500.0},
        {"law": "froehlich", "susceptibility": 1000.0, "saturation": "1.6 MA/m", "conductivity": "5 MS/m"},
        {"law": "langevin", "susceptibility": 300.0, "saturation": 1.5e6},
        {"law": "brauer", "k1": "0.4 m/H", "k2": 2.2, "k3": "396 m/H"},
        {"law": "permeability", "initial_permeability": 200.0, "scale": "1.1 T", "c_a": 8100.0, "c_b": 2.6, "n": 10.0},
        {"law": "table", "H": [0.0, 200.0, 1000.0, 1e4], "B": ["0 T", "0.9 T", "1.4 T", "1.8 T"]},
        {"law": "table", "table": "curve.csv"},
    )
)
CURVE = "H [A/m], B [T]\n0, 0\n200, 0.9\n1000, 1.4\n10000, 1.8\n"


@st.composite
def coils(draw: st.DrawFn) -> Table:
    drive = {"current": draw(courses(quantities(-3.0, 3.0, "mA", 1e3)))}
    if draw(st.booleans()):
        drive = {"voltage": draw(courses(quantities(1.0, 24.0, "V")))}
    turns = draw(st.sampled_from(({"turns": 300}, {"resistance": "5 ohm"}, {"turns": 200, "resistance": 3.0})))
    return drive | turns | draw(some(temperature=numbers(-20.0, 150.0)))


@st.composite
def boxes(draw: st.DrawFn) -> Table:
    size = [draw(numbers(5e-3, 2e-2)) for _ in range(3)]
    scene: Table = {"geometry": {"kind": "box", "size": size}, "particles": draw(grains(min(size), 60))}
    if draw(st.sampled_from((True, False, False, False))):
        scene["particles"] = {"packing": "file", "packing_file": "grains.csv", "diameter": "1.5 mm"}
    if draw(st.sampled_from((True, False, False, False))):
        surface = {"file": "tile.stl", "scale": 1e-3, "body": draw(st.sampled_from(("rotor", "disc", "housing")))}
        scene["surfaces"] = {"tile": surface}
        scene["motion"] = {"rotor": draw(shafts(True))} if surface["body"] == "rotor" else {}
    return scene


@st.composite
def shear_cells(draw: st.DrawFn) -> Table:
    inner, gap, height = draw(numbers(8e-3, 2e-2)), draw(numbers(4e-3, 8e-3)), draw(numbers(4e-3, 1e-2))
    shape = {"kind": "shear_cell", "inner_radius": inner, "outer_radius": inner + gap, "height": height}
    scene: Table = {"geometry": shape | draw(some(steel=st.booleans()))}
    scene["particles"] = draw(grains(min(gap, height), 80))
    sector = draw(seldom(st.sampled_from(("180 deg", "120 deg", "90 deg"))))
    if sector is not None:
        scene["particles"]["sector"] = sector
    scene["motion"] = draw(some(rotor=shafts(True), disc=shafts(True)))
    return scene


@st.composite
def shot_clutches(draw: st.DrawFn) -> Table:
    shape = draw(millimetres(**SHOT)) | {"kind": "centrifugal", "vanes": draw(st.integers(1, 6))}
    if draw(st.booleans()):
        shape |= {"ribs": draw(st.integers(0, 8)), "rib_height": "1 mm", "rib_width": "2 mm"}
    if draw(st.booleans()):
        shape |= {"slots": 1, "slot_width": "5 mm", "slot_depth": "6 mm"}
    return {
        "geometry": shape,
        "particles": draw(grains(1.2e-2, 60)),
        "motion": draw(some(rotor=shafts(True), disc=shafts(True))),
    }


@st.composite
def magnetic_clutches(draw: st.DrawFn) -> Table:
    kind = draw(st.sampled_from(("drum", "drum", "clutch")))
    shape = draw(millimetres(**SECTION)) | {"kind": kind}
    scene: Table = {"geometry": shape, "particles": draw(grains(1e-3, 40))}
    if draw(st.sampled_from((True, False, False))):
        shape["materials"] = draw(some(disc=materials, rotor=materials, housing=materials))
    if draw(st.booleans()):
        scene["materials"] = {"mine": draw(own_material)}
    if draw(st.sampled_from((True, False, False, False, False, False, False, False))):
        shape[draw(st.sampled_from(("disc_slots", "rotor_slots")))] = draw(slots)
    shape |= draw(some(air_factor=numbers(2.0, 4.0)))
    scene["particles"] |= {"region": draw(st.sampled_from(("rim", "rim", "faces", "cavity")))}
    sector = draw(st.sampled_from((None, "12 deg", "30 deg", "20 deg")))
    if sector is not None:
        scene["particles"]["sector"] = sector
    scene["motion"] = draw(some(rotor=shafts(True), disc=shafts(True)))
    if draw(st.booleans()):
        scene["coil"], scene["field"] = draw(coils()), draw(coil_field)
    return scene


@st.composite
def scenes(draw: st.DrawFn) -> RandomScene:
    """A scene that its author might have meant; whether it is right is for the program to say."""
    device = draw(st.sampled_from((boxes, boxes, shear_cells, shear_cells, shot_clutches, magnetic_clutches)))
    scene = draw(device())
    if "field" not in scene and draw(st.sampled_from((True, False, False))):
        scene["field"] = draw(uniform_field)
    groups = [PLAIN]
    if "field" in scene:
        groups += [MAGNETIC]
    if "coil" in scene:
        groups += [OF_A_COIL]
    method = draw(st.sampled_from(("dem", "dem", "dvi")))
    scene |= {
        "scene": draw(header()),
        "contact": draw(contacts(method)),
        "effects": draw(effects(*groups)),
        "time": draw(times(scene["geometry"]["kind"] != "box")),
        "output": draw(output) | {"pictures": draw(st.sampled_from((False,) * 7 + (True,)))},
        "accuracy": {"replicas": 1} if draw(st.sampled_from((True,) * 9 + (False,))) else {},
    }
    return RandomScene(agreed(scene) if draw(st.sampled_from((True, True, True, False))) else scene, beside())


def beside() -> dict[str, str]:
    """The files that a scene may name."""
    return {
        "sizes.csv": "diameter [mm], mass [%]\n1.2, 40\n1.5, 60\n",
        "curve.csv": CURVE,
        "grains.csv": "x [mm], y [mm], z [mm]\n" + "".join(f"{x}, {y}, {z}\n" for x, y, z in _places()),
        "tile.stl": "solid\nfacet normal 0 0 1\nouter loop\nvertex -1 -1 2\nvertex 1 -1 2\nvertex 0 1 2\nendloop\n"
        "endfacet\nendsolid\n",
    }


def _places() -> list[tuple[float, float, float]]:
    return [(x, y, z) for x in (-1.6, 0.0, 1.6) for y in (-1.6, 0.0) for z in (1.0, 3.4)]


@st.composite
def studies(draw: st.DrawFn) -> RandomScene:
    """A study of few points over a cheap scene."""
    base = draw(scenes())
    values = {
        "contact.friction": [0.1, 0.5], "scene.seed": [1, 2], "motion.rotor.speed": ["10 rpm"],
        "particles.density": ["2.5 g/cm^3"], "time.end": ["0.1 ms"], "effects.gravity.acceleration": [9.81],
    }  # fmt: skip
    keys = draw(st.lists(st.sampled_from(sorted(values)), min_size=1, max_size=2, unique=True))
    study: Table = {"case": "scene.toml", "values": {key: values[key] for key in keys}}
    if draw(st.booleans()):
        study["set"] = {"output.pictures": False}
    if draw(st.sampled_from((True, False, False))):
        study["warm_start"] = keys[0]
    return RandomScene(base.data, base.files, {"study": study})
