"""Strategies for the devices of a random scene: shape, grains in it, shafts, coil."""

from __future__ import annotations

from hypothesis import strategies as st
from random_values import Table, courses, lengths, millimetres, numbers, quantities, seldom, some

speeds = quantities(-200.0, 200.0, "rpm", 9.549)
materials = st.sampled_from(("steel_1010", "aluminium", "cast_iron", "stainless_304", "armco_iron", "mine"))


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
