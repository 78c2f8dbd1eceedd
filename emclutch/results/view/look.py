"""Layers, colours, places and camera of a view of a run, in pyvista as in ParaView.

The script for ParaView holds this file, so that both programs show the same: it is plain Python and imports nothing of
the project.
"""

import math

LOOKS = {
    "gap": ("grains", "walls", "section", "lines"),
    "chains": ("grains", "chains", "walls"),
    "device": ("grains", "device", "lines"),
}
"""Layers of each look: the grains before the field, their force chains, or the device swept round its axis."""

SIZE = (1400, 1000)  # pixels
FRAMES_A_SECOND = 10  # of a movie
SWEEP = 180.0  # how far the device is swept round its axis [degrees]
CHAIN_WIDTH = 0.6  # radius of the tube of the largest force, in radii of the smallest grain
GRAIN_OPACITY = 0.15  # with force chains, which are inside the grains
WALL_OPACITY = 0.3
SOLID_OPACITY = 0.4  # of a device in 3D, which the grains are inside of
AMBIENT, DIFFUSE = 0.65, 0.45  # light on the device
MARGIN = {"gap": 1.15, "chains": 1.15, "device": 1.06}  # what a picture shows, over the grains or the device
BESIDE = 0.14  # of the width of ParaView's picture, kept free for colour bars
NAMES_WIDTH = {"gap": 0.1, "chains": 0.1, "device": 0.17}  # of the width, kept free for the names of bodies by pyvista
NEAR = (0.28, 1.0, 0.07)  # how far around the grains a gap is shown, in x, y and z, over the grains' diagonal
BAR_WIDTH, HEAD_HEIGHT = 0.14, 0.11  # of the picture, kept free for colour bars and for title and time by pyvista

CORNER = 25.0  # [degrees] by which an outline turns at an edge that is drawn
SHADES = ((0.85, 0.55, 0.25), (0.25, 0.5, 0.8), (0.45, 0.65, 0.4), (0.6, 0.6, 0.6))  # of the bodies, in turn
MARK = 0.5  # brightness of a mark on a wall, relative to the wall
LINE_COLOUR = (0.25, 0.25, 0.25)
EDGE_COLOUR = (0.1, 0.1, 0.1)
GRAIN_COLOURS = "viridis"  # of matplotlib
# Light where there is little, so that what lies before it is seen; steel without flux grey, to be seen before white.
FORCE_COLOURS = ((0.9, 0.86, 0.8), (0.99, 0.83, 0.62), (0.99, 0.55, 0.35), (0.84, 0.19, 0.12), (0.5, 0.0, 0.0))
FIELD_COLOURS = ((0.74, 0.75, 0.76), (0.6, 0.71, 0.84), (0.46, 0.5, 0.79), (0.53, 0.25, 0.62), (0.3, 0.0, 0.29))

FORCE = ("force", "contact force [N]")  # array and label with its unit
FIELDS = {"B": ("flux_density", "flux density B [T]"), "H": ("field_strength", "field strength H [A/m]")}
MAX_FIELD = 99.5  # percentile of the colours' upper end: iron corners are singular and would darken all the rest
BARS = {"grains": 0.68, "chains": 0.37, "field": 0.06}  # bottom of each colour bar, in heights of the picture
TITLE_PLACE, TIME_PLACE = (0.02, 0.945), (0.02, 0.9)


def line_offset(outer_radius):
    """Return the y [m] at which flux lines are drawn: before the section, not in it."""
    return 2e-4 * outer_radius


def near_box(box):
    """Return the box (x0, x1, y0, y1, z0, z1) [m] around a sector's grains in which a gap is shown."""
    reach = math.hypot(box[1] - box[0], box[3] - box[2], box[5] - box[4])
    return [end + (2 * (k % 2) - 1) * NEAR[k // 2] * reach for k, end in enumerate(box)]


def view_axes(look, is_sector):
    """Return the unit vectors of a view: to the right, up, and towards the eye.

    r points up and z to the right, as in section.png; a full circle is seen along its axis.
    """
    if look == "device":
        towards, up = (0.45, 1.0, 0.8), (1.0, 0.0, 0.0)
    elif is_sector:
        towards, up = (0.3, 1.0, 0.12), (1.0, 0.0, 0.0)
    else:
        towards, up = (0.35, 0.5, 1.0), (0.0, 1.0, 0.0)
    right = _unit(_cross(up, towards))
    return right, _unit(_cross(towards, right)), _unit(towards)


def camera(look, is_sector, box, aspect, left=0.0, right=0.0):
    """Return focal point, position, direction up and half height of the view of a box (x0, x1, y0, y1, z0, z1) [m].

    What it holds, of a device all within its outer radius, fits into a picture of `aspect` (width over height), of
    whose width `left` and `right` stay free.
    """
    axes = view_axes(look, is_sector)
    outline = [(x, y) for x in box[:2] for y in box[2:4]]
    if look == "device":
        radius, angles = max(map(abs, box[:4])), [math.radians(5.0 * k) for k in range(72)]
        outline = [(radius * math.cos(a), min(max(radius * math.sin(a), box[2]), box[3])) for a in angles]
    corners = [(x, y, z) for x, y in outline for z in box[4:]]
    spans = [[f([_dot(corner, axis) for corner in corners]) for f in (min, max)] for axis in axes]
    (x0, x1), (y0, y1), (far, near) = spans
    width, height = x1 - x0, y1 - y0
    half = 0.5 * MARGIN[look] * max(height, width / (aspect * (1.0 - left - right)))
    middle = (0.5 * (x0 + x1) + (right - left) * half * aspect, 0.5 * (y0 + y1), 0.5 * (far + near))
    reach = math.hypot(box[1] - box[0], box[3] - box[2], box[5] - box[4])
    focus = [sum(m * axis[k] for m, axis in zip(middle, axes, strict=True)) for k in range(3)]
    position = [f + 2.0 * reach * t for f, t in zip(focus, axes[2], strict=True)]
    return focus, position, axes[1], half


def _dot(a, b):
    return sum(p * q for p, q in zip(a, b, strict=True))


def _cross(a, b):
    return [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]


def _unit(a):
    return [p / math.hypot(*a) for p in a]
