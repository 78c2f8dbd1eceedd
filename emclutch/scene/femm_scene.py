"""A scene from a model of FEMM: its regions, materials, winding and bodies, or the reasons why there is none.

What is magnetic, what conducts, and solids within the air are parts, named after material and group. Air is not
drawn: what no part fills is air. The outer boundary is left out with it, whatever it approximates open space by (a wall
of A = 0, an asymptotic condition, the shells of FEMM's own builder, a Kelvin transformation): the field of a scene is
open. Parts of group 0 are the housing, which stands still; of the other groups the lowest is the disc, the next the
rotor.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from emclutch.devices.cad import CadGeometry
from emclutch.scene.errors import Fault, SceneError
from geometry.cad_shape import CadShape
from geometry.fault import millimetres
from geometry.femm_file import FemmEdge, FemmLabel, FemmModel, FemmProperty, read_femm
from geometry.femm_section import FemmSection, faces_as_brep, femm_section
from geometry.table_file import FileFault

_AIR = re.compile(r"(?i)\b(air|vacuum|luft)\b")
_SHELL = re.compile(r"u\d+")  # as FEMM's builder of open boundaries names the materials of its shells
_EQUAL = 1e-3  # of the turns per area in the pieces of a winding
_SOLID_MU, _SOLID_SIGMA = 100.0, 1.0  # permeability and conductivity [MS/m] that solid metal exceeds and no powder does
_BODIES = {"disc": "torque is measured on it", "rotor": "turns", "housing": "stands still"}
_MIXED, _PERIODIC = 2, 4
_SQUARE_WIRE = 6  # LamType
_MOST_ROUND = np.pi / np.sqrt(12.0)  # largest fill of round wire, which a hexagonal winding has
_BOUNDARIES = {0: "prescribed A", 1: "small skin depth", 2: "mixed", 3: "strategic dual image", 4: "periodic",
               5: "antiperiodic", 6: "periodic air gap", 7: "antiperiodic air gap"}  # fmt: skip

_Reasons = Iterator[tuple[int, str]]
"""Line of the file, 0 for the whole file, and what is wrong with it and what to do."""


def femm_scene(path: Path, stem: str, powder: str | None = None) -> tuple[dict[str, Any], dict[str, str], list[str]]:
    """Make the tables [scene], [geometry], [materials], [coil] and [field] from a model, and notes for the reader.

    With powder that borders no part of the rotor also [motion], in which the disc turns. Warns where nothing shears the
    powder, or more groups turn than a scene has bodies.

    Parameters
    ----------
    path : Path
        Model of FEMM.
    stem : str
        Beginning of the names of the files beside the scene, whose texts are returned by name.
    powder : str, optional
        Material whose regions the grains fill.

    Raises
    ------
    SceneError
        What the file holds that cannot be read, or has no counterpart, with its line.
    """
    try:
        model = read_femm(path)
        _refuse(path, [*_head_reasons(model), *_label_reasons(model, powder)])
        section = femm_section(model)
        air = {label for label in model.labels if _is_air(label, model, section)}
        reasons = [*_outline_reasons(model, section, air), *_winding_reasons(model, section)]
        _refuse(path, [*reasons, *_powder_reasons(model, section, powder)])
        regions = {label: _region(label, powder) for label in model.labels if label not in air or _is(label, powder)}
        drawing, order = faces_as_brep(model, list(regions))
    except FileFault as fault:
        raise SceneError([Fault("", "", fault.reason)], str(path)) from None
    solid = {name: label for label, name in regions.items() if name not in ("coil", "powder")}
    used = {_key(label): label.material for label in solid.values()}
    pairs = [(label, {solid[region].material.name, used[_key(label)].name, label.material.name})
             for label, region in regions.items() if region in solid]  # fmt: skip
    _refuse(path, [(label.line, f"{' and '.join(map(repr, sorted(names)))} are one name in the scene; rename one")
                   for label, names in pairs if len(names) > 1])  # fmt: skip
    curves = {f"{stem}_{name}.csv": _curve(one) for name, one in used.items() if len(one.curve)}
    groups = sorted({label.group for label in solid.values()} - {0})
    group_body = dict(zip(groups, ("disc", "rotor"), strict=False))
    bodies = {name: group_body.get(label.group, "housing") for name, label in solid.items()}
    if others := [name for name, label in solid.items() if label.group in groups[2:]]:
        warnings.warn(f"{', '.join(others)} {'stand' if others[1:] else 'stands'} still: the model has {len(groups)} "
                      "groups besides 0, a scene has two bodies that turn; give these parts a body in geometry.bodies",
                      stacklevel=2)  # fmt: skip
    coil = [label for label in model.labels if label.current]
    data = {
        "scene": {"title": f"{path.stem}, a model of FEMM"},
        "geometry": {
            "kind": "cad", "file": f"{stem}.brep",
            "materials": {name: _key(label) for name, label in solid.items()},
            "names": {f"part{number}": regions[label] for number, label in enumerate(order, 1)},
            "bodies": bodies,
        },
        "materials": {name: _material(one, f"{stem}_{name}.csv") for name, one in used.items()},
        "coil": {"current": f"{coil[0].current:.10g} A", "turns": sum(abs(label.turns) for label in coil)},
        "field": {"source": "coil"},
    }  # fmt: skip
    with TemporaryDirectory(prefix="emclutch-") as folder:
        (Path(folder) / f"{stem}.brep").write_text(drawing, encoding="utf-8")
        geometry = CadGeometry.model_validate(data["geometry"], context={"folder": Path(folder)})
        shape, reason = geometry.shape(), geometry.one_body_at_powder()
    if powder is not None and reason:
        several = ", ".join(name for name in solid if list(regions.values()).count(name) > 1)
        one = f"; several regions of one material and one group are one part: {several}" if several else ""
        warnings.warn(f"{reason}, or in FEMM give turning parts another group; repeat the command{one}", stacklevel=2)
    if powder is not None and "rotor" not in shape.bodies_at_powder:
        data["motion"] = {"rotor": {"speed": 0.0}, "disc": {"speed": "1000 rpm"}}
    return data, {f"{stem}.brep": drawing, **curves}, list(_notes(shape, model, section, powder))


def _notes(shape: CadShape, model: FemmModel, section: FemmSection, powder: str | None) -> Iterator[str]:
    bottom = min(part.lower[1] for part in shape.section.parts)
    radius, top = np.max([part.upper for part in shape.section.parts], axis=0)
    gap = f", narrowest gap of the powder {millimetres(shape.gap)}" if powder is not None else ""
    yield f"Size: largest radius {millimetres(radius)}, length {millimetres(top - bottom)}{gap}."
    yield "Bodies: the lowest group number above 0 is the disc, the next is the rotor, group 0 is the housing."
    for body, what in _BODIES.items():
        yield f"  {body} ({what}): {', '.join(part for part, own in shape.bodies.items() if own == body) or 'no part'}"
    yield "  To change them, edit bodies in [geometry] of the scene."
    ends = {model.boundaries[edge.boundary - 1].name for edge in section.outline if edge.boundary}
    names = ", ".join(map(repr, sorted(ends)))
    yield f"Space without a part is air. The outer boundary ({names}) is replaced by open space."
    if powder is not None:
        yield "  Where air borders the powder stands a wall that does not turn and belongs to no body."
        yield "Speeds, fill and grain size are examples: change them in [motion] and [particles] of the scene."
    yield from _wire_notes(model, section)
    if powder is None:
        named = " or ".join(f"--powder {name!r}" for name in _powders(model, section))
        remedy = f"repeat the command with {named}" if named else "draw it as a region with a material of its own"
        yield f"Without powder: the scene gives the field, not the torque. If a region is the powder, {remedy}."


def _wire_notes(model: FemmModel, section: FemmSection) -> Iterator[str]:
    """Yield that the wire of the winding is not used, and the keys that give its resistance."""
    from field.coil.winding import Winding  # local: the schema itself needs no field

    coil = [label for label in model.labels if label.current]
    wire, turns = coil[0].material, sum(abs(label.turns) for label in coil)
    if not wire["wired"]:
        return
    share, most = (1.0, 1.0) if wire["lamtype"] == _SQUARE_WIRE else (0.25 * np.pi, _MOST_ROUND)
    copper = max(1.0, wire["nstrands"]) * share * wire["wired"] ** 2
    areas, radii = ([values[label] for label in coil] for values in (section.areas, section.radii))
    area, radius = sum(areas), float(np.average(radii, weights=areas))
    text = f"The wire of {wire['wired']:.4g} mm of the model is not used: the winding has a fill of 0.6"
    if (fill := 1e-6 * turns * copper / area) > most:
        yield f"{text}. This wire does not fit into it {turns:g} times: the fill is {fill:.3g}, at most {most:.2g}."
        return
    resistance = Winding(turns, area, radius, fill).resistance
    yield (f"{text}, the model {fill:.3g}. Resistance and copper loss differ, torque at a current does not. For those "
           f"of the wire replace coil.turns by coil.resistance = '{resistance:.6g} ohm' and coil.fill_factor = "
           f"{fill:.6g}.")  # fmt: skip


def _refuse(path: Path, reasons: list[tuple[int, str]]) -> None:
    texts = [f"line {line}: {text}" if line else text for line, text in sorted(set(reasons))]
    if texts:
        raise SceneError([Fault("", "", text) for text in texts], str(path))


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or "unnamed"


def _key(label: FemmLabel) -> str:
    """Name of a label's material in the scene, which no built-in material has."""
    return f"femm_{_plain(label.material.name)}"


