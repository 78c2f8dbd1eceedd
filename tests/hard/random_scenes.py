"""Random scenes: hypothesis strategies over the whole schema, most of them right, all of them small.

A scene is nested dictionaries as TOML reads them, with the files that it names. Amounts, sizes and times are drawn so
that most runs take a second or less; the predicted cost decides which of them are run (`scene_verdict`). They
are broken on purpose by `random_faults`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hypothesis import strategies as st
from random_agreement import agreed
from random_devices import CURVE, boxes, magnetic_clutches, shear_cells, shot_clutches, uniform_field
from random_values import Table, numbers, quantities, some


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
        Fraction of the file's bytes after which it ends, with one that is no text.
    """

    data: Table
    files: dict[str, str] = field(default_factory=dict)
    study: Table | None = None
    named: tuple[str, ...] = ()
    breaks: tuple[str, ...] = ()
    cut: float | None = None


titles = st.sampled_from(
    ("A scene", "50 % of 3 $ & 4 $", "$\\nonsense{", "<b>Größe</b> μ₀ 漢字 🧲", "[red]x[/nope]", "x" * 150)
)
shares = numbers(0.05, 0.9)

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


gravity = some(
    acceleration=quantities(0.0, 20.0, "m/s^2"),
    direction=st.sampled_from(([0.0, 0.0, -1.0], [0, -1, 0], [1.0, 2.0, 3.0], [0, 0, 1e-5])),
)
dipoles = some(
    model=st.sampled_from(("mutual", "near_field")),
    cutoff=numbers(1.5, 4.0),
    update_every=st.integers(1, 20) | st.just("auto"),
    tolerance=numbers(1e-6, 0.01),
    surface_gap=numbers(1e-3, 0.1),
)
resistance = some(coefficient=numbers(0.0, 1.0), wall_coefficient=numbers(0.0, 1.0))
cohesion = st.fixed_dictionaries({"force": quantities(0.0, 1e-2, "mN", 1e3)}) | st.fixed_dictionaries(
    {"model": st.sampled_from(("dmt", "jkr")), "work_of_adhesion": quantities(0.0, 0.1, "J/m^2")}
)
PLAIN = {"gravity": gravity, "rolling_friction": resistance, "twisting_friction": resistance, "cohesion": cohesion}
MAGNETIC = {"dipoles": dipoles, "magnetic_force": st.just({}), "saturation": st.just({}), "wall_images": st.just({})}
OF_A_COIL = {
    "back_reaction": some(tolerance=numbers(0.01, 0.5)),
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
