"""The pictures of a finished run: section with |B| and flux lines, torque and speeds against time, grains."""

from __future__ import annotations

import numpy as np

from coupling import CoilField, SolidCoilField
from emclutch.results import RunFolder, load_result
from emclutch.results.field_pictures import gap_map_picture
from emclutch.results.pictures import (
    axial_picture,
    grains_picture,
    profile_picture,
    section_picture,
    speed_picture,
    torque_picture,
)
from emclutch.results.speed_picture import speeds_vary
from emclutch.snapshots import contact_lines
from emclutch.solid_field_study import gap_map
from geometry.centrifugal import CentrifugalClutch


def draw_run(case, folder: RunFolder, device, simulation, profiles=()) -> None:
    """Write the pictures that the run has something to show in.

    section.png or gap.png with a solved field, torque.png, speeds.png where a shaft's speed changes, grains.png, and
    profiles.png where they were asked for.
    """
    title = case.scene.scene.title
    grains, dem = simulation.motion.grains, simulation.motion
    source = simulation.source
    if isinstance(source, CoilField) and source.solution is not None:
        x = grains.position
        r, theta = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
        middle = 0.0 if dem.sector is None else 0.5 * dem.sector.angle
        slice_ = np.abs(r * (theta - middle)) < grains.radius  # one layer of grains around a half-plane
        section_picture(
            folder.section_picture,
            source.problem.mesh,
            source.solution.point_psi,
            source.solution.flux_density(),
            title=title,
            grains=np.column_stack([r, x[:, 2], grains.radius])[slice_],
            filled=device.coil.powder_boxes,
        )
    elif isinstance(source, SolidCoilField) and source.solution is not None:
        gap_map_picture(folder.path / "gap.png", *gap_map(device.coil, source.solution), title=title)
    result = load_result(folder.path)
    if "torque_disc" in result.history:  # a box has no disc
        torque_picture(folder.torque_picture, result.history, result.torque, result.other_histories, title=title)
    if speeds_vary(result.history):
        speed_picture(folder.path / "speeds.png", {title: result.history}, title=title)
    if profiles:
        profile_picture(folder.path / "profiles.png", profiles, title=title)
    start, end, force = contact_lines(dem)
    chains = start, end, np.linalg.norm(force, axis=1)
    speed = np.linalg.norm(grains.velocity, axis=1)
    if isinstance(device.shape, CentrifugalClutch):
        axial_picture(
            folder.grains_picture,
            grains.position,
            grains.radius,
            speed,
            walls=dem.walls,
            angles={body.name: body.angle for body in dem.bodies},
            chains=chains,
            title=f"{title}, t = {dem.time:.3g} s",
        )
        return
    grains_picture(
        folder.grains_picture,
        grains.position,
        grains.radius,
        speed,
        walls=dem.walls,
        chains=chains,
        title=title,
        sector_angle=None if dem.sector is None else dem.sector.angle,
    )
