"""Shows this run in ParaView 5.11 or later. Edit the choices below as you like: nothing overwrites them.

    paraview --script=paraview.py                        in ParaView's window
    pvbatch paraview.py --screenshot picture.png         without a window, the last moment (--time in seconds)
    pvbatch paraview.py --movie movie.avi                every moment; movie.png writes numbered pictures
    xvfb-run -a -s "-screen 0 1400x1000x24" pvbatch ...  the same on a machine without a screen

Each choice is an option of pvbatch as well: --colour moment --look device --show grains chains.
"""
# ruff: noqa: E402
# mypy: ignore-errors

# --- Choices ---------------------------------------------------------------------------------------------------------
COLOUR = "speed"  # of the grains, one of QUANTITIES below
LOOK = "gap"  # at the grains before the field ("gap"), at their force chains ("chains"), or at the whole device, swept
# round its axis ("device")
SHOW = None  # None: what suits LOOK; or any of "grains", "chains", "walls", "section", "lines", "arrows", "device".
# In the window each can be switched with the eye beside its name.
TIME = None  # [s]; None: the last moment
CROP_AIR = True  # show the field in the device only, without the air around it
SWEEP = 180.0  # how far the device is swept round its axis [degrees]
GRAIN_OPACITY = 0.15  # beside force chains, which lie inside the grains
WALL_OPACITY = 0.3
CHAIN_WIDTH = 0.6  # radius of the tube of the largest force, in radii of a grain
PICTURE = (1400, 1000)  # pixels
BESIDE = 0.07  # of the picture's width, by which what is shown moves away from the bars

# --- What the run's files hold ---------------------------------------------------------------------------------------
RUN = "."  # where this script was written: for ParaView's window, which does not tell a script its place
TITLE = ""
SECTOR = None  # the grains fill a sector of so many degrees; None: the whole circle
AIR = None  # number of the air in the field's array `region`
FIELD = None  # "section" (r, z), "space", or None
BODIES = ()  # names that the numbers of the walls' array `body` stand for
WHERE = "POINTS"  # B and H stand at the section's points; "CELLS": at its cells
# What grains can be coloured by: an array (vectors count by their magnitude) and a label with its unit.
QUANTITIES = {}
# Light where there is little, so that what lies before it is seen; steel without flux grey, to be seen before white.
FORCE_COLOURS = ((0.9, 0.86, 0.8), (0.99, 0.83, 0.62), (0.99, 0.55, 0.35), (0.84, 0.19, 0.12), (0.5, 0.0, 0.0))
FIELD_COLOURS = ((0.74, 0.75, 0.76), (0.6, 0.71, 0.84), (0.46, 0.5, 0.79), (0.53, 0.25, 0.62), (0.3, 0.0, 0.29))
FLUX_DENSITY = ("flux_density", "flux density B [T]", FIELD_COLOURS, (0.88, 0.06))

import argparse
import math
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__)) if "__file__" in globals() else RUN
if not os.path.exists(os.path.join(HERE, "case.toml")):  # a copy that `emclutch view` made elsewhere
    HERE = RUN
# This file has the name of ParaView's own package: its folder must not be searched for that.
sys.path[:] = [place for place in sys.path if os.path.realpath(place or ".") != os.path.realpath(HERE)]

from paraview import simple as pv

SHADES = ((0.85, 0.55, 0.25), (0.25, 0.5, 0.8), (0.45, 0.65, 0.4), (0.6, 0.6, 0.6))  # of the bodies, in turn


def main():
    options = read_options()
    view = pv.GetActiveViewOrCreate("RenderView")
    view.ViewSize = options.size
    view.UseColorPaletteForBackground = 0
    view.Background = (1.0, 1.0, 1.0)
    view.OrientationAxesLabelColor = view.OrientationAxesOutlineColor = (0.0, 0.0, 0.0)
    pv._DisableFirstRenderCameraReset()
    series = {}
    for name in ("particles", "walls", "contacts", "field"):
        file = os.path.join(HERE, name + ".pvd")
        if os.path.exists(file):
            series[name] = pv.PVDReader(registrationName=name, FileName=file)
    if not series:
        sys.exit(f"no particles.pvd or field.pvd in {HERE} yet")
    moments = show_time(series, options.time)
    shown = SUITS[options.look] if options.show is None else options.show
    built = shown if options.screenshot or options.movie else PARTS  # the window has all of them, to be switched on
    for part, (name, build) in PARTS.items():
        if name in series and part in built:
            build(view, series[name], part in shown, options)
    caption(view, series)
    aim(view, series, options)
    pv.Render(view)
    if options.screenshot:
        pv.SaveScreenshot(options.screenshot, view, ImageResolution=options.size)
    if options.movie:
        last = [0, len(moments) - 1]
        pv.SaveAnimation(options.movie, view, ImageResolution=options.size, FrameRate=10, FrameWindow=last)


