"""The options of the command line, each once."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from emclutch.cli.errors import explained
from emclutch.scene.errors import Fault, SceneError


def _option(name: str, metavar: str | None, text: str, **more: Any) -> Any:
    return typer.Option(name, metavar=metavar, help=text, **more)


def _argument(metavar: str, text: str) -> Any:
    return typer.Argument(metavar=metavar, help=text)


def flag(name: str, text: str, **more: Any) -> Any:
    """Return an option without a value; the help names no type for it."""
    return _option(name, "", text, **more)


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


RunSource = Annotated[Path, _argument("CASE", "scene file (.toml); with --resume the folder of a run")]
CaseFile = Annotated[Path, _argument("CASE", "scene file (.toml)")]
CheckedFile = Annotated[Path, _argument("CASE|STUDY", "file of a scene or of a study (.toml)")]
StudyFile = Annotated[Path, _argument("STUDY", "study file (.toml)")]
RunPath = Annotated[Path, _argument("RUN", "folder of a run")]
ResultPath = Annotated[Path, _argument("RUN|STUDY", "folder of a run, or of a study")]
AsHtml = Annotated[
    bool, flag("--html", "one HTML page with its pictures inside; default: report.html in the folder of the result")
]
RunPaths = Annotated[list[Path], _argument("RUN...", "folders of runs, of studies, or of field --transient")]
SpeedsAsked = Annotated[bool, flag("--speeds", "speeds of motor and output against time")]
TorqueSpeedAsked = Annotated[bool, flag("--torque-speed", "torque on the output against the speed of the motor")]
ExportFormat = Annotated[str, _option("--to", "FORMAT", "csv, parquet, mat, netcdf or vtk")]
TorqueCurrentAsked = Annotated[bool, flag("--torque-current", "torque against the coil current")]
Rated = Annotated[
    str | None, _option("--rated", "CURRENT", "with --torque-current: divide each curve by its point at this current")
]
Measured = Annotated[
    Path | None,
    _option("--with", "FILE",
        "CSV with curves to compare. With --speeds: columns time [s], speed [rpm]. With --torque-current: current "
        "[A], torque [N m], with --rated both divided by the rated values"),
]  # fmt: skip
Catalogue = Annotated[
    Path | None,
    _option("--with", "FILE",
        "CSV with measured or catalogue points to compare: columns current [A], torque [N m] and, if known, "
        "error [N m] or [%] (one standard error). Units such as mA, N cm and lbf in are converted"),
]  # fmt: skip
GrainSizeAsked = Annotated[
    bool, flag("--grain-size", "torque against the grains per gap, extrapolated to the real powder")
]
Look = Annotated[
    str | None, _option("--look", "WHAT", "gap (grains in front of the field), chains (force chains) or device")
]
ColourBy = Annotated[
    str | None,
    _option("--colour", "WHAT",
        "colour grains by speed, spin, force, magnetic-force, moment, shear-stress, contacts or diameter"),
]  # fmt: skip
FieldShown = Annotated[str | None, _option("--field", "WHAT", "field to show in colours: B or H")]
FullRing = Annotated[bool, flag("--ring", "show the sector repeated to a full ring")]
Moment = Annotated[str | None, _option("--time", "T", "time to show: '5 ms'; default: the last")]
Screenshot = Annotated[Path | None, _option("--screenshot", "FILE", "new picture (.png), no window")]
Movie = Annotated[Path | None, _option("--movie", "FILE", "new movie of all times (.gif, .mp4), no window")]
ParaViewAsked = Annotated[bool, flag("--paraview", "start ParaView; scripts in the folder are not executed")]
Out = Annotated[Path | None, _option("--out", "DIR", "new folder for the results")]
Currents = Annotated[
    str | None,
    _option("--current", "I",
        "a current '0.5 A', a list '0 A, 1 A', or ranges '0.2 A:1 A' (16 values), '0.2 A:1 A:5'; default: largest"),
]  # fmt: skip
TorqueOfRun = Annotated[Path | None, _option("--run", "RUN", "folder of a run whose torque is used")]
SlipPower = Annotated[
    str | None, _option("--slip-power", "P", "slip power in place of a torque (sets effects.heat.slip_power)")
]
SlipSpeeds = Annotated[
    str | None,
    _option("--speed", "N", "slip speeds at which the permitted slip power is computed: '100 rpm, 1000 rpm'"),
]
Lines = Annotated[
    list[str] | None, _option("--line", "R0,Z0,R1,Z1", "write B and H along a line: '44 mm, 0 mm, 46 mm, 0 mm'")
]
TransientAsked = Annotated[
    bool, flag("--transient", "switch coil.voltage on and compute current, gap field and heat against time")
]
TransientEnd = Annotated[
    str | None,
    _option("--end", "T",
        "with --transient: last time, '50 ms'; default: time.end, or when all values are within 1 % of the final ones"),
]  # fmt: skip
StepTolerance = Annotated[
    float | None,
    _option("--tolerance", None,
        "with --transient: relative error of a time step; default: 1e-3",
        callback=_within(1e-6, 0.1)),
]  # fmt: skip
NewFile = Annotated[Path | None, _option("--out", "FILE", "new file; default: the terminal")]
NewPicture = Annotated[Path | None, _option("--out", "FILE", "new picture (.png)")]
Sets = Annotated[
    list[str] | None,
    _option("--set", "KEY=VALUE",
        "change a key: coil.current='0.8 A'. KEY=none removes it. effects.NAME=off or on removes or adds an effect"),
]  # fmt: skip
Resume = Annotated[bool, flag("--resume", "continue from the last checkpoint, or start again without one")]
Threads = Annotated[int | None, _option("--threads", None, "number of threads (the results are the same)")]
Force = Annotated[bool, flag("--force", "run even if it needs more memory or disk space than is free")]
Jobs = Annotated[
    int, _option("--jobs", None, "number of points that run at a time, each in its own process", callback=_within(1))
]
PointAsked = Annotated[
    int | None, _option("--point", "K", "run only point K (from 0) of the study in --out, for a task of a job array")
]
DaskAddress = Annotated[
    str | None,
    _option("--dask", "ADDRESS",
        "run points or cells on the workers of this dask scheduler (tcp://node1:8786), one thread each by default"),
]  # fmt: skip
ListAsked = Annotated[bool, flag("--list", "only print a command for each missing point of --out, for job arrays")]
CollectAsked = Annotated[
    bool,
    flag("--collect",
        "only write tables and pictures of the finished points in --out. Exit code 3 if points are missing"),
]  # fmt: skip
JobsOfCores = Annotated[
    int | None,
    _option("--jobs", None,
        "number of replicas that run at a time, each in its own process; default: number of cores",
        callback=_within(1)),
]  # fmt: skip
Budget = Annotated[str | None, _option("--budget", "TIME", "wall-clock time of the study; default: 20min")]
USUAL_TARGETS = "10 %, 5 %, 3 %"
Targets = Annotated[
    str | None,
    _option("--for", "LIST",
        f"wanted accuracies (half the 95 % interval of the torque); default: '{USUAL_TARGETS}'"),
]  # fmt: skip
ResumeAccuracy = Annotated[
    bool, flag("--resume", "continue the study in the folder of --out. A larger --budget extends it")
]
OfEffects = Annotated[bool, flag("--effects", "measure instead what each effect adds to torque and cost")]
DryRun = Annotated[bool, flag("--dry-run", "only print the plan")]
DryRunOfStudy = Annotated[bool, flag("--dry-run", "only list the points")]
TrustScripts = Annotated[
    bool, flag("--trust-scripts", "run a script (.geo) that is the geometry of the scene. It may run any command")
]
AsMarkdown = Annotated[bool, flag("--markdown", "write the reference page of all keys instead")]
MaterialNames = Annotated[
    list[str] | None,
    _argument("[NAME]...",
        "names of materials, or files (.csv) with a B-H curve or a major loop; default: list all materials"),
]  # fmt: skip
CurvePicture = Annotated[Path | None, _option("--plot", "FILE", "new picture of B(H) and mu_r(B)")]
CurvePlaces = Annotated[
    str | None, _option("--at", "H|B", "values of H or B at which the curves are read: '2 kA/m, 25 Oe, 1.5 T'")
]
PairForceAsked = Annotated[
    bool, flag("--pair-force", "force between two grains against their gap, for a powder such as carbonyl_iron")
]
DryRunOfAccuracy = Annotated[
    bool, flag("--dry-run", "only print what is known now, the settings and the cost of the study")
]
Details = Annotated[bool, flag("--details", "also print grains, time step, mesh and omitted effects")]
AsJson = Annotated[bool, flag("--json", "print JSON only")]
CellFills = Annotated[str | None, _option("--fill", "PHI", "solid fractions of the cells: '0.32, 0.45'")]
CellFields = Annotated[
    str | None,
    _option("--field", "H", "mean field strengths H of the cells: '18 kA/m, 80 kA/m', or 'first : last : number'"),
]
CellWalls = Annotated[
    str,
    _option("--walls", "KIND",
        "steel: cells between steel faces, for a law. none: cells without faces, for a table"),
]  # fmt: skip
BudgetOfCells = Annotated[str | None, _option("--budget", "TIME", "wall-clock time of the cells; default: 10min")]
CellsAtATime = Annotated[
    int | None,
    _option("--jobs", None,
        "number of cells that run at a time, each in its own process; default: number of cores",
        callback=_within(1)),
]  # fmt: skip
ResumeLaw = Annotated[bool, flag("--resume", "continue in the folder of --out and keep its finished cells")]
Repose = Annotated[str | None, _option("--repose", "ANGLE", "angle of repose of the powder without a field: '34 deg'")]
InternalFriction = Annotated[
    float | None,
    _option("--internal-friction", None,
        "shear stress divided by pressure, from a shear tester in steady flow, in place of the angle"),
]  # fmt: skip
PairFriction = Annotated[
    float | None, _option("--friction", None, "with --rolling-friction: print the angle of repose of this pair")
]
PairRolling = Annotated[float | None, _option("--rolling-friction", None, "see --friction")]
USUAL_UNCERTAINTY = "1 deg"
AngleUncertainty = Annotated[
    str | None,
    _option("--uncertainty", "ANGLE",
        f"uncertainty of the angle (heaps repeat within 1 or 2 degrees); default: {USUAL_UNCERTAINTY}"),
]  # fmt: skip
DesignSource = Annotated[Path, _argument("FILE", "design file ([design]), or a scene with --vary and --target")]
Vary = Annotated[str | None, _option("--vary", "KEY=A:B", "key and range to search: geometry.gap='0.5 mm:2 mm'")]
MapCurrents = Annotated[
    str | None,
    _option("--current", "RANGE",
        "coil current: a range '0.1 A:1.5 A', a range with a count '0.1 A:1.5 A:8', or a list '0.5 A, 1 A'. The "
        "options below take the same forms. The first one is the x axis"),
]  # fmt: skip
MapVoltages = Annotated[str | None, _option("--voltage", "RANGE", "coil voltage: '6 V:24 V'")]
MapGaps = Annotated[str | None, _option("--gap", "RANGE", "width of the powder gap: '0.5 mm, 1 mm'")]
MapSpeeds = Annotated[str | None, _option("--speed", "RANGE", "speed of the rotor: '100 rpm:3000 rpm'")]
MapFills = Annotated[str | None, _option("--fill", "RANGE", "solid fraction, in place of mass or count: '0.2:0.45'")]
MapRepose = Annotated[
    str | None, _option("--repose", "RANGE", "angle of repose, in place of both frictions: '25 deg:38 deg'")
]
MapTemperatures = Annotated[
    str | None, _option("--temperature", "RANGE", "temperature of grains, steel and winding: '20 degC:200 degC'")
]
MapVary = Annotated[
    list[str] | None,
    _option("--vary", "KEY=RANGE", "any key with a continuous value: geometry.clearance='0.1 mm:0.5 mm'"),
]
Target = Annotated[str | None, _option("--target", "AIM", "target: 'torque 12 N m'")]
Like = Annotated[
    Path | None, _option("--like", "RUN", "finished run of a similar scene, whose torque corrects the expected torques")
]
Runs = Annotated[
    int,
    _option("--runs", "N",
        "run the scene that was found and correct the search by its torque, at most N times; default: 0",
        callback=_within(0), show_default=False),
]  # fmt: skip
USUAL_WITHIN = "5 %"
Within = Annotated[
    str | None,
    _option("--within", "SHARE",
        f"with --runs: accepted difference between torque and target; default: {USUAL_WITHIN}"),
]  # fmt: skip
MeasuredCurve = Annotated[
    Path,
    _option("--to", "FILE",
        "measured curve (.csv): current [A], torque [N m] and, if known, error [N m] (one standard error)"),
]  # fmt: skip
Over = Annotated[str, _option("--over", "KEY", "key of the first column of the curve")]
FrictionRange = Annotated[str, _option("--friction", "RANGE", "sliding friction: range to fit, '0.2:0.7', or a value")]
RollingRange = Annotated[str, _option("--rolling-friction", "RANGE", "rolling friction: range to fit, or a value")]
FillRange = Annotated[
    str | None,
    _option("--fill", "RANGE", "solid fraction: range to fit, '0.3:0.45'; default: not fitted"),
]
CommonError = Annotated[
    str | None,
    _option("--common-error", "SHARE",
        "standard error of the calibration, common to all measured torques: '3 %'; default: none"),
]  # fmt: skip
SceneKind = Annotated[
    str | None,
    _option("--kind", None,
        "drum (powder at the rim, the default), clutch (powder at the faces of a disc; also disc, disk or brake), "
        "cad, centrifugal, shear_cell, sheared_box, box, or field"),
]  # fmt: skip
FemmFile = Annotated[
    Path | None, _option("--from", "FILE", "axisymmetric model of FEMM 4 (.fem) from which the scene is made")
]
PowderMaterial = Annotated[
    str | None, _option("--powder", "NAME", "with --from: material of the regions that the grains fill")
]
NewScene = Annotated[Path | None, _argument("[FILE]", "new scene file (.toml)")]
Drawing = Annotated[
    Path | None,
    _option("--drawing", "FILE", "new picture (.png) of the dimensions of FILE, or of the kind without FILE"),
]