def _is(label: FemmLabel, powder: str | None) -> bool:
    return powder is not None and _plain(label.material.name) == _plain(powder)


def _is_magnetic(one: FemmProperty) -> bool:
    return bool(len(one.curve)) or one["mu_x"] != 1.0 or one["mu_y"] != 1.0


def _is_shell(label: FemmLabel, model: FemmModel) -> bool:
    """True in a shell of FEMM's own open boundary, of which some have a permeability below 1."""
    shells = [one.material for one in model.labels if _SHELL.fullmatch(one.material.name)]
    return bool(_SHELL.fullmatch(label.material.name)) and any(one["mu_x"] < 1.0 for one in shells)


def _is_air(label: FemmLabel, model: FemmModel, section: FemmSection) -> bool:
    """True for regions without a part: air, idle windings, shells, the outside of a Kelvin transformation."""
    one = label.material
    empty = not one["sigma"] and (bool(_AIR.search(one.name)) or label in section.outline.values())
    idle = not label.current and not _is_magnetic(one) and (label.is_wound or empty)
    return idle or label.is_external or _is_shell(label, model)


def _region(label: FemmLabel, powder: str | None) -> str:
    name = _plain(label.material.name)
    if label.current or _is(label, powder):
        return "coil" if label.current else "powder"
    part = f"{name}_part" if name in ("coil", "powder", "air") else name
    return f"{part}_{label.group}" if label.group else part


