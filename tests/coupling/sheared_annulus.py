"""Runs of a sheared annulus of grains in a uniform field, and the states that they end in."""

from dataclasses import replace

import numpy as np

import emclutch
from emclutch.results.checkpoint import read_checkpoint
from emclutch.scene.case import case_from
from geometry.annular_cell import ShearCell

CELL = {
    "scene": {"title": "sheared annulus", "seed": 3},
    "geometry": {"kind": "shear_cell", "inner_radius": 10e-3, "outer_radius": 11.2e-3, "height": 2e-3},
    "field": {"source": "uniform", "field_strength": "150 kA/m", "direction": "radial"},
    "particles": {"diameter": "0.3 mm", "solid_fraction": 0.35, "sector": "20 deg"},
    "motion": {"rotor": {"speed": "300 rpm"}, "disc": {"speed": 0.0}},
    "effects": {"magnetic_force": {}, "dipoles": {"model": "mutual", "cutoff": 2.5}, "saturation": {}},
    "time": {"end": "1 ms"},
    "output": {"snapshots": 0, "pictures": False, "formats": []},
}
DRY = {name: CELL[name] for name in ("scene", "geometry", "motion", "time")} | {
    "particles": CELL["particles"] | {"solid_fraction": 0.1},
    "effects": {},
}
"""Fewer grains without a field."""


def run(folder, name, values=None, **options):
    """The annulus with other ``values`` of its keys, into the folder ``name``."""
    return emclutch.run(case_from(CELL, values or {}), out=folder / name, **options)


def make_cylinders_of_steel(monkeypatch):
    """Let the cylinders of an annulus mirror dipoles, as poles do; the shape by itself is of no material."""
    plain = ShearCell.walls
    monkeypatch.setattr(
        ShearCell, "walls", lambda cell: [replace(wall, magnetic=wall.body != "housing") for wall in plain(cell)]
    )


def state(folder, name):
    """The grains at the end of a run, as its checkpoint has them."""
    return read_checkpoint(folder / name / "checkpoint.h5")["dem"]


def same(a, b):
    """Whether two of these states are one, bit for bit."""
    return all(np.array_equal(a[key], b[key]) for key in ("position_radius", "velocity_force", "particle_id"))
