"""Shows this run in ParaView 5.11 or later. Edit the choices below as you like: nothing overwrites them.

    paraview --script=paraview.py                        in ParaView's window
    pvbatch paraview.py --screenshot picture.png         without a window, the last moment (or --time '5 ms')
    pvbatch paraview.py --movie movie.avi                every moment; movie.png writes numbered pictures
    xvfb-run -a -s "-screen 0 1400x1000x24" pvbatch ...  the same on a machine without a screen

Each choice is an option of pvbatch as well: --colour moment --look device --show grains chains.
"""
# ruff: noqa: E402, I001
# mypy: ignore-errors

# --- Choices ---------------------------------------------------------------------------------------------------------
COLOUR = "speed"  # of the grains, one of QUANTITIES below
LOOK = "gap"  # at the grains before the field ("gap"), at their force chains ("chains"), or at the whole device, swept
# round its axis ("device")
SHOW = None  # None: what suits LOOK; or any of "grains", "chains", "walls", "section", "lines", "arrows", "device".
# In the window each can be switched with the eye next to its name.
FIELD_SHOWN = None  # "B" or "H": what the section and the device are coloured by; None: B, but a device that is swept
# from a section by its bodies
TIME = None  # [s] or, with its unit, "5 ms"; None: the last moment
CROP_AIR = True  # show the field in the device only, without the air around it

# --- What the run's files hold ---------------------------------------------------------------------------------------
RUN = "."  # where this script was written: for ParaView's window, which gives a script no path
TITLE = ""
SECTOR = None  # the grains fill a sector of so many degrees; None: the whole circle
AIR = None  # number of the air in the field's array `region`
FIELD = None  # "section" (r, z), "space", or None
BODIES = ()  # names that the numbers of the walls' array `body` stand for
REGIONS = ()  # names and colours that the numbers of the field's array `region` stand for
WHERE = "POINTS"  # B and H stand at the section's points; "CELLS": at its cells
# What grains can be coloured by: an array (vectors count by their magnitude) and a label with its unit.
QUANTITIES = {}

import argparse
import os
import re
import sys

import numpy

from emclutch.results.view.look import (
    AMBIENT, BARS, BESIDE, CHAIN_WIDTH, DIFFUSE, FIELDS, FIELD_COLOURS, FORCE, FORCE_COLOURS, FRAMES_A_SECOND,
    GRAIN_OPACITY, LINE_COLOUR, LOOKS, MARK, MAX_FIELD, SHADES, SIZE, SOLID_OPACITY, SWEEP, TIME_PLACE, TITLE_PLACE,
    WALL_OPACITY, camera, line_offset, near_box,
)  # fmt: skip

HERE = os.path.dirname(os.path.abspath(__file__)) if "__file__" in globals() else RUN
# This file has the name of ParaView's own package: its folder must not be searched for that.
sys.path[:] = [place for place in sys.path if os.path.realpath(place or ".") != os.path.realpath(HERE)]
if not os.path.exists(os.path.join(HERE, "case.toml")):  # a copy that `emclutch view` made elsewhere
    HERE = RUN

from paraview import servermanager
from paraview import simple as pv
from vtkmodules.util.numpy_support import vtk_to_numpy


def main():
    options = read_options()
    view = pv.GetActiveViewOrCreate("RenderView")
    view.ViewSize = options.size
    view.UseColorPaletteForBackground = 0
    view.Background = (1.0, 1.0, 1.0)
    view.OrientationAxesLabelColor = view.OrientationAxesOutlineColor = (0.0, 0.0, 0.0)
    pv._DisableFirstRenderCameraReset()
    series = {}
    for name in ("particles", "walls", "contacts", "field", "flux_lines"):
        file = os.path.join(HERE, name + ".pvd")
        if os.path.exists(file):
            series[name] = pv.PVDReader(registrationName=name, FileName=file)
    if not series:
        sys.exit(f"no particles.pvd or field.pvd in {HERE} yet")
    moments = show_time(series, options.time)
    shown = LOOKS[options.look] if options.show is None else options.show
    built = shown if options.screenshot or options.movie else PARTS  # the window has all of them, to be switched on
    for part, (name, build) in PARTS.items():
        if name in series and part in built:
            build(view, series[name], part in shown, options)
    caption(view, series, moments)
    aim(view, series, options)
    pv.Render(view)
    if options.screenshot:
        pv.SaveScreenshot(options.screenshot, view, ImageResolution=options.size)
    if options.movie:
        last = [0, len(moments) - 1]
        pv.SaveAnimation(options.movie, view, ImageResolution=options.size, FrameRate=FRAMES_A_SECOND, FrameWindow=last)