def _head_reasons(model: FemmModel) -> _Reasons:
    """What the model as a whole is that no scene can be."""
    for key, right, reason in (
        ("Format", r"4(\.\d*)?", "open it in FEMM 4.2 and save it"),
        ("Frequency", r"0*\.?0*", "a time-harmonic problem has no counterpart, only static ones are read; set it to 0"),
        ("ProblemType", "axisymmetric", "only axisymmetric problems are read; draw the half section of the device"),
        ("PrevSoln", r'"?"?', "the permeability of an earlier solution has no counterpart; remove it"),
    ):
        value, line = model.head.get(key.lower(), ("", 0))
        if line and not re.fullmatch(right, value.lower()):
            yield line, f"[{key}] = {value}: {reason}"
    for line in model.holes:
        yield line, "a hole in the mesh has no counterpart; give the region a label of air"
    for line in model.marked_points:
        yield line, "a point with a property (current or A) has no counterpart; draw a winding with a section"


def _label_reasons(model: FemmModel, powder: str | None) -> _Reasons:
    """What is wrong with the materials and circuits that are used."""
    for label in (label for label in model.labels if not _is_shell(label, model)):
        begin = f"the material {label.material.name!r}"
        yield from ((label.material.line, f"{begin} {reason}") for reason in _material_reasons(label))
    circuits = [label.circuit for label in model.labels if label.circuit and label.current]
    if not circuits:
        own = {one: [f"{label.turns:g} turns around {label.at()}" for label in model.labels if label.circuit is one]
               for one in model.circuits}  # fmt: skip
        known = "; ".join(f"{one.name!r} ({one['totalamps_re']:g} A, {', '.join(labels) or 'no label'})"
                          for one, labels in own.items())  # fmt: skip
        remedy = (f"its circuits are {known}: set the current, and assign the circuit to the winding's label"
                  if known else "define a circuit for the winding")  # fmt: skip
        yield model.circuits[0].line if known else 0, f"no winding carries a current; {remedy} in FEMM"
    for one in circuits:
        if one is not circuits[0]:
            yield one.line, f"the circuit {one.name!r} is a second winding, a scene has one; set its current to 0"
        if one["circuittype"] == 0.0:
            yield one.line, f"the circuit {one.name!r} is parallel, which has no counterpart; make it a series circuit"


