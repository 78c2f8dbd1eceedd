"""The options of the command line, each once."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from emclutch.cli.errors import explained
from emclutch.scene.errors import Fault, SceneError

flag = partial(typer.Option, metavar="")
"""An option without a value; the help names no type for it."""


def _within(low: float, high: float | None = None) -> Callable[[typer.CallbackParam, float | None], float | None]:
    """Return the check that a number is in its range, with an error as of a scene's keys."""
    allowed = f"at least {low:g}" if high is None else f"{low:g} to {high:g}"

    def check(parameter: typer.CallbackParam, given: float | None) -> float | None:
        with explained():
            if given is not None and not low <= given <= (math.inf if high is None else high):
                message = f"is out of range; allowed: {allowed}"
                raise SceneError([Fault(parameter.opts[-1], f"{given:g}", message)], "command line")
        return given

    return check


RunSource = Annotated[
    Path, typer.Argument(metavar="CASE", help="scene file (.toml); with --resume the folder of a run")
]
CaseFile = Annotated[Path, typer.Argument(metavar="CASE", help="scene file (.toml)")]
CheckedFile = Annotated[Path, typer.Argument(metavar="CASE|STUDY", help="file of a scene or of a study (.toml)")]
StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="study file (.toml)")]
RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run")]
ResultPath = Annotated[Path, typer.Argument(metavar="RUN|STUDY", help="folder of a run, or of a study")]
AsHtml = Annotated[bool, flag("--html", help="one page with its pictures inside; default: report.html there")]
RunPaths = Annotated[list[Path], typer.Argument(metavar="RUN...", help="folders of runs, or of studies")]
SpeedsAsked = Annotated[bool, flag("--speeds", help="speeds of motor and output against time")]
TorqueSpeedAsked = Annotated[bool, flag("--torque-speed", help="torque on the output over the motor's speed")]
ExportFormat = Annotated[str, typer.Option("--to", metavar="FORMAT", help="csv, parquet, mat, netcdf or vtk")]
TorqueCurrentAsked = Annotated[bool, flag("--torque-current", help="torque over the coil's current")]
Rated = Annotated[
    str | None,
    typer.Option("--rated", metavar="CURRENT", help="--torque-current over a curve's own point at this current"),
]
Measured = Annotated[
    Path | None,
    typer.Option(
        "--with",
        metavar="FILE",
        help="CSV with named columns to lay over --speeds (time [s], speeds [rpm]) or --torque-current (current [A], "
        "torques [N m]; with --rated both over the rated ones)",
    ),
]
Catalogue = Annotated[
    Path | None,
    typer.Option(
        "--with",
        metavar="FILE",
        help="measured or catalogue points beside torque against current: CSV with columns current [A], torque [N m] "
        "and, where known, error [N m] (standard error, one sigma, drawn times 1.96) or error [%]; separators ; , tab; "
        "units as mA, N cm, lbf in",
    ),
]
GrainSizeAsked = Annotated[
    bool, flag("--grain-size", help="torque over the grains per gap, extrapolated to the real powder")
]
Look = Annotated[
    str | None,
    typer.Option("--look", metavar="WHAT", help="gap (grains before the field), chains (of force), device"),
]
ColourBy = Annotated[
    str | None,
    typer.Option(
        "--colour", metavar="WHAT", help="grains: speed, spin, force, magnetic-force, moment, shear-stress, contacts"
    ),
]
FieldShown = Annotated[str | None, typer.Option("--field", metavar="WHAT", help="of the field: B (default) or H")]
FullRing = Annotated[bool, flag("--ring", help="repeat the grains' sector to a full ring")]
Moment = Annotated[str | None, typer.Option("--time", metavar="T", help="moment: '5 ms'; default: the last")]
Screenshot = Annotated[Path | None, typer.Option("--screenshot", metavar="FILE", help="new picture (.png), no window")]
Movie = Annotated[
    Path | None,
    typer.Option("--movie", metavar="FILE", help="new movie of all moments (.gif, .mp4), no window"),
]
ParaViewAsked = Annotated[
    bool, flag("--paraview", help="start ParaView with a script of its own; none in the folder is executed")
]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="new folder for the results")]
Currents = Annotated[
    str | None,
    typer.Option(
        "--current",
        metavar="I",
        help="'0.5 A', a list '0 A, 1 A', with ranges first : last : how many in it; default: the largest",
    ),
]
TorqueOfRun = Annotated[
    Path | None, typer.Option("--run", metavar="RUN", help="folder of a run, whose torque is taken")
]
SlipPower = Annotated[
    str | None,
    typer.Option("--slip-power", metavar="P", help="given slip power instead of a torque: effects.heat.slip_power"),
]
SlipSpeeds = Annotated[
    str | None,
    typer.Option("--speed", metavar="N", help="slip speeds of the permitted power: '100 rpm, 1000 rpm'"),
]
Lines = Annotated[
    list[str] | None,
    typer.Option("--line", metavar="R0,Z0,R1,Z1", help="write B and H along a line: '44 mm, 0 mm, 46 mm, 0 mm'"),
]
TransientAsked = Annotated[
    bool, flag("--transient", help="the coil alone in time after coil.voltage is switched: current, gap field, heat")
]
TransientEnd = Annotated[
    str | None,
    typer.Option(
        "--end", metavar="T", help="of --transient: '50 ms'; default: time.end, else when all is within 1 % of its end"
    ),
]
StepTolerance = Annotated[
    float | None,
    typer.Option(
        "--tolerance", callback=_within(1e-6, 0.1), help="of --transient: local error of a time step; default: 1e-3"
    ),
]
NewFile = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="new file; default: the terminal")]
NewPicture = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="new picture (.png)")]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="set a key: coil.current='0.8 A'; KEY=none removes it; effects.NAME=off or on removes or adds an effect",
    ),
]
Resume = Annotated[
    bool, flag("--resume", help="continue from the last checkpoint; a run killed before the first starts again")
]
Threads = Annotated[int | None, typer.Option("--threads", help="threads; results do not depend on them")]
Force = Annotated[bool, flag("--force", help="run also where more memory or disk is needed than is free")]
Jobs = Annotated[
    int, typer.Option("--jobs", callback=_within(1), help="points that run at a time, each in a process of its own")
]
PointAsked = Annotated[
    int | None,
    typer.Option(
        "--point", metavar="K", help="run only point K of the study in --out, from 0, as a task of a job array"
    ),
]
DaskAddress = Annotated[
    str | None,
    typer.Option(
        "--dask", metavar="ADDRESS",
        help="run points or cells on the workers of this dask scheduler (tcp://node1:8786), by default on a thread",
    ),
]  # fmt: skip
ListAsked = Annotated[
    bool,
    flag("--list", help="run nothing: print the command of each point that is not done in --out, for job arrays"),
]
CollectAsked = Annotated[
    bool,
    flag("--collect", help="run nothing: tables and pictures of the points in --out; exit code 3: some missing"),
]
JobsOfCores = Annotated[
    int | None,
    typer.Option(
        "--jobs", callback=_within(1), help="replicas at a time, each in a process of its own; default: the cores"
    ),
]
Budget = Annotated[
    str | None, typer.Option("--budget", metavar="TIME", help="wall-clock time of the study; default: 20min")
]
USUAL_TARGETS = "10 %, 5 %, 3 %"
Targets = Annotated[
    str | None,
    typer.Option(
        "--for",
        metavar="LIST",
        help=f"accuracies to find settings for: half the torque's 95 % interval; in quotes; default: '{USUAL_TARGETS}'",
    ),
]
ResumeAccuracy = Annotated[bool, flag("--resume", help="continue the study in the folder of --out")]
OfEffects = Annotated[
    bool, flag("--effects", help="what each effect adds to torque and cost, in place of the settings' errors")
]
DryRun = Annotated[bool, flag("--dry-run", help="stop after the plan; nothing is written")]
DryRunOfStudy = Annotated[bool, flag("--dry-run", help="list the points and stop; nothing is written")]
TrustScripts = Annotated[
    bool,
    flag("--trust-scripts", help="run a script (.geo) that the scene names as its geometry; it may run any command"),
]
AsMarkdown = Annotated[bool, flag("--markdown", help="a page of all keys for people to read")]
MaterialNames = Annotated[
    list[str] | None,
    typer.Argument(metavar="[NAME]...", help="materials, or files of a curve or a major loop (.csv); default: all"),
]
CurvePicture = Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="new picture of B(H) and mu_r(B)")]
PairForceAsked = Annotated[
    bool, flag("--pair-force", help="force between two grains of a powder against their gap (carbonyl_iron)")
]
DryRunOfAccuracy = Annotated[
    bool, flag("--dry-run", help="print what is known, settings and cost; run and write nothing")
]
Details = Annotated[bool, flag("--details", help="print all that follows: grains, steps, mesh, what is left out")]
AsJson = Annotated[bool, flag("--json", help="print JSON and nothing else")]
CellFills = Annotated[
    str | None, typer.Option("--fill", metavar="PHI", help="solid fractions of the cells: '0.32, 0.45'")
]
CellFields = Annotated[
    str | None,
    typer.Option("--field", metavar="H", help="macroscopic fields: '18 kA/m, 80 kA/m', or first : last : how many"),
]
CellWalls = Annotated[
    str, typer.Option("--walls", metavar="KIND", help="steel: faces, for a law; none: cells without faces, for a table")
]
BudgetOfCells = Annotated[
    str | None, typer.Option("--budget", metavar="TIME", help="wall-clock time of the cells; default: 10min")
]
CellsAtATime = Annotated[
    int | None,
    typer.Option(
        "--jobs", callback=_within(1), help="cells at a time, each in a process of its own; default: the cores"
    ),
]
ResumeLaw = Annotated[bool, flag("--resume", help="continue in the folder of --out: cells that are done are kept")]
Repose = Annotated[
    str | None,
    typer.Option("--repose", metavar="ANGLE", help="angle of repose of the powder without a field: '34 deg'"),
]
InternalFriction = Annotated[
    float | None,
    typer.Option("--internal-friction", help="tau/P of a shear tester in steady flow, in place of the angle"),
]
PairFriction = Annotated[
    float | None, typer.Option("--friction", help="with --rolling-friction: the angle that this pair gives")
]
PairRolling = Annotated[float | None, typer.Option("--rolling-friction", help="see --friction")]
USUAL_UNCERTAINTY = "1 deg"
AngleUncertainty = Annotated[
    str | None,
    typer.Option(
        "--uncertainty",
        metavar="ANGLE",
        help=f"of the angle; heaps repeat to a degree or two; default: {USUAL_UNCERTAINTY}",
    ),
]
DipoleModel = Annotated[str, typer.Option("--model", help="moments of the grains: near_field or mutual")]
DesignSource = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="design file ([design]), or a scene with --vary and --target"),
]
Vary = Annotated[
    str | None, typer.Option("--vary", metavar="KEY=A:B", help="key and range to search: geometry.gap='0.5 mm:2 mm'")
]
MapCurrents = Annotated[
    str | None,
    typer.Option(
        "--current",
        metavar="RANGE",
        help="coil current: range '0.1 A:1.5 A', with a count '0.1 A:1.5 A:8', or list '0.5 A, 1 A'; so has each axis, "
        "and the first of them is x",
    ),
]
MapVoltages = Annotated[str | None, typer.Option("--voltage", metavar="RANGE", help="coil voltage: '6 V:24 V'")]
MapGaps = Annotated[
    str | None, typer.Option("--gap", metavar="RANGE", help="width of the gap that is sheared: '0.5 mm, 1 mm'")
]
MapSpeeds = Annotated[
    str | None, typer.Option("--speed", metavar="RANGE", help="speed of the rotor: '100 rpm:3000 rpm'")
]
MapFills = Annotated[
    str | None, typer.Option("--fill", metavar="RANGE", help="solid fraction, in place of mass or count: '0.2:0.45'")
]
MapRepose = Annotated[
    str | None,
    typer.Option("--repose", metavar="RANGE", help="angle of repose, in place of both frictions: '25 deg:38 deg'"),
]
MapTemperatures = Annotated[
    str | None,
    typer.Option("--temperature", metavar="RANGE", help="of grains, steel and winding: '20 degC:200 degC'"),
]
MapVary = Annotated[
    list[str] | None,
    typer.Option("--vary", metavar="KEY=RANGE", help="any continuous quantity: geometry.clearance='0.1 mm:0.5 mm'"),
]
Target = Annotated[str | None, typer.Option("--target", metavar="AIM", help="target: 'torque 12 N m'")]
Like = Annotated[
    Path | None, typer.Option("--like", metavar="RUN", help="finished run, whose torque corrects the expected ones")
]
Runs = Annotated[
    int,
    typer.Option(
        "--runs",
        metavar="N",
        callback=_within(0),
        help="run the scene found and repeat the search with the result, at most N times, until a torque meets the "
        "target; default: 0",
        show_default=False,
    ),
]
USUAL_WITHIN = "5 %"
Within = Annotated[
    str | None,
    typer.Option(
        "--within",
        metavar="SHARE",
        help=f"with --runs: accepted difference of a run's torque from it; default: {USUAL_WITHIN}",
    ),
]
MeasuredCurve = Annotated[
    Path,
    typer.Option(
        "--to",
        metavar="FILE",
        help="measured curve (.csv): current [A], torque [N m] and, where known, error [N m] (standard error, 1 sigma)",
    ),
]
Over = Annotated[str, typer.Option("--over", metavar="KEY", help="dotted key of the curve's first column")]
FrictionRange = Annotated[
    str, typer.Option("--friction", metavar="RANGE", help="sliding friction: range that is fitted, '0.2:0.7', or value")
]
RollingRange = Annotated[
    str, typer.Option("--rolling-friction", metavar="RANGE", help="rolling friction: range that is fitted, or value")
]
FillRange = Annotated[
    str | None,
    typer.Option("--fill", metavar="RANGE", help="solid fraction, fitted too: '0.3:0.45'; default: the scene's"),
]
CommonError = Annotated[
    str | None,
    typer.Option(
        "--common-error",
        metavar="SHARE",
        help="standard error that all measured torques share, as of a calibration: '3 %'; default: none",
    ),
]
SceneKind = Annotated[
    str | None,
    typer.Option(
        "--kind",
        help="clutch, also as disc, disk or brake (powder at the faces of a disc), drum (powder at the rim; the "
        "default), cad, centrifugal, shear_cell, sheared_box, box, or field",
    ),
]
FemmFile = Annotated[
    Path | None, typer.Option("--from", metavar="FILE", help="axisymmetric model of FEMM 4 (.fem) to make it from")
]
PowderMaterial = Annotated[
    str | None,
    typer.Option("--powder", metavar="NAME", help="with --from: material of the regions that the grains fill"),
]
NewScene = Annotated[Path | None, typer.Argument(metavar="[FILE]", help="new scene file (.toml)")]
Drawing = Annotated[
    Path | None,
    typer.Option("--drawing", metavar="FILE", help="new picture (.png) of the kind's dimensions with their keys"),
]
