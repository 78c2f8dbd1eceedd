"""A run in pyvista: a window with a slider of time, a picture, or a movie."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import MaxNLocator

from emclutch.results.view import look as looks
from emclutch.results.view.frame_meshes import body_names, frame_meshes, name_places
from emclutch.results.view.run_files import RunFiles
from emclutch.scene.errors import Fault, SceneError

FORCE_MAP = LinearSegmentedColormap.from_list("force", looks.FORCE_COLOURS)
FIELD_MAP = LinearSegmentedColormap.from_list("field", looks.FIELD_COLOURS)
STYLES: dict[str, dict[str, Any]] = {
    "grains": {"cmap": looks.GRAIN_COLOURS},
    "chains": {"cmap": FORCE_MAP},
    "walls": {"rgb": True, "opacity": looks.WALL_OPACITY},
    "section": {"cmap": FIELD_MAP, "lighting": False},
    "lines": {"color": looks.LINE_COLOUR, "line_width": 2.0},
    "edges": {"color": looks.EDGE_COLOUR, "line_width": 1.5},
    "device": {"cmap": FIELD_MAP, "ambient": looks.AMBIENT, "diffuse": looks.DIFFUSE},
}
BAR = {
    "vertical": True, "position_x": 0.05, "height": 0.27, "width": 0.9, "color": "black", "title_font_size": 18,
    "label_font_size": 16, "fmt": "%.3g", "n_labels": 4, "render": False,
}  # fmt: skip
NAMES: dict[str, Any] = {
    "name": "names", "always_visible": True, "show_points": False, "font_size": 22, "text_color": "black",
    "shape": None, "justification_horizontal": "right", "justification_vertical": "center", "reset_camera": False,
    "render": False,
}  # fmt: skip
LAYOUT: dict[str, Any] = {  # title and time above, colour bars to the right, so that nothing lies behind them
    "shape": (2, 2), "groups": [(0, [0, 1])], "border": False,
    "row_weights": [looks.HEAD_HEIGHT, 1.0 - looks.HEAD_HEIGHT],
    "col_weights": [1.0 - looks.BAR_WIDTH, looks.BAR_WIDTH],
}  # fmt: skip
TO_FRONT = -1e5  # steps of depth
HEAD, PICTURE, BARS = (0, 0), (1, 0), (1, 1)  # parts of it


class RunView:
    """One view of a run, redrawn for each moment.

    Parameters
    ----------
    files : what the run's folder holds.
    look : one of `look.LOOKS`.
    colour : of the grains, one of the run's colours; None where there are no grains.
    window : whether a window is to open.
    field : what the section and the device are coloured by, one of `look.FIELDS`; None: B, but a device that is swept
        from a section by its bodies.
    ring : whether a sector is repeated round the axis.
    """

    def __init__(
        self,
        files: RunFiles,
        look: str,
        colour: str | None,
        *,
        window: bool,
        field: str | None = None,
        ring: bool = False,
        size: tuple[int, int] = looks.SIZE,
    ) -> None:
        self.files, self.look, self.colour, self.field, self.ring = files, look, colour, field, ring
        with pyvista.vtk_verbosity("off"):  # without a screen vtk complains before it draws in memory
            plotter: Any = pyvista.Plotter(off_screen=not window, window_size=list(size), **LAYOUT)
        self.plotter = plotter
        self.plotter.set_background("white")
        self.plotter.subplot(*PICTURE)
        self.plotter.render_window.SetMultiSamples(0)  # else what is translucent is missing where Mesa draws
        self.plotter.enable_depth_peeling(4)
        self.plotter.enable_anti_aliasing("ssaa")
        self.plotter.add_axes(color="black")
        self.plotter.subplot(*HEAD)
        self.plotter.add_text(files.title, position=(0.02, 0.55), viewport=True, font_size=10, color="black")
        self._limits: dict[str, tuple[float, float]] = {}
        self._aimed = False
        self._is_sector = files.sector is not None and not ring
        self._axes = looks.view_axes(look, self._is_sector)

    def draw(self, time: float) -> None:
        """Show the moment that was written nearest to a time [s]."""
        time = self.files.nearest_time(time)
        meshes = frame_meshes(self.files, time, looks.LOOKS[self.look], self.colour, self.field, ring=self.ring)
        self.plotter.subplot(*PICTURE)
        for part in STYLES:
            if part in meshes:
                self._add(part, meshes[part])
            else:
                self.plotter.remove_actor(part, render=False)
        self._name_bodies(meshes)
        if self.files.has_time:
            text, place = f"t = {1e3 * time:.3f} ms", (0.02, 0.1)
            self.plotter.subplot(*HEAD)
            self.plotter.add_text(text, position=place, viewport=True, font_size=10, color="black", name="time")
            self.plotter.subplot(*PICTURE)
        if not self._aimed and meshes:
            self._aim(meshes)
            self._aimed = True

    def _name_bodies(self, meshes: dict[str, Any]) -> None:
        """Write the names of the bodies beside them, each with a line to its body that ends in a dot."""
        points, names = body_names(self.files, meshes, self._axes)
        for old in ("names-labels", "leaders", "ends"):
            self.plotter.remove_actor(old, render=False)
        if names:
            places = name_places(points, self._target(meshes), self._axes)
            leaders = pyvista.line_segments_from_points(np.stack((places, points), axis=1).reshape(-1, 3))
            plain = {"color": "black", "reset_camera": False, "render": False}
            drawn = self.plotter.add_mesh(leaders, name="leaders", line_width=1.5, **plain)
            dots = self.plotter.add_points(points, name="ends", point_size=7, **plain)
            for mapper in (drawn.mapper, dots.mapper):  # before all else
                mapper.SetResolveCoincidentTopologyToPolygonOffset()
                mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, TO_FRONT)
                mapper.SetRelativeCoincidentTopologyPointOffsetParameter(TO_FRONT)
            self.plotter.add_point_labels(places, names, **NAMES)

    def _add(self, part: str, mesh: Any) -> None:
        options: dict[str, Any] = {"name": part, "show_scalar_bar": False, "reset_camera": False, "render": False}
        options |= STYLES[part]
        if part == "grains" and self.look == "chains":
            options["opacity"] = looks.GRAIN_OPACITY
        if part == "device" and self.files.field == "space":
            options["opacity"] = looks.SOLID_OPACITY
        if part not in ("lines", "edges"):
            options["scalars"] = "shown"
        bar = {"section": "field", "device": "field"}.get(part, part)
        if part == "device" and mesh["shown"].ndim == 2:
            bar, options["rgb"] = "bodies", True
        if bar in looks.BARS:
            if bar not in self._limits:  # of the first moment drawn: colours of a movie keep their meaning
                top = looks.MAX_FIELD if bar == "field" else 100.0
                low = 0.0 if bar == "field" else float(np.min(mesh["shown"]))
                high = float(np.percentile(mesh["shown"], top))
                self._limits[bar] = (low, high if high > low else low + (abs(low) or 1.0))
            options["clim"] = self._limits[bar]
        actor = self.plotter.add_mesh(mesh, **options)
        title = self._label(bar).replace(" [", "\n[") if bar in looks.BARS else ""
        if title and title not in self.plotter.scalar_bars:
            self.plotter.subplot(*BARS)
            drawn = self.plotter.add_scalar_bar(title, mapper=actor.mapper, position_y=looks.BARS[bar], **BAR)
            drawn.SetBarRatio(0.18)  # of its column, which the title too lies in
            drawn.SetVerticalTitleSeparation(10)  # [pixels]: else the unit touches the first number
            low, high = self._limits[bar]
            steps = np.asarray(MaxNLocator(4).tick_values(low, high))
            drawn.SetCustomLabels(pyvista.convert_array(steps[(steps >= low) & (steps <= high)]))
            drawn.SetUseCustomLabels(True)
            self.plotter.subplot(*PICTURE)

    def _label(self, bar: str) -> str:
        if bar == "grains":
            assert self.colour is not None
            return self.files.colours[self.colour][1]
        return {"chains": looks.FORCE[1], "field": looks.FIELDS[self.field or "B"][1]}[bar]

    def _target(self, meshes: dict[str, Any]) -> tuple[float, ...]:
        """Box x0, x1, y0, y1, z0, z1 [m] of what is looked at: the device, or grains, walls and a ring's section."""
        names = ["device"] if self.look == "device" else ["grains", "walls"] + ["section"] * (not self._is_sector)
        found = [meshes[name].bounds for name in names if name in meshes] or [next(iter(meshes.values())).bounds]
        low, high = np.min(found, axis=0)[::2], np.max(found, axis=0)[1::2]
        return tuple(np.stack((low, high), axis=1).ravel())

    def _aim(self, meshes: dict[str, Any]) -> None:
        """Turn the camera to the device or the grains."""
        camera, size = self.plotter.camera, self.plotter.window_size
        aspect = size[0] * (1.0 - looks.BAR_WIDTH) / (size[1] * (1.0 - looks.HEAD_HEIGHT))
        left = looks.NAMES_WIDTH[self.look] if "leaders" in self.plotter.actors else 0.0
        camera.focal_point, camera.position, camera.up, half = looks.camera(
            self.look, self._is_sector, self._target(meshes), aspect, left
        )
        camera.parallel_projection = True
        camera.parallel_scale = half
        self.plotter.reset_camera_clipping_range()


