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
AsHtml = Annotated[
    bool,
    flag("--html", help="one HTML page with its pictures inside; default: report.html in the folder of the result"),
]
RunPaths = Annotated[
    list[Path], typer.Argument(metavar="RUN...", help="folders of runs, of studies, or of field --transient")
]
SpeedsAsked = Annotated[bool, flag("--speeds", help="speeds of motor and output against time")]
TorqueSpeedAsked = Annotated[bool, flag("--torque-speed", help="torque on the output against the speed of the motor")]
ExportFormat = Annotated[str, typer.Option("--to", metavar="FORMAT", help="csv, parquet, mat, netcdf or vtk")]
TorqueCurrentAsked = Annotated[bool, flag("--torque-current", help="torque against the coil current")]
Rated = Annotated[
    str | None,
    typer.Option(
        "--rated", metavar="CURRENT", help="with --torque-current: divide each curve by its point at this current"
    ),
]
Measured = Annotated[
    Path | None,
    typer.Option(
        "--with",
        metavar="FILE",
        help="CSV with named columns to lay over --speeds (time [s], speeds [rpm]) or --torque-current (current [A], "
        "torques [N m]; with --rated both divided by the rated values)",
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
    bool, flag("--grain-size", help="torque against the grains per gap, extrapolated to the real powder")
]
Look = Annotated[
    str | None,
    typer.Option("--look", metavar="WHAT", help="gap (grains in front of the field), chains (force chains) or device"),
]
ColourBy = Annotated[
    str | None,
    typer.Option(
        "--colour",
        metavar="WHAT",
        help="colour grains by speed, spin, force, magnetic-force, moment, shear-stress, contacts or diameter",
    ),
]
FieldShown = Annotated[str | None, typer.Option("--field", metavar="WHAT", help="field to show in colours: B or H")]
FullRing = Annotated[bool, flag("--ring", help="show the sector repeated to a full ring")]
Moment = Annotated[str | None, typer.Option("--time", metavar="T", help="time to show: '5 ms'; default: the last")]
Screenshot = Annotated[Path | None, typer.Option("--screenshot", metavar="FILE", help="new picture (.png), no window")]
Movie = Annotated[
    Path | None,
    typer.Option("--movie", metavar="FILE", help="new movie of all times (.gif, .mp4), no window"),
]
ParaViewAsked = Annotated[bool, flag("--paraview", help="start ParaView; scripts in the folder are not executed")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="new folder for the results")]
Currents = Annotated[
    str | None,
    typer.Option(
        "--current",
        metavar="I",
        help="a current '0.5 A', a list '0 A, 1 A', or ranges '0.2 A:1 A' (16 values), '0.2 A:1 A:5'; default: largest",
    ),
]
TorqueOfRun = Annotated[Path | None, typer.Option("--run", metavar="RUN", help="folder of a run whose torque is used")]
SlipPower = Annotated[
    str | None,
    typer.Option("--slip-power", metavar="P", help="slip power in place of a torque (sets effects.heat.slip_power)"),
]
SlipSpeeds = Annotated[
    str | None,
    typer.Option(
        "--speed", metavar="N", help="slip speeds at which the permitted slip power is computed: '100 rpm, 1000 rpm'"
    ),
]
Lines = Annotated[
    list[str] | None,
    typer.Option("--line", metavar="R0,Z0,R1,Z1", help="write B and H along a line: '44 mm, 0 mm, 46 mm, 0 mm'"),
]
TransientAsked = Annotated[
    bool, flag("--transient", help="switch coil.voltage on and compute current, gap field and heat against time")
]
TransientEnd = Annotated[
    str | None,
    typer.Option(
        "--end",
        metavar="T",
        help="with --transient: last time, '50 ms'; default: time.end, else when all values are within 1 % of "
        "their last ones",
    ),
]
StepTolerance = Annotated[
    float | None,
    typer.Option(
        "--tolerance",
        callback=_within(1e-6, 0.1),
        help="with --transient: relative error of a time step; default: 1e-3",
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
Resume = Annotated[bool, flag("--resume", help="continue from the last checkpoint; without one, start again")]
Threads = Annotated[int | None, typer.Option("--threads", help="number of threads; results do not depend on it")]
Force = Annotated[bool, flag("--force", help="run even if more memory or disk space is needed than is free")]
Jobs = Annotated[
    int,
    typer.Option("--jobs", callback=_within(1), help="number of points that run at a time, each in its own process"),
]
PointAsked = Annotated[
    int | None,
    typer.Option(
        "--point", metavar="K", help="run only point K (from 0) of the study in --out, for a task of a job array"
    ),
]
DaskAddress = Annotated[
    str | None,
    typer.Option(
        "--dask", metavar="ADDRESS",
        help="run points or cells on the workers of this dask scheduler (tcp://node1:8786), one thread each by default",
    ),
]  # fmt: skip
ListAsked = Annotated[
    bool,
    flag("--list", help="run nothing; print a command for each point that is not done in --out, for job arrays"),
]
CollectAsked = Annotated[
    bool,
    flag(
        "--collect",
        help="run nothing; write tables and pictures of the finished points in --out; exit code 3 if points are "
        "missing",
    ),
]
JobsOfCores = Annotated[
    int | None,
    typer.Option(
        "--jobs",
        callback=_within(1),
        help="number of replicas that run at a time, each in its own process; default: number of cores",
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
        help=f"accuracies (half the 95 % interval of the torque) for which to find settings; default: "
        f"'{USUAL_TARGETS}'",
    ),
]
ResumeAccuracy = Annotated[
    bool, flag("--resume", help="continue the study in the folder of --out; a larger --budget adds to what is finished")
]
OfEffects = Annotated[
    bool, flag("--effects", help="measure what each effect adds to torque and cost, not the errors of the settings")
]
DryRun = Annotated[bool, flag("--dry-run", help="print the plan and stop; write nothing")]
DryRunOfStudy = Annotated[bool, flag("--dry-run", help="list the points and stop; write nothing")]
TrustScripts = Annotated[
    bool,
    flag("--trust-scripts", help="run a script (.geo) that the scene names as its geometry; it may run any command"),
]
AsMarkdown = Annotated[bool, flag("--markdown", help="write the reference page of all keys instead")]
MaterialNames = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[NAME]...",
        help="names of materials, or files (.csv) of a B-H curve or a major loop; default: all materials",
    ),
]
CurvePicture = Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="new picture of B(H) and mu_r(B)")]
CurvePlaces = Annotated[
    str | None,
    typer.Option("--at", metavar="H|B", help="values of H or B at which the curves are read: '2 kA/m, 25 Oe, 1.5 T'"),
]
PairForceAsked = Annotated[
    bool, flag("--pair-force", help="force between two grains against their gap, for a powder such as carbonyl_iron")
]
DryRunOfAccuracy = Annotated[
    bool,
    flag("--dry-run", help="print what is known without a study, the settings and the cost; run and write nothing"),
]
Details = Annotated[bool, flag("--details", help="print also grains, time step, mesh and the omitted effects")]
AsJson = Annotated[bool, flag("--json", help="print JSON and nothing else")]
CellFills = Annotated[
    str | None, typer.Option("--fill", metavar="PHI", help="solid fractions of the cells: '0.32, 0.45'")
]
CellFields = Annotated[
    str | None,
    typer.Option(
        "--field",
        metavar="H",
        help="mean field strengths H of the cells: '18 kA/m, 80 kA/m', or 'first : last : number'",
    ),
]
CellWalls = Annotated[
    str,
    typer.Option(
        "--walls",
        metavar="KIND",
        help="steel: cells between steel faces, which give a law; none: cells without faces, which give a table",
    ),
]
BudgetOfCells = Annotated[
    str | None, typer.Option("--budget", metavar="TIME", help="wall-clock time of the cells; default: 10min")
]
CellsAtATime = Annotated[
    int | None,
    typer.Option(
        "--jobs",
        callback=_within(1),
        help="number of cells that run at a time, each in its own process; default: number of cores",
    ),
]
ResumeLaw = Annotated[bool, flag("--resume", help="continue in the folder of --out; finished cells are kept")]
Repose = Annotated[
    str | None,
    typer.Option("--repose", metavar="ANGLE", help="angle of repose of the powder without a field: '34 deg'"),
]
InternalFriction = Annotated[
    float | None,
    typer.Option(
        "--internal-friction",
        help="shear stress divided by pressure, from a shear tester in steady flow, in place of the angle",
    ),
]
PairFriction = Annotated[
    float | None, typer.Option("--friction", help="with --rolling-friction: print the angle of repose of this pair")
]
PairRolling = Annotated[float | None, typer.Option("--rolling-friction", help="see --friction")]
USUAL_UNCERTAINTY = "1 deg"
AngleUncertainty = Annotated[
    str | None,
    typer.Option(
        "--uncertainty",
        metavar="ANGLE",
        help=f"uncertainty of the angle; heaps repeat within 1 or 2 degrees; default: {USUAL_UNCERTAINTY}",
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
        help="coil current: a range '0.1 A:1.5 A', a range with a count '0.1 A:1.5 A:8', or a list '0.5 A, 1 A'. "
        "All axes below take the same forms; the first one given is the x axis",
    ),
]
MapVoltages = Annotated[str | None, typer.Option("--voltage", metavar="RANGE", help="coil voltage: '6 V:24 V'")]
MapGaps = Annotated[str | None, typer.Option("--gap", metavar="RANGE", help="width of the powder gap: '0.5 mm, 1 mm'")]
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
    typer.Option("--temperature", metavar="RANGE", help="temperature of grains, steel and winding: '20 degC:200 degC'"),
]
MapVary = Annotated[
    list[str] | None,
    typer.Option(
        "--vary", metavar="KEY=RANGE", help="any key with a continuous value: geometry.clearance='0.1 mm:0.5 mm'"
    ),
]
Target = Annotated[str | None, typer.Option("--target", metavar="AIM", help="target: 'torque 12 N m'")]
Like = Annotated[
    Path | None,
    typer.Option(
        "--like", metavar="RUN", help="finished run of a similar scene, whose torque corrects the expected torques"
    ),
]
Runs = Annotated[
    int,
    typer.Option(
        "--runs",
        metavar="N",
        callback=_within(0),
        help="run the scene that was found and correct the search by its torque, at most N times, until a "
        "torque meets the "
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
        help=f"with --runs: accepted difference of the torque of a run from the target; default: {USUAL_WITHIN}",
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
Over = Annotated[str, typer.Option("--over", metavar="KEY", help="key of the first column of the curve")]
FrictionRange = Annotated[
    str, typer.Option("--friction", metavar="RANGE", help="sliding friction: range to fit, '0.2:0.7', or a value")
]
RollingRange = Annotated[
    str, typer.Option("--rolling-friction", metavar="RANGE", help="rolling friction: range to fit, or a value")
]
FillRange = Annotated[
    str | None,
    typer.Option(
        "--fill",
        metavar="RANGE",
        help="solid fraction: range to fit, '0.3:0.45'; default: that of the scene, not fitted",
    ),
]
CommonError = Annotated[
    str | None,
    typer.Option(
        "--common-error",
        metavar="SHARE",
        help="standard error of the calibration, common to all measured torques: '3 %'; default: none",
    ),
]
SceneKind = Annotated[
    str | None,
    typer.Option(
        "--kind",
        help="clutch, disc, disk or brake (all the same: powder at the faces of a disc), drum (powder at the rim; the "
        "default), cad, centrifugal, shear_cell, sheared_box, box, or field",
    ),
]
FemmFile = Annotated[
    Path | None,
    typer.Option("--from", metavar="FILE", help="axisymmetric model of FEMM 4 (.fem) from which the scene is made"),
]
PowderMaterial = Annotated[
    str | None,
    typer.Option("--powder", metavar="NAME", help="with --from: material of the regions that the grains fill"),
]
NewScene = Annotated[Path | None, typer.Argument(metavar="[FILE]", help="new scene file (.toml)")]
Drawing = Annotated[
    Path | None,
    typer.Option(
        "--drawing", metavar="FILE", help="new picture (.png) of the dimensions of FILE, or without FILE of the kind"
    ),
]