def _powder_reasons(model: FemmModel, section: FemmSection, powder: str | None) -> _Reasons:
    """Why a region cannot be the space of the grains; asked for once every region has a label."""
    if powder is not None and not any(_is(label, powder) for label in model.labels):
        names = sorted({repr(label.material.name) for label in model.labels})
        yield 0, f"no region is of the material {powder!r} (--powder); there are {', '.join(names)}"
    others = " or ".join(map(repr, _powders(model, section)))
    remedy = f"take {others}" if others else "give the powder a material of its own in FEMM"
    for label in model.labels:
        if _is(label, powder) and (reason := _not_powder(label, section)):
            yield label.material.line, f"{label.material.name!r} (--powder) {reason}; {remedy}"


def _powders(model: FemmModel, section: FemmSection) -> list[str]:
    """Names of the materials that may be the powder's."""
    impossible = {label.material.name for label in model.labels if _not_powder(label, section)}
    return sorted({label.material.name for label in model.labels} - impossible)


def _not_powder(label: FemmLabel, section: FemmSection) -> str:
    """Why the region of a label is not that of a powder; empty where it may be."""
    from field import MU_0  # local: the schema itself needs no field

    one = label.material
    H, B = one.curve[one.curve[:, 1] > 0.0][:, ::-1].T if len(one.curve) else np.array([[1.0], [MU_0 * one["mu_x"]]])
    if label.circuit is not None or label.is_wound:
        return "is the material of a winding"
    if label.is_external or label in section.outline.values():
        return "is also the air at the end of the model"
    if (mu := float((B / (MU_0 * H)).max(initial=0.0))) > _SOLID_MU:
        return f"is solid: its relative permeability is up to {mu:.0f}, that of powders below {_SOLID_MU:g}"
    if one["sigma"] >= _SOLID_SIGMA:
        return f"is solid metal: its conductivity is {one['sigma']:g} MS/m"
    return ""


def _material_reasons(label: FemmLabel) -> Iterator[str]:
    from field import TableLaw  # local: the schema itself needs no field

    one = label.material
    if one["h_c"]:
        yield f"is a permanent magnet (H_c = {one['h_c']:g} A/m), which has no counterpart; take it out"
    if one["j_re"]:
        yield "has a current density (J_re); give the winding a circuit with current and turns instead"
    if one["lamfill"] != 1.0 and not label.is_wound and _is_magnetic(one):
        yield f"is laminated with LamFill = {one['lamfill']:g}; enter the curve of the stack, with LamFill = 1"
    if label.is_wound and _is_magnetic(one):
        yield "is the material of a winding and magnetic; set its permeability to 1"
    elif len(one.curve):
        try:
            TableLaw(one.curve[:, 1], one.curve[:, 0], one.name)
        except ValueError as error:
            yield f"has a wrong B-H curve: {error}"
    elif one["mu_x"] != one["mu_y"] or one["mu_x"] < 1.0:
        yield f"has mu_x = {one['mu_x']:g}, mu_y = {one['mu_y']:g}; allowed: the same, 1 or more"


