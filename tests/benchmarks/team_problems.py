"""TEAM workshop problems 20 and 13: two measured magnets with saturated steel, in 3D.

**Problem 20** (Nakata, Takahashi and Morishige, COMPEL 14 (1995) 57; IEEE Trans. Magn. 30 (1994) 3483): a pole of
25 x 10 mm stands 1.5 mm above the floor of a yoke, inside a coil of 1000 turns; the force that pulls it down is
measured. **Problem 13** (Nakata and Fujiwara, COMPEL 11 (1992) 345): a steel plate between two channels of the
same thickness, 0.5 mm away, in a coil of 1000 or 3000 ampere-turns; the mean B across the steel is measured.

The problem sheets themselves were not at hand. Dimensions and measurements of problem 20 are those of the
validation cases of muFEM (github.com/Raiden-Numerics/mufem), whose forces agree with the measurement within a few
per cent; of problem 13 those of a student's work at TU Wien in NGSolve (V. Hanser, 2018), which places the mean
values of the sheet's table at x = 122.1 to 125.3 mm: channels 120 mm clear. (muFEM's model makes them 120 mm
outside.) The steels differ: problem 20 has `team_steel`, problem 13 its own table.

Run as a program for a table: ``python tests/benchmarks/team_problems.py 20 --size 1``, from the root.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

import numpy as np
from team_devices import Team13, Team20

from field.three_d.current_source import FlatCoil
from geometry.mesh_3d import Mesh3D
from geometry.mesher import MILLIMETRE, gmsh_model
from geometry.meshing_3d import (
    SOLID_OPTIONS,
    SizeFormula,
    box_distance,
    faces_of,
    faces_where,
    finish,
    generate,
    set_sizes,
)


def team20_mesh(size_factor: float = 1.0, order: int = 2, problem: Team20 | None = None) -> Mesh3D:
    """The quarter x, y > 0 between two mirror planes; regions air, coil, pole, yoke; boundaries by side."""
    it = problem or Team20()
    coil = it.coil
    low, high = coil.z_range
    pole_bottom, lid_bottom = it.floor + it.gap, it.yoke[2] - it.lid
    half = 0.5 * it.yoke[0]
    with gmsh_model(SOLID_OPTIONS) as gmsh:
        occ = gmsh.model.occ
        ball = occ.addSphere(0.0, 0.0, it.air_centre / MILLIMETRE, it.air_radius / MILLIMETRE, angle3=0.5 * math.pi)
        hole, window = 0.5 * it.hole, half - it.leg
        outline = [(0.0, 0.0), (half, 0.0), (half, it.yoke[2]), (hole, it.yoke[2]), (hole, lid_bottom),
                   (window, lid_bottom), (window, it.floor), (0.0, it.floor)]  # fmt: skip
        parts = {
            "yoke": _prism(occ, [(x, 0.0, z) for x, z in outline], (0.0, 0.5 * it.yoke[1], 0.0)),
            "pole": _box(occ, (0.0, 0.0, pole_bottom), (0.5 * it.pole[0], 0.5 * it.pole[1], lid_bottom)),
            "winding": _rounded_quarter(occ, coil, 0.0),
            "bore": _rounded_quarter(occ, coil, coil.width),
        }
        volumes = _fragment(occ, ball, parts, {"winding": "coil", "bore": "air"})
        occ.synchronize()
        corner = (0.5 * it.pole[0], 0.5 * it.pole[1])
        sizes: list[SizeFormula] = [
            (0.5e-3 * size_factor, box_distance((0.0, 0.0, it.floor), (*corner, pole_bottom + 0.3e-3))),
            (1.0e-3 * size_factor, box_distance((*corner, pole_bottom), (*corner, pole_bottom))),
            (1.2e-3 * size_factor, box_distance((corner[0], 0.0, lid_bottom), (0.5 * it.hole, corner[1], lid_bottom))),
            (3.0e-3 * size_factor, box_distance((0.0, 0.0, pole_bottom), (*corner, lid_bottom))),
            (6.0e-3 * size_factor, box_distance((0.0, 0.0, 0.0), (half, 0.5 * it.yoke[1], it.yoke[2]))),
            (6.0e-3 * size_factor, box_distance((0.0, 0.0, low), (coil.half_length_x, coil.half_length_y, high))),
        ]
        set_sizes(gmsh, sizes, size_factor * it.air_radius / 4.0)
        points, elements, regions = generate(gmsh, volumes, order)
    centre = np.array([0.0, 0.0, it.air_centre])
    faces, sides = faces_of(elements[:, :4])
    skin, close = faces[sides[:, 1] < 0], 1e-7
    boundaries = {
        "low_side": faces_where(points, skin, lambda p: np.abs(p[:, 1]) < close),
        "high_side": faces_where(points, skin, lambda p: np.abs(p[:, 0]) < close),
        "outer": faces_where(points, skin, lambda p: np.linalg.norm(p - centre, axis=1) > it.air_radius - close),
    }
    return finish(points, elements, regions, boundaries, sector_angle=0.5 * math.pi, n_sectors=4)


def team13_mesh(size_factor: float = 1.0, order: int = 2, problem: Team13 | None = None) -> Mesh3D:
    """The half z > 0; regions air, coil, plate, channels; boundaries `mirror` (z = 0, H tangential = 0), `outer`."""
    it = problem or Team13()
    coil = it.coil
    t, top, inner = it.thickness, 0.5 * it.height, 0.5 * it.thickness + it.gap
    wide = it.offset + it.width
    with gmsh_model(SOLID_OPTIONS) as gmsh:
        occ = gmsh.model.occ
        ball = occ.addSphere(0.0, 0.0, 0.0, it.air_radius / MILLIMETRE, angle1=0.0, angle2=0.5 * math.pi)
        outline = [(inner, top - t), (inner + it.clear, top - t), (inner + it.clear, 0.0), (inner + it.clear + t, 0.0),
                   (inner + it.clear + t, top), (inner, top)]  # fmt: skip
        channel = _prism(occ, [(x, it.offset, z) for x, z in outline], (0.0, it.width, 0.0))
        other = occ.copy([(3, channel)])
        occ.rotate(other, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, math.pi)
        parts = {
            "plate": _box(occ, (-0.5 * t, -0.5 * it.width, 0.0), (0.5 * t, 0.5 * it.width, top)),
            "channel": channel,
            "other": other[0][1],
            "winding": _rounded_rectangle(occ, coil, 0.0, 0.0, coil.z_range[1]),
            "bore": _rounded_rectangle(occ, coil, coil.width, 0.0, coil.z_range[1]),
        }
        names = {"channel": "channels", "other": "channels", "winding": "coil", "bore": "air"}
        volumes = _fragment(occ, ball, parts, names)
        occ.synchronize()
        overlap = 0.5 * it.width
        sizes: list[SizeFormula] = [
            (2.2e-3 * size_factor, box_distance((-0.5 * t, -overlap, 0.0), (0.5 * t, overlap, top))),
            (4.0e-3 * size_factor, box_distance((-100e-3, -100e-3, 0.0), (100e-3, 100e-3, 50e-3)) + "+10"),
        ]
        for sign in (1.0, -1.0):
            gap = sorted((sign * 0.5 * t, sign * inner)), sorted((sign * it.offset, sign * overlap))
            sizes.append((0.4e-3 * size_factor, _between(*gap, (top - t, top))))
            strip = sorted((sign * it.offset, sign * wide))
            x = sorted((sign * inner, sign * (inner + it.clear + t)))
            sizes.append((2.5e-3 * size_factor, _between(x, strip, (top - t, top))))
            side = sorted((sign * (inner + it.clear), sign * (inner + it.clear + t)))
            sizes.append((2.5e-3 * size_factor, _between(side, strip, (0.0, top))))
            # flux turns around the re-entrant corner of the channel's bend, where the field is singular in the steel
            inside = sign * (inner + it.clear)
            sizes.append((0.3e-3 * size_factor, _between((inside, inside), strip, (top - t, top - t))))
        set_sizes(gmsh, sizes, size_factor * it.air_radius / 5.0)
        points, elements, regions = generate(gmsh, volumes, order)
    faces, sides = faces_of(elements[:, :4])
    skin, close = faces[sides[:, 1] < 0], 1e-7
    boundaries = {
        "mirror": faces_where(points, skin, lambda p: np.abs(p[:, 2]) < close),
        "outer": faces_where(points, skin, lambda p: np.linalg.norm(p, axis=1) > it.air_radius - close),
    }
    return finish(points, elements, regions, boundaries, n_sectors=2)


def _between(x: Any, y: Any, z: Any) -> str:
    return box_distance((x[0], y[0], z[0]), (x[1], y[1], z[1]))


def _prism(occ: Any, corners: list[tuple[float, float, float]], along: tuple[float, float, float]) -> int:
    """A polygon [m] extruded along a vector [m]; the volume's tag."""
    points = [occ.addPoint(*(c / MILLIMETRE for c in corner)) for corner in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return _volume(occ.extrude([(2, face)], *(c / MILLIMETRE for c in along)))


def _box(occ: Any, low: tuple[float, float, float], high: tuple[float, float, float]) -> int:
    return int(
        occ.addBox(*(a / MILLIMETRE for a in low), *((b - a) / MILLIMETRE for a, b in zip(low, high, strict=True)))
    )


def _rounded_quarter(occ: Any, coil: FlatCoil, inwards: float) -> int:
    """The quarter x, y > 0 of the prism inside the coil's outline, moved inwards [m]."""
    a, b, r = (
        (length - inwards) / MILLIMETRE for length in (coil.half_length_x, coil.half_length_y, coil.corner_radius)
    )
    z0, z1 = (z / MILLIMETRE for z in coil.z_range)
    stops = [(0.0, 0.0), (a, 0.0), (a, b - r), (a - r, b), (0.0, b)]
    points = [occ.addPoint(x, y, z0) for x, y in stops]
    centre = occ.addPoint(a - r, b - r, z0)
    lines = [
        occ.addLine(points[0], points[1]),
        occ.addLine(points[1], points[2]),
        occ.addCircleArc(points[2], centre, points[3]),
        occ.addLine(points[3], points[4]),
        occ.addLine(points[4], points[0]),
    ]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return _volume(occ.extrude([(2, face)], 0.0, 0.0, z1 - z0))


def _rounded_rectangle(occ: Any, coil: FlatCoil, inwards: float, z0: float, z1: float) -> int:
    """The prism inside the coil's outline, moved inwards, between two heights [m]."""
    a, b, r = (
        (length - inwards) / MILLIMETRE for length in (coil.half_length_x, coil.half_length_y, coil.corner_radius)
    )
    face = occ.addRectangle(-a, -b, z0 / MILLIMETRE, 2.0 * a, 2.0 * b, roundedRadius=r)
    return _volume(occ.extrude([(2, face)], 0.0, 0.0, (z1 - z0) / MILLIMETRE))


def _volume(made: list[tuple[int, int]]) -> int:
    return next(tag for dim, tag in made if dim == 3)


def _fragment(occ: Any, air: int, parts: dict[str, int], names: dict[str, str]) -> dict[str, list[int]]:
    """Cut the parts out of the air and each other; volumes by region.

    Steel outranks the bore, the bore outranks the winding (it is what is left of the outline's prism).
    """
    _, pieces = occ.fragment([(3, air)], [(3, tag) for tag in parts.values()])
    rank = {"air": 0, "winding": 1, "bore": 2}
    owner: dict[int, str] = {}
    for name, piece in zip(("air", *parts), pieces, strict=True):
        for _, tag in piece:
            if rank.get(name, 3) >= rank.get(owner.get(tag, "air"), 3):
                owner[tag] = name
    volumes: dict[str, list[int]] = {}
    for tag, name in sorted(owner.items()):
        volumes.setdefault(names.get(name, name), []).append(tag)
    return dict(sorted(volumes.items()))


def main() -> None:
    """Print forces (20) or mean flux densities (13) beside the measurement."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("problem", type=int, choices=(13, 20))
    parser.add_argument("--size", type=float, default=1.0, help="scales every element")
    parser.add_argument("--solver", choices=("solid", "ngsolve"), default="solid")
    parser.add_argument("--drive", type=float, nargs="*", help="ampere-turns [A]; default: those measured")
    arguments = parser.parse_args()
    run = {20: _report_20, 13: _report_13}[arguments.problem]
    run(arguments.size, arguments.solver, arguments.drive)


def _meshed(build: Any, size: float) -> Mesh3D:
    started = time.perf_counter()
    mesh = build(size)
    duration = time.perf_counter() - started
    print(f"{len(mesh.tetrahedra)} tetrahedra, {len(mesh.points)} nodes, meshed in {duration:.1f} s")
    return mesh


def _report_20(size: float, solver: str, drives: list[float] | None) -> None:
    it, mesh = Team20(), _meshed(team20_mesh, size)
    measured = dict((*it.measured, *it.summary))
    probes = np.array([(1e-5, 1e-5, 25.75e-3), (12.5e-3, 5e-3, 25.75e-3)])
    for drive in drives or [at for at, _ in it.measured]:
        result = _solve(solver, mesh, it, drive, "pole", "low_side|high_side|outer", ())
        B = result["B"](probes)[:, 2]
        print(
            f"{drive:6.0f} A: force {result['force'][2]:8.3f} N (by virtual work {result['virtual'][2]:8.3f}; measured "
            f"{-measured.get(drive, math.nan):6.1f}), B_z {B[0]:.3f} and {B[1]:.3f} T, linkage "
            f"{result['linkage'] * 1e6:.3f} uWb a turn; {result['dofs']} dofs, {result['steps']} Newton steps, "
            f"{result['seconds']:.1f} s",
            flush=True,
        )


def _report_13(size: float, solver: str, drives: list[float] | None) -> None:
    it, mesh = Team13(), _meshed(team13_mesh, size)
    for drive in drives or [1000.0]:
        result = _solve(solver, mesh, it, drive, None, "outer", ("mirror",))
        print(f"{drive:g} A: {result['dofs']} dofs, {result['steps']} Newton steps, {result['seconds']:.1f} s")
        for what, table, section, axis in _sections_13(it):
            means = [abs(float(result["B"](section(at))[:, axis].mean())) for at, _ in table]
            print(f"  {what:6s}", " ".join(f"{mean:6.3f}" for mean in means))
            print("  meas. ", " ".join(f"{value:6.3f}" for _, value in table), flush=True)
        line = np.array([(x * MILLIMETRE, 20e-3, 55e-3) for x, _ in it.air_3000])
        print("  air mT", " ".join(f"{1e3 * b:6.2f}" for b in np.linalg.norm(result["B"](line), axis=1)))
        print("  3000 A", " ".join(f"{1e3 * b:6.2f}" for _, b in it.air_3000))


def _sections_13(it: Team13) -> list[tuple[str, Any, Any, int]]:
    """What is averaged: name, table, points (n, 3) [m] of the cross-section at a place [mm], component."""
    s, top, inner = _midpoints(6), 0.5 * it.height, 0.5 * it.thickness + it.gap
    edge = 2e-5  # the mean value at a face, evaluated just inside

    def grid(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = np.meshgrid(u, v)
        return a.ravel(), b.ravel()

    def plate(z: float) -> np.ndarray:
        x, y = grid(it.thickness * (s - 0.5), it.width * (_midpoints(20) - 0.5))
        return np.column_stack((x, y, np.full_like(x, z * MILLIMETRE + edge)))

    def channel_top(x: float) -> np.ndarray:
        y, z = grid(it.offset + it.width * _midpoints(20), top - it.thickness * s)
        return np.column_stack((np.full_like(y, x * MILLIMETRE + edge), y, z))

    def channel_side(z: float) -> np.ndarray:
        x, y = grid(inner + it.clear + it.thickness * s, it.offset + it.width * _midpoints(20))
        return np.column_stack((x, y, np.full_like(x, min(z * MILLIMETRE, 60e-3 - 2 * edge) + edge)))

    return [("plate", it.plate, plate, 2), ("top", it.top, channel_top, 0), ("side", it.side, channel_side, 2)]


def _midpoints(count: int) -> np.ndarray:
    return (np.arange(count) + 0.5) / count


def _solve(
    solver: str, mesh: Mesh3D, it: Any, drive: float, body: str | None, flux_walls: str, fixed: tuple[str, ...]
) -> dict[str, Any]:
    """One solve by our scalar potential or by NGSolve's edge elements, in the same terms."""
    started = time.perf_counter()
    if solver == "ngsolve":
        from ngsolve_solid import solve_3d

        found = solve_3d(mesh, it.laws, it.coil, drive, flux_walls=flux_walls, bodies=(body,) if body else ())
        force = found["forces"].get(body, np.full(3, math.nan))
        values = {"force": force, "virtual": force, "linkage": found["flux_linkage_per_turn"]}
        values |= {"dofs": found["dofs"], "steps": found["newton_steps"]}

        def B(points: np.ndarray) -> np.ndarray:
            return np.array([found["B"](found["ng_mesh"](*p)) for p in points])

    else:
        from field.three_d.scalar_potential import Problem3D

        problem = Problem3D(mesh, it.laws, it.coil, fixed=fixed)
        field = problem.solve(drive)
        nothing = np.full(3, math.nan)
        values = {"force": nothing, "virtual": nothing}
        if body is not None:
            on_body = field.body_force(body)
            values = {"force": on_body.force, "virtual": on_body.virtual_force}
        values |= {"linkage": field.flux_linkage_per_turn, "dofs": problem.n_dofs, "steps": len(field.newton) - 1}
        B = field.flux_density
    return values | {"seconds": time.perf_counter() - started, "B": B}


if __name__ == "__main__":
    main()