def read_options():
    """The choices above, replaced by what pvbatch was called with; paths count from where it was called."""
    parser = argparse.ArgumentParser(description=TITLE)
    parser.add_argument("--colour", choices=list(QUANTITIES), default=COLOUR)
    parser.add_argument("--look", choices=list(SUITS), default=LOOK)
    parser.add_argument("--show", nargs="*", choices=list(PARTS), default=SHOW)
    parser.add_argument("--time", type=float, default=TIME, help="[s]")
    parser.add_argument("--size", nargs=2, type=int, default=PICTURE, help="pixels")
    parser.add_argument("--screenshot", type=os.path.abspath, metavar="FILE.png")
    parser.add_argument("--movie", type=os.path.abspath, metavar="FILE.avi")
    return parser.parse_known_args(sys.argv[1:])[0]


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
    """The same, after it was computed for the present moment."""
    source.UpdatePipeline(pv.GetAnimationScene().AnimationTime)
    return source


def coloured(display, view, array, label, palette, place, association="POINTS"):
    """Colour by an array (a vector: by its magnitude), with a bar that says what and in which unit."""
    display.UseSeparateColorMap = 1
    pv.ColorBy(display, (association, array), separate=True)
    table = pv.GetColorTransferFunction(array, display, separate=True)
    if isinstance(palette, str):
        table.ApplyPreset(palette, True)
    else:
        table.RGBPoints = [number for k, colour in enumerate(palette) for number in (float(k), *colour)]
    display.RescaleTransferFunctionToDataRange(False, True)
    bar = pv.GetScalarBar(table, view)
    bar.Title, _, unit = label.partition(" [")
    bar.ComponentTitle = "[" + unit
    bar.TitleColor = bar.LabelColor = (0.0, 0.0, 0.0)
    bar.WindowLocation, bar.Position = "Any Location", place
    bar.ScalarBarLength, bar.Orientation = 0.25, "Vertical"
    bar.DrawBackground, bar.BackgroundColor = 1, (1.0, 1.0, 1.0, 1.0)  # where the device reaches behind it
    bar.TitleFontSize, bar.LabelFontSize = 16, 14
    bar.AutomaticLabelFormat, bar.LabelFormat, bar.RangeLabelFormat = 0, "%.3g", "%.3g"
    display.SetScalarBarVisibility(view, bool(display.Visibility))


def plain(display, colour):
    pv.ColorBy(display, None)
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
    coloured(display, view, *QUANTITIES[options.colour], "Viridis (matplotlib)", (0.88, 0.68))


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
    coloured(display, view, "force", "contact force [N]", FORCE_COLOURS, (0.88, 0.37))


def walls(view, surfaces, visible, options):
    """The walls that grains touch, each body in two shades: the marks turn with its shaft."""
    shade = pv.Calculator(registrationName="walls", Input=surfaces, AttributeType="Cell Data", ResultArrayName="shade")
    shade.Function = "2*body+stripe" if surfaces.CellData.GetArray("stripe") else "2*body"
    display = pv.Show(shade, view)
    display.Opacity, display.Visibility = WALL_OPACITY, visible
    pv.ColorBy(display, ("CELLS", "shade"))
    names, colours = [], []
    for number, body in enumerate(BODIES):
        light = SHADES[number % len(SHADES)]
        names += [str(2 * number), body, str(2 * number + 1), body + ", mark"]
        colours += [*light, *(0.5 * c for c in light)]
    table = pv.GetColorTransferFunction("shade")
    table.InterpretValuesAsCategories = 1
    table.Annotations, table.IndexedColors = names, colours
    display.SetScalarBarVisibility(view, False)


def section(view, field, visible, options):
    """The field's section, at the first face of the grains' sector."""
    if FIELD == "section":
        display = pv.Show(cropped(field), view)
        display.Visibility = visible
        display.Ambient, display.Diffuse = 1.0, 0.0  # the colours of the bar, whatever the light
        coloured(display, view, *FLUX_DENSITY, WHERE)


