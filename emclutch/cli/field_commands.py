"""The commands of the field, of what magnetises in it and of heat: field, heat, mesh, materials, powder."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import typer

from emclutch.cli import options as opt
from emclutch.cli.errors import explained
from emclutch.cli.input import load, read_line, refuse_beside
from emclutch.cli.output import show
from emclutch.scene.errors import Fault, SceneError, bad_input_for
from emclutch.scene.slip_checks import INERTIAL_NUMBER
from emclutch.scene.value_list import RANGE_POINTS, read_all, read_list


def field(
    case: opt.CaseFile,
    current: opt.Currents = None,
    line: opt.Lines = None,
    transient: opt.TransientAsked = False,
    end: opt.TransientEnd = None,
    tolerance: opt.StepTolerance = None,
    out: opt.Out = None,
    sets: opt.Sets = None,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Solve the magnetic field without grains: flux density, inductance, energy and forces, at currents or in time."""
    with explained():
        if transient:
            refuse_beside("--transient", {"--current": current is not None, "--line": bool(line)})
        elif end is not None or tolerance is not None:
            option, entry = ("--end", end) if end is not None else ("--tolerance", f"{tolerance:g}")
            message = "needs --transient; add it, or remove this option"
            raise SceneError([Fault(option, str(entry), message)], "command line")
        # scales the slip of a run of the grains, and conflicts with eddy currents and circuit
        others = [one for one in sets or () if one.partition("=")[0].strip() != INERTIAL_NUMBER]
        read = load(case, [*others, f"{INERTIAL_NUMBER}=none"], trust_scripts)
        from emclutch.results import Progress
        from emclutch.scene.units import Quantity
        from emclutch.studies.field_result import field as solve_field

        if transient:
            from emclutch.studies.field_transient import TOLERANCE, field_transient

            duration = Quantity("a time", "s", "50 ms", 0.0, 1e5, open_minimum=True)
            ends = [None] if end is None else read_all([end], duration, "--end")
            tolerance = TOLERANCE if tolerance is None else tolerance
            with nullcontext() if as_json else Progress() as progress:
                course = field_transient(read, ends[0], tolerance, out, progress)
            show(course.report(), as_json)
            return

        amperes = Quantity("a current", "A", "0.5 A")
        currents = None if current is None else read_list(current, amperes, "--current", RANGE_POINTS)
        lines = [read_line(text) for text in line or ()]
        found = solve_field(read, currents, lines, out)
        show(found.report(), as_json)


def heat(
    case: opt.CaseFile,
    run: opt.TorqueOfRun = None,
    slip_power: opt.SlipPower = None,
    speed: opt.SlipSpeeds = None,
    out: opt.Out = None,
    sets: opt.Sets = None,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Compute temperatures over hours of duty, and the permitted slip power."""
    with explained():
        given = [] if slip_power is None else [f"effects.heat.slip_power={slip_power}"]
        read = load(case, [*(sets or ()), *given], trust_scripts)
        from emclutch.results import Progress
        from emclutch.scene.units import Quantity
        from emclutch.studies import heat as study

        slip = Quantity("an angular speed", "rad/s", "100 rpm", 0.0, 1e5, open_minimum=True, angular=True)
        speeds = study.SPEEDS if speed is None else read_list(speed, slip, "--speed")
        with nullcontext() if as_json else Progress() as progress:
            found = study.heat(read, run, speeds, out, progress)
        show(found.report(), as_json)


def mesh(
    case: opt.CaseFile, out: opt.Out = None, sets: opt.Sets = None, trust_scripts: opt.TrustScripts = False
) -> None:
    """Write the mesh of the cross-section (.msh) and a picture of it with the names of the regions."""
    with explained():
        read = load(case, sets, trust_scripts)
        from emclutch.studies.mesh import mesh as mesh_scene

        made = mesh_scene(read, out=out)
        typer.echo(f"{made.file}\n{made.picture}\n{len(made.mesh.triangles)} triangles")


def materials(
    names: opt.MaterialNames = None,
    at: opt.CurvePlaces = None,
    picture: opt.CurvePicture = None,
    pair_force: opt.PairForceAsked = False,
    out: opt.NewPicture = None,
    as_json: opt.AsJson = False,
) -> None:
    """List the built-in magnetic materials, or print and draw the curves of some."""
    with explained():
        if pair_force:
            refuse_beside("--pair-force", {"--at": at is not None})
            _tell_pair_force(names or [], picture, out, as_json)
            return
        if out is not None:
            message = "names the picture of --pair-force; that of the curves is named with --plot"
            raise SceneError([Fault("--out", str(out), message)], "command line")
        from emclutch.cli import materials as materials_command

        if picture is not None:
            refuse_beside("--plot", {"--json": as_json})
            with bad_input_for(picture):
                laws = materials_command.laws_of(names or materials_command.material_names())
                typer.echo(str(materials_command.draw_materials(laws, picture)))
        if picture is None or at is not None:
            show(materials_command.materials_report(names, at), as_json)


def powder(
    repose: opt.Repose = None,
    internal_friction: opt.InternalFriction = None,
    friction: opt.PairFriction = None,
    rolling_friction: opt.PairRolling = None,
    uncertainty: opt.AngleUncertainty = None,
    out: opt.NewPicture = None,
    as_json: opt.AsJson = False,
) -> None:
    """Convert an angle of repose into friction and rolling friction, or these into the angle."""
    with explained():
        from emclutch.cli import powder as command

        if (friction is None) != (rolling_friction is None):
            given, missing = ("--friction", "--rolling-friction")[:: -1 if friction is None else 1]
            message = f"gives an angle of repose together with {missing} only; add that, or remove this"
            raise SceneError([Fault(given, f"{rolling_friction if friction is None else friction:g}", message)],
                             "command line")  # fmt: skip
        if friction is not None and rolling_friction is not None:
            others = {"--repose": repose, "--internal-friction": internal_friction, "--uncertainty": uncertainty,
                      "--out": out}  # fmt: skip
            refuse_beside("--friction", {name: one is not None for name, one in others.items()})
            found = command.bulk_of(friction, rolling_friction)
            show(command.bulk_report(found), as_json)
            return
        line = command.line_of(repose, internal_friction, uncertainty or opt.USUAL_UNCERTAINTY)
        if out is not None:
            command.draw(line, out)
        show(command.line_report(line, out), as_json)


def _tell_pair_force(names: list[str], picture: Path | None, out: Path | None, as_json: bool) -> None:
    if len(names) != 1 or picture is not None or as_json:
        message = "takes the name of one powder and --out FILE, and neither --plot nor --json"
        raise SceneError([Fault("--pair-force", "", message)], "command line")
    from emclutch.cli.pair_force import pair_force

    show(pair_force(names[0], out))