def _outline_reasons(model: FemmModel, section: FemmSection, air: set[FemmLabel]) -> _Reasons:
    """Why the surroundings of the model cannot be replaced by open space."""
    kelvin = any(label.is_external for label in model.labels)
    faulty: dict[str, list[FemmEdge]] = {}
    for edge in section.inside:
        if edge.boundary:
            reason = f"{_boundary(model, edge)} within the model has no counterpart; remove it from the edge"
            faulty.setdefault(reason, []).append(edge)
    for edge, label in section.outline.items():
        if label not in air:
            yield label.line, f"{label.material.name!r} lies at the end of the model; draw air around the whole device"
        elif not label.is_external and (reason := _not_open(model, edge, kelvin)):
            faulty.setdefault(reason, []).append(edge)
    for reason, edges in faulty.items():
        more = f" and {len(edges) - 1} more" if len(edges) > 1 else ""
        yield edges[0].line, f"{edges[0].ends(model.points)}{more}: {reason}"


def _boundary(model: FemmModel, edge: FemmEdge) -> str:
    one = model.boundaries[edge.boundary - 1]
    return f"the boundary {one.name!r} ({_BOUNDARIES.get(int(one['bdrytype']), 'unknown')})"


def _not_open(model: FemmModel, edge: FemmEdge, kelvin: bool) -> str:
    """Why the boundary of an edge does not stand for open space; empty where it does."""
    one = model.boundaries[edge.boundary - 1] if edge.boundary else None
    if one is None or (one["bdrytype"] == _MIXED and not one["c0"] and not one["c1"]):
        return ("no boundary; where the air ends give A = 0 or an asymptotic condition; of a plane of symmetry draw "
                "the other half too")  # fmt: skip
    given = [key for key in ("a_0", "a_1", "a_2", "c1") if one[key]]
    if one["bdrytype"] in (0, _MIXED) and given:
        return f"{_boundary(model, edge)} has {given[0]} = {one[given[0]]:g}, a source outside; set it to 0"
    is_open = one["bdrytype"] in (0, _MIXED) or (one["bdrytype"] == _PERIODIC and kelvin)
    return "" if is_open else f"{_boundary(model, edge)} has no counterpart; draw the whole device"


def _winding_reasons(model: FemmModel, section: FemmSection) -> _Reasons:
    """Why the current is not spread evenly over the winding, as that of a scene is."""
    density = {label: label.turns / section.areas[label] for label in model.labels if label.current}
    first = next(iter(density.values()))
    for label, one in density.items():
        if abs(one - first) > _EQUAL * abs(first):
            other = "is wound against" if one * first < 0.0 else "has other turns per area than"
            yield label.line, f"{other} the rest of its circuit, and a scene has one winding"
        if not label.is_wound and label.material["sigma"]:
            yield label.line, (f"the winding is a solid conductor (1 turn) of {label.material.name!r}, whose "
                               "current is not even; set its conductivity to 0 where that does not matter")  # fmt: skip


def _material(one: FemmProperty, table: str) -> dict[str, Any]:
    linear = {"law": "linear", "relative_permeability": one["mu_x"]}
    law = {"law": "table", "table": table} if len(one.curve) else linear
    return law | ({"conductivity": 1e6 * one["sigma"]} if one["sigma"] and not one["d_lam"] else {})


def _curve(one: FemmProperty) -> str:
    rows = "\n".join(f"{H:.10g}, {B:.10g}" for B, H in one.curve)
    return f"# {one.name}, from a model of FEMM\nH [A/m], B [T]\n{rows}\n"