def read_options():
    """The choices above, replaced by what pvbatch was called with; paths count from where it was called."""
    parser = argparse.ArgumentParser(description=TITLE)
    parser.add_argument("--colour", choices=list(QUANTITIES), default=COLOUR)
    parser.add_argument("--look", choices=list(LOOKS), default=LOOK)
    parser.add_argument("--field", choices=list(FIELDS), default=FIELD_SHOWN)
    parser.add_argument("--show", nargs="*", choices=list(PARTS), default=SHOW)
    parser.add_argument("--time", type=seconds, default=TIME, help="in s, or with its unit: '5 ms'")
    parser.add_argument("--size", nargs=2, type=int, default=SIZE, help="pixels")
    parser.add_argument("--screenshot", type=os.path.abspath, metavar="FILE.png")
    parser.add_argument("--movie", type=os.path.abspath, metavar="FILE.avi")
    return parser.parse_known_args(sys.argv[1:])[0]


def seconds(text):
    """Time [s] of a number, which is in s, or of a number with its unit."""
    number, unit = re.fullmatch(r"\s*(.*?)\s*(s|ms|us|µs|)\s*", text).groups()
    return float(number) * {"": 1.0, "s": 1.0, "ms": 1e-3}.get(unit, 1e-6)


def show_time(series, time):
    """Go to the moment that was asked for, on one axis of time for all series; the moments."""
    scene = pv.GetAnimationScene()
    scene.UpdateAnimationUsingDataTimeSteps()
    times = series.get("particles", next(iter(series.values()))).TimestepValues
    moments = [times] if isinstance(times, float) else list(times)
    if time is not None and not moments[0] * (1.0 - 1e-9) <= time <= moments[-1] * (1.0 + 1e-9):
        sys.exit(f"--time {time:g}: the moments go from {moments[0]:g} to {moments[-1]:g} s")
    scene.AnimationTime = moments[-1] if time is None else min(moments, key=lambda t: abs(t - time))
    for reader in series.values():
        reader.UpdatePipeline(scene.AnimationTime)
    return moments


def updated(source):
    """Return a source after it was computed for the present moment."""
    source.UpdatePipeline(pv.GetAnimationScene().AnimationTime)
    return source


def coloured(display, view, part, array, label, palette, association="POINTS", limits=None):
    """Colour by an array (a vector: by its magnitude), with a bar from `limits` that says what and in which unit."""
    display.UseSeparateColorMap = 1
    pv.ColorBy(display, (association, array), separate=True)
    table = pv.GetColorTransferFunction(array, display, separate=True)
    if isinstance(palette, str):
        table.ApplyPreset(palette, True)
    else:
        table.RGBPoints = [number for k, colour in enumerate(palette) for number in (float(k), *colour)]
    display.RescaleTransferFunctionToDataRange(False, True)
    if limits is not None:
        table.RescaleTransferFunction(*limits)
    title, _, unit = label.partition(" [")
    bar = add_bar(display, view, table, part, title, "[" + unit)
    bar.AutomaticLabelFormat, bar.LabelFormat, bar.RangeLabelFormat = 0, "%.3g", "%.3g"


def named(display, view, part, array, title, colours):
    """Colour cells by a number that stands for a body, with a legend; names and `colours` by number."""
    pv.ColorBy(display, ("CELLS", array))
    table = pv.GetColorTransferFunction(array)
    table.InterpretValuesAsCategories = 1
    table.Annotations = [text for number, (name, _) in colours.items() for text in (str(number), name)]
    table.IndexedColors = [c for _, colour in colours.values() for c in colour]
    add_bar(display, view, table, part, title, "")


def add_bar(display, view, table, part, title, unit):
    """Draw the bar of a table of colours at its place; return it."""
    bar = pv.GetScalarBar(table, view)
    bar.Title, bar.ComponentTitle = title, unit
    bar.TitleColor = bar.LabelColor = (0.0, 0.0, 0.0)
    bar.WindowLocation, bar.Position = "Any Location", (0.88, BARS[part])
    bar.ScalarBarLength, bar.Orientation = 0.25, "Vertical"
    bar.DrawBackground, bar.BackgroundColor = 1, (1.0, 1.0, 1.0, 1.0)  # where the device reaches behind it
    bar.TitleFontSize, bar.LabelFontSize = 16, 14
    display.SetScalarBarVisibility(view, bool(display.Visibility))
    return bar