def screenshot(view: RunView, path: Path, time: float | None) -> Path:
    """Write a picture of the moment nearest to a time [s], of the last for None."""
    view.draw(view.files.nearest_time(time))
    with pyvista.vtk_verbosity("off"):
        view.plotter.screenshot(path)
    view.plotter.close()
    return path


def movie(view: RunView, path: Path) -> Path:
    """Write a movie of all moments: .gif, or .mp4, for which pyvista needs imageio and imageio-ffmpeg."""
    times = view.files.times
    view.draw(times[-1])  # the colours are those of the last moment
    if path.suffix == ".gif":
        from PIL import Image

        pictures = []
        for time in times:
            view.draw(time)
            with pyvista.vtk_verbosity("off"):
                pictures.append(Image.fromarray(view.plotter.screenshot(return_img=True)))
        milliseconds = 1000 // looks.FRAMES_A_SECOND
        pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=milliseconds, loop=0)
    else:
        try:
            view.plotter.open_movie(path, framerate=looks.FRAMES_A_SECOND)
        except ImportError:
            message = "needs imageio and imageio-ffmpeg: pip install imageio imageio-ffmpeg; or write a .gif"
            raise SceneError([Fault("--movie", str(path), message)], "command line") from None
        for time in times:
            view.draw(time)
            view.plotter.write_frame()
    view.plotter.close()
    return path


def window(view: RunView, time: float | None) -> None:
    """Open a window with a slider of time; returns when it is closed."""
    times = view.files.times
    view.draw(view.files.nearest_time(time))
    if len(times) > 1:

        def slid(milliseconds: float) -> None:
            view.draw(1e-3 * milliseconds)

        view.plotter.add_slider_widget(
            slid,
            (1e3 * times[0], 1e3 * times[-1]),
            value=1e3 * view.files.nearest_time(time),
            title="t [ms]",
            pointa=(0.3, 0.06),
            pointb=(0.7, 0.06),
            color="black",
            fmt="%.3f",
        )
    view.plotter.show()