def lines(view, field, visible, options):
    """Flux lines of the section, equal flux between them."""
    if FIELD != "section":
        return
    flux = pv.Calculator(Input=cropped(field), ResultArrayName="flux")
    flux.Function = f"{2.0 * math.pi}*coordsX*vector_potential"
    low, high = updated(flux).PointData.GetArray("flux").GetRange()
    if high > low:
        contour = pv.Contour(registrationName="lines", Input=flux, ContourBy=["POINTS", "flux"])
        contour.Isosurfaces = [low + (high - low) * (k + 0.5) / 24 for k in range(24)]
        display = pv.Show(contour, view)
        display.Visibility = visible
        display.Position = (0.0, 2e-4 * field.GetDataInformation().GetBounds()[1], 0.0)  # before the section, not in it
        plain(display, (0.25, 0.25, 0.25))


def arrows(view, field, visible, options):
    """Direction of B; of H: choose field_strength as the filter's Orientation Array."""
    where = cropped(field)
    box = updated(where).GetDataInformation().GetBounds()
    arrow = pv.Glyph(registrationName="arrows", Input=where, GlyphType="Arrow")
    arrow.OrientationArray, arrow.ScaleArray = [WHERE, "flux_density"], ["POINTS", "No scale array"]
    arrow.ScaleFactor = 0.03 * max(box[1] - box[0], box[5] - box[4])
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
    display.Ambient, display.Diffuse = 0.65, 0.45
    display.Opacity = 1.0 if FIELD == "section" else 0.4
    coloured(display, view, *FLUX_DENSITY, WHERE)


def cropped(field):
    """The field without the air."""
    if not CROP_AIR or AIR is None:
        return field
    if (found := pv.FindSource("section")) is None:
        found = pv.Threshold(registrationName="section", Input=field, Scalars=["CELLS", "region"], Invert=1)
        found.ThresholdMethod, found.LowerThreshold, found.UpperThreshold = "Between", AIR, AIR
    return found


def caption(view, series):
    """Return what is shown, and when."""
    first = next(iter(series.values()))
    time = pv.AnnotateTimeFilter(registrationName="time", Input=first, Format="t = {time:.3f} ms", Scale=1e3)
    for text, place in ((time, (0.02, 0.9)), (pv.Text(registrationName="title", Text=TITLE), (0.02, 0.945))):
        display = pv.Show(text, view)
        display.WindowLocation, display.Position = "Any Location", place
        display.Color, display.FontSize = (0.0, 0.0, 0.0), 18


def aim(view, series, options):
    """Turn the camera: r up and z to the right, as in section.png; on a full circle along its axis."""
    look = options.look
    if look == "device":
        towards, up, margin = (0.5, 1.0, 0.5), (1.0, 0.0, 0.0), 0.56
    elif SECTOR is not None:
        towards, up, margin = (0.3, 1.0, 0.12), (1.0, 0.0, 0.0), 0.47
    else:
        towards, up, margin = (0.35, 0.5, 1.0), (0.0, 1.0, 0.0), 0.45
    if look == "device" and "field" in series:
        box = list(updated(cropped(series["field"])).GetDataInformation().GetBounds())
        box[0] = -box[1] if FIELD == "section" else box[0]
    else:
        box = series.get("particles", next(iter(series.values()))).GetDataInformation().GetBounds()
    length = math.hypot(*towards)
    reach = math.hypot(box[1] - box[0], box[3] - box[2], box[5] - box[4])
    right = [up[k - 2] * towards[k - 1] - up[k - 1] * towards[k - 2] for k in range(3)]
    beside = BESIDE * 2.0 * margin * reach * options.size[0] / options.size[1] / math.hypot(*right)
    middle = [0.5 * (box[2 * k] + box[2 * k + 1]) + beside * right[k] for k in range(3)]
    view.CameraFocalPoint = middle
    view.CameraPosition = [m + 2.0 * reach * t / length for m, t in zip(middle, towards, strict=True)]
    view.CameraViewUp = up
    view.CameraParallelProjection = 1
    view.CameraParallelScale = margin * reach


PARTS = {  # what can be shown: the series that it is made of, and who draws it
    "grains": ("particles", grains),
    "chains": ("contacts", chains),
    "walls": ("walls", walls),
    "section": ("field", section),
    "lines": ("field", lines),
    "arrows": ("field", arrows),
    "device": ("field", device),
}
SUITS = {
    "gap": ("grains", "walls", "section", "lines"),
    "chains": ("grains", "chains", "walls"),
    "device": ("grains", "device", "lines"),
}

main()
