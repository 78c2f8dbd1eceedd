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
BESIDE = 0.07  # of the picture's width, by which what ParaView shows moves away from the bars
NEAR = (0.28, 1.0, 0.07)  # how far around the grains ParaView shows a gap, in x, y and z, over the grains' diagonal
BAR_WIDTH, HEAD_HEIGHT = 0.14, 0.11  # of the picture, kept free for colour bars and for title and time by pyvista

SHADES = ((0.85, 0.55, 0.25), (0.25, 0.5, 0.8), (0.45, 0.65, 0.4), (0.6, 0.6, 0.6))  # of the bodies, in turn
MARK = 0.5  # brightness of a mark on a wall, relative to the wall
LINE_COLOUR = (0.25, 0.25, 0.25)
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


def camera(look, is_sector, box, aside=0.0):
    """Return focal point, position, direction up and half height of the view of a box (x0, x1, y0, y1, z0, z1) [m].

    r points up and z to the right, as in section.png; a full circle is seen along its axis. `aside`: by how much of the
    picture's height what is shown moves to the left.
    """
    if look == "device":
        towards, up, margin = (0.5, 1.0, 0.5), (1.0, 0.0, 0.0), 0.56
    elif is_sector:
        towards, up, margin = (0.3, 1.0, 0.12), (1.0, 0.0, 0.0), 0.47
    else:
        towards, up, margin = (0.35, 0.5, 1.0), (0.0, 1.0, 0.0), 0.45
    reach = math.hypot(box[1] - box[0], box[3] - box[2], box[5] - box[4])
    right = [up[k - 2] * towards[k - 1] - up[k - 1] * towards[k - 2] for k in range(3)]
    aside *= 2.0 * margin * reach / math.hypot(*right)
    focus = [0.5 * (box[2 * k] + box[2 * k + 1]) + aside * right[k] for k in range(3)]
    position = [f + 2.0 * reach * t / math.hypot(*towards) for f, t in zip(focus, towards, strict=True)]
    return focus, position, up, margin * reach