def plain(display, colour):
    display.ColorArrayName = ["POINTS", ""]  # ColorBy(display, None) fails where no array was shown yet
    display.AmbientColor = display.DiffuseColor = colour


def grains(view, particles, visible, options):
    """Spheres of the grains' size."""
    spheres = pv.Glyph(registrationName="grains", Input=particles, GlyphType="Sphere")
    spheres.GlyphType.ThetaResolution = spheres.GlyphType.PhiResolution = 16
    spheres.ScaleArray, spheres.ScaleFactor = ["POINTS", "diameter"], 1.0
    spheres.OrientationArray, spheres.GlyphMode = ["POINTS", "No orientation array"], "All Points"
    display = pv.Show(spheres, view)
    display.Opacity = GRAIN_OPACITY if options.look == "chains" else 1.0
    display.Visibility = visible
    coloured(display, view, "grains", *QUANTITIES[options.colour], "Viridis (matplotlib)")


def chains(view, contacts, visible, options):
    """Force chains: a tube a contact, its section in proportion to the force."""
    forces = contacts.CellData.GetArray("force")
    largest = forces.GetRange(-1)[1] if forces and contacts.GetDataInformation().GetNumberOfCells() else 0.0
    if largest <= 0.0:
        return
    radius = 0.5 * pv.FindSource("particles").PointData.GetArray("diameter").GetRange()[0]
    width = pv.Calculator(Input=pv.CellDatatoPointData(Input=contacts), ResultArrayName="tube_radius")
    width.Function = f"{CHAIN_WIDTH * radius}*sqrt(mag(force)/{largest})"
    tubes = pv.Tube(registrationName="chains", Input=width, Scalars=["POINTS", "tube_radius"])
    tubes.VaryRadius, tubes.NumberofSides = "By Absolute Scalar", 8
    display = pv.Show(tubes, view)
    display.Visibility = visible
    coloured(display, view, "chains", *FORCE, FORCE_COLOURS)


def walls(view, surfaces, visible, options):
    """The walls that grains touch, each body in two shades: the marks turn with its shaft."""
    shade = pv.Calculator(registrationName="walls", Input=surfaces, AttributeType="Cell Data", ResultArrayName="shade")
    shade.Function = "2*body+stripe"
    display = pv.Show(near_grains(shade, options), view)
    display.Opacity, display.Visibility = WALL_OPACITY, visible
    colours = {}
    for number, body in enumerate(BODIES):
        light = SHADES[number % len(SHADES)]
        colours[2 * number], colours[2 * number + 1] = (body, light), (body + ", mark", [MARK * c for c in light])
    free = "field" if options.look == "chains" else "chains"  # the bar that this look does not have
    named(display, view, free, "shade", "walls", colours)


def section(view, field, visible, options):
    """The field's section, at the first face of the grains' sector."""
    if FIELD == "section":
        display = pv.Show(near_grains(cropped(field), options), view)
        display.Visibility = visible
        display.Ambient, display.Diffuse = 1.0, 0.0  # the colours of the bar, whatever the light
        by_field(display, view, field, options)


def lines(view, curves, visible, options):
    """Flux lines of the section, equal flux between them."""
    display = pv.Show(near_grains(curves, options), view)
    display.Visibility = visible
    display.Position = (0.0, line_offset(curves.GetDataInformation().GetBounds()[1]), 0.0)
    display.LineWidth = 1.5  # thinner ones have gaps
    plain(display, LINE_COLOUR)


def arrows(view, field, visible, options):
    """Direction of B; of H: choose field_strength as the filter's Orientation Array."""
    where = cropped(field)
    bounds = updated(where).GetDataInformation().GetBounds()
    arrow = pv.Glyph(registrationName="arrows", Input=where, GlyphType="Arrow")
    arrow.OrientationArray, arrow.ScaleArray = [WHERE, "flux_density"], ["POINTS", "No scale array"]
    arrow.ScaleFactor = 0.03 * max(bounds[1] - bounds[0], bounds[5] - bounds[4])
    arrow.GlyphMode, arrow.MaximumNumberOfSamplePoints = "Uniform Spatial Distribution (Bounds Based)", 1500
    display = pv.Show(arrow, view)
    display.Visibility = visible
    plain(display, (0.1, 0.1, 0.1))


def device(view, field, visible, options):
    """The section swept round the axis; a field in 3D as it is, translucent: the grains are inside."""
    body = pv.ExtractSurface(registrationName="device", Input=cropped(field))
    if FIELD == "section":
        body = pv.RotationalExtrusion(registrationName="device", Input=body, Angle=-SWEEP, Resolution=90, Capping=1)
    display = pv.Show(body, view)
    display.Visibility = visible
    display.Ambient, display.Diffuse = AMBIENT, DIFFUSE
    display.Opacity = 1.0 if FIELD == "section" else SOLID_OPACITY
    if options.field is None and FIELD == "section":
        shown = {number: REGIONS[number] for number in range(len(REGIONS)) if number != AIR or not CROP_AIR}
        named(display, view, "field", "region", "bodies", shown)
    else:
        by_field(display, view, field, options)


def by_field(display, view, field, options):
    """Colour by a field, up to what all but the corners of iron have."""
    array, label = FIELDS[options.field or "B"]
    data = servermanager.Fetch(updated(cropped(field)))
    values = vtk_to_numpy((data.GetPointData() if WHERE == "POINTS" else data.GetCellData()).GetArray(array))
    top = float(numpy.percentile(numpy.linalg.norm(values, axis=1), MAX_FIELD))
    coloured(display, view, "field", array, label, FIELD_COLOURS, WHERE, (0.0, top or 1.0))


def cropped(field):
    """The field without the air."""
    if not CROP_AIR or AIR is None:
        return field
    if (found := pv.FindSource("section")) is None:
        found = pv.Threshold(registrationName="section", Input=field, Scalars=["CELLS", "region"], Invert=1)
        found.ThresholdMethod, found.LowerThreshold, found.UpperThreshold = "Between", AIR, AIR
    return found


def near_grains(source, options):
    """The part of a source around the grains, for a look at the gap: bars, title and time then stand beside it."""
    particles = pv.FindSource("particles")
    if options.look != "gap" or SECTOR is None or particles is None:
        return source
    box = near_box(updated(particles).GetDataInformation().GetBounds())
    clip = pv.Clip(Input=source, ClipType="Box", Invert=1, Exact=1)
    clip.ClipType.Position = box[::2]
    clip.ClipType.Length = [high - low for low, high in zip(box[::2], box[1::2], strict=True)]
    return clip


def caption(view, series, moments):
    """Add title and time annotations."""
    texts = [(pv.Text(registrationName="title", Text=TITLE), TITLE_PLACE)]
    if "particles" in series or len(moments) > 1:  # a field that was solved alone has no time
        first, form = next(iter(series.values())), "t = {time:.3f} ms"
        time = pv.AnnotateTimeFilter(registrationName="time", Input=first, Format=form, Scale=1e3)
        texts.append((time, TIME_PLACE))
    for text, place in texts:
        display = pv.Show(text, view)
        display.WindowLocation, display.Position = "Any Location", place
        display.Color, display.FontSize = (0.0, 0.0, 0.0), 18


def aim(view, series, options):
    """Turn the camera to the device or the grains."""
    if options.look == "device" and "field" in series:
        bounds = list(updated(cropped(series["field"])).GetDataInformation().GetBounds())
        if FIELD == "section":
            bounds[0] = bounds[2] = -bounds[1]
    else:
        names = [name for name in ("particles", "walls") if name in series] or [next(iter(series))]
        boxes = [series[name].GetDataInformation().GetBounds() for name in names]
        bounds = [(min, max)[k % 2](box[k] for box in boxes) for k in range(6)]
    aspect = options.size[0] / options.size[1]
    focus, position, up, half = camera(options.look, SECTOR is not None, bounds, aspect, right=BESIDE)
    view.CameraFocalPoint, view.CameraPosition, view.CameraViewUp = focus, position, up
    view.CameraParallelProjection, view.CameraParallelScale = 1, half


PARTS = {  # what can be shown: the series that it is made of, and who draws it
    "grains": ("particles", grains),
    "chains": ("contacts", chains),
    "walls": ("walls", walls),
    "section": ("field", section),
    "lines": ("flux_lines", lines),
    "arrows": ("field", arrows),
    "device": ("field", device),
}

main()
