"""The centrifugal clutch: closed parts that never meet, volumes, what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from geometry.centrifugal import CentrifugalClutch
from geometry.triangle_wall import TriangleWall

MM = 1e-3
CLUTCH = CentrifugalClutch()


def triangle_walls(clutch: CentrifugalClutch, body: str) -> list[TriangleWall]:
    return [wall for wall in clutch.walls() if isinstance(wall, TriangleWall) and wall.body == body]


def winding(points: np.ndarray, wall: TriangleWall) -> np.ndarray:
    """How often a surface encloses each point: solid angles over 4 pi (van Oosterom and Strackee 1983)."""
    corners = wall.vertices[wall.triangles][None] - points[:, None, None, :]
    a, b, c = np.moveaxis(corners, 2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    dot = np.einsum
    below = la * lb * lc + dot("pti,pti->pt", a, b) * lc + dot("pti,pti->pt", b, c) * la + dot("pti,pti->pt", c, a) * lb
    angle = 2.0 * np.arctan2(dot("pti,pti->pt", a, np.cross(b, c)), below)
    return angle.sum(axis=1) / (4.0 * math.pi)


def from_axis(wall: TriangleWall) -> float:
    """Least distance [m] of a surface from the axis: an edge or a corner has it where no triangle crosses the axis."""
    ends = wall.vertices[wall.triangles][..., :2]
    start, along = ends, np.roll(ends, -1, axis=1) - ends
    size = np.maximum((along**2).sum(axis=-1), 1e-30)
    t = np.clip(-(start * along).sum(axis=-1) / size, 0.0, 1.0)
    return float(np.linalg.norm(start + t[..., None] * along, axis=-1).min())


@st.composite
def clutches(draw):
    size = st.floats(0.5 * MM, 60 * MM)
    clutch = CentrifugalClutch(
        drum_radius=draw(st.floats(60 * MM, 300 * MM)),
        width=draw(st.floats(20 * MM, 200 * MM)),
        hub_radius=draw(st.floats(10 * MM, 100 * MM)),
        vanes=draw(st.integers(1, 12)),
        vane_thickness=draw(st.floats(0.5 * MM, 20 * MM)),
        tip_clearance=draw(st.floats(0.1 * MM, 10 * MM)),
        side_clearance=draw(st.floats(0.1 * MM, 5 * MM)),
        slots=draw(st.integers(0, 4)),
        slot_width=draw(size),
        slot_depth=draw(size),
        ribs=draw(st.integers(0, 40)),
        rib_height=draw(st.floats(0.1 * MM, 20 * MM)),
        rib_width=draw(st.floats(0.5 * MM, 20 * MM)),
    )
    assume(not clutch.faults())
    return clutch


@given(clutches())
@settings(max_examples=40, deadline=None)
def test_every_part_is_closed_and_its_normals_point_outwards(clutch):
    """Each directed edge has exactly one opposite: watertight, consistently oriented, and nothing touches itself."""
    parts = triangle_walls(clutch, "rotor") + triangle_walls(clutch, "disc")
    assert len(parts) == clutch.vanes + clutch.ribs
    for part in parts[:: max(1, clutch.vanes)]:
        edges = [tuple(edge) for t in part.triangles.tolist() for edge in zip(t, t[1:] + t[:1], strict=True)]
        assert len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)
        assert part.volume > 0.0


@given(clutches())
@settings(max_examples=40, deadline=None)
def test_input_and_output_never_meet_at_any_angle(clutch):
    """Turning about the axis keeps radii and heights: all of the input lies inside a cylinder, all ribs outside it."""
    for vane in triangle_walls(clutch, "rotor"):
        assert np.hypot(*vane.vertices.T[:2]).max() == pytest.approx(clutch.tip_radius, rel=1e-12)
        assert np.abs(vane.vertices[:, 2]).max() == pytest.approx(0.5 * clutch.width - clutch.side_clearance, rel=1e-12)
    for rib in triangle_walls(clutch, "disc"):
        assert from_axis(rib) == pytest.approx(clutch.tip_radius + clutch.tip_clearance, rel=1e-9)
    rotor = [wall for wall in clutch.walls() if wall.body == "rotor" and not isinstance(wall, TriangleWall)]
    assert [wall.name for wall in rotor] == ["hub"]


@given(clutches())
@settings(max_examples=40, deadline=None)
def test_roots_lie_behind_the_wall_that_carries_them(clutch):
    """A joint with hub or drum is a concave corner: no face or edge of the root is on the grains' side."""
    for vane in triangle_walls(clutch, "rotor"):
        radius = np.hypot(*vane.vertices.T[:2])
        assert np.count_nonzero(radius < clutch.hub_radius - 1e-9) == 4
    for rib in triangle_walls(clutch, "disc"):
        radius, height = np.hypot(*rib.vertices.T[:2]), np.abs(rib.vertices[:, 2])
        assert np.count_nonzero(radius > clutch.drum_radius + 0.9 * clutch.rib_height) == 4
        assert height.min() > 0.5 * clutch.width


def test_the_space_left_to_the_shot_is_that_of_random_points_outside_all_parts():
    """Monte Carlo against the closed form; the points' share has the standard error sqrt(p (1 - p)/n)."""
    clutch = replace(CLUTCH, vane_thickness=12 * MM, rib_height=8 * MM, rib_width=14 * MM)  # so that parts matter
    rng = np.random.default_rng(4)
    n = 8_000
    r = np.sqrt(rng.uniform(clutch.hub_radius**2, clutch.drum_radius**2, n))
    theta, z = rng.uniform(0.0, 2.0 * math.pi, n), rng.uniform(-0.5, 0.5, n) * clutch.width
    points = np.column_stack([r * np.cos(theta), r * np.sin(theta), z])
    solid = np.zeros(n)
    for wall in clutch.walls():
        if isinstance(wall, TriangleWall):
            turns = winding(points, wall)
            assert np.abs(turns - np.round(turns)).max() < 1e-9
            solid += np.round(turns)
    assert set(np.unique(solid)) == {0.0, 1.0}  # and no two parts share a point
    ring = math.pi * (clutch.drum_radius**2 - clutch.hub_radius**2) * clutch.width
    share = clutch.volume / ring
    assert share < 0.9
    assert 1.0 - solid.mean() == pytest.approx(share, abs=4.0 * math.sqrt(share * (1.0 - share) / n))


def test_slots_are_open_to_the_tip_and_the_teeth_between_them_are_not():
    vane = triangle_walls(CLUTCH, "rotor")[0]  # its middle plane is y = 0
    half = 0.5 * CLUTCH.width - CLUTCH.side_clearance
    pitch = CLUTCH.tooth_width + CLUTCH.slot_width
    teeth = -half + 0.5 * CLUTCH.tooth_width + pitch * np.arange(CLUTCH.slots + 1)
    gaps = 0.5 * (teeth[1:] + teeth[:-1])
    assert teeth[-1] == pytest.approx(half - 0.5 * CLUTCH.tooth_width)
    floor = CLUTCH.tip_height - CLUTCH.slot_depth
    for x, in_gap in ((floor - 1 * MM, 1.0), (floor + 1 * MM, 0.0), (CLUTCH.tip_height - 1 * MM, 0.0)):
        for z, expected in ((teeth, 1.0), (gaps, in_gap)):
            points = np.column_stack([np.full(len(z), x), np.zeros(len(z)), z])
            assert winding(points, vane) == pytest.approx(np.full(len(z), expected), abs=1e-9)


def test_a_turn_by_one_pitch_changes_nothing():
    for body, count in (("rotor", CLUTCH.vanes), ("disc", CLUTCH.ribs)):
        parts = triangle_walls(CLUTCH, body)
        for part, following in zip(parts, parts[1:] + parts[:1], strict=True):
            turned = part.turned(2.0 * math.pi / count)
            assert np.abs(turned.vertices - following.vertices).max() < 1e-12


def test_the_chambers_are_equal_and_clear_of_the_vanes():
    boxes = list(CLUTCH.fill_boxes().values())
    assert [box.volume() for box in boxes] == pytest.approx([boxes[0].volume()] * CLUTCH.vanes)
    assert sum(box.volume() for box in boxes) < CLUTCH.volume
    assert sum(box.volume(math.pi) for box in boxes) == pytest.approx(0.5 * sum(box.volume() for box in boxes))
    rng = np.random.default_rng(1)
    for box in boxes:
        r, theta = rng.uniform(box.r0, box.r1, 200), rng.uniform(box.theta0, box.theta1, 200)
        points = np.column_stack([r * np.cos(theta), r * np.sin(theta), rng.uniform(box.z0, box.z1, 200)])
        for vane in triangle_walls(CLUTCH, "rotor"):
            assert np.abs(winding(points, vane)).max() < 1e-9


def test_plain_vanes_and_a_smooth_drum_need_no_sizes_of_slots_and_ribs():
    plain = replace(CLUTCH, slots=0, slot_width=0.0, slot_depth=0.0, ribs=0, rib_height=0.0, rib_width=0.0)
    assert not plain.faults(12.5 * MM)
    assert len(triangle_walls(plain, "disc")) == 0
    vane = triangle_walls(plain, "rotor")[0]
    assert len(vane.triangles) == 12  # a box
    assert plain.tip_radius == plain.drum_radius - plain.tip_clearance


FAULTS = {
    "negative size": ({"width": -1.0}, "width", "more than 0 mm"),
    "no vanes": ({"vanes": 0}, "vanes", "from 1 to 60"),
    "half a rib": ({"ribs": 2.5}, "ribs", "from 0 to 360"),
    "slots without a width": ({"slot_width": 0.0}, "slot_width", "more than 0 mm"),
    "ribs without a height": ({"rib_height": 0.0}, "rib_height", "more than 0 mm"),
    "hub as large as the drum": ({"hub_radius": 120 * MM}, "drum_radius", "more than 129 mm"),
    "vanes that meet": ({"vanes": 60}, "vane_thickness", "less than 4.187 mm"),
    "no width left": ({"side_clearance": 45 * MM}, "side_clearance", "less than 45 mm"),
    "slots as wide as the vane": ({"slot_width": 30 * MM}, "slot_width", "less than 29.33 mm"),
    "slots down to the hub": ({"slot_depth": 76 * MM}, "slot_depth", "less than 76 mm"),
    "ribs without grooves": ({"rib_width": 50 * MM, "rib_height": 9 * MM}, "rib_width", "less than 44.16 mm"),
    "ribs that vanish in the drum": ({"rib_width": 50 * MM}, "rib_width", "less than 43.63 mm"),
    "tips that let the shot pass": ({"tip_clearance": 12 * MM}, "tip_clearance", "less than 10.47 mm"),
    "sides that let the shot pass": ({"side_clearance": 13 * MM, "slot_width": 5 * MM}, "side_clearance",
                                     "less than 12.5 mm"),
    "drum narrower than a grain": ({"width": 12 * MM, "slots": 0}, "width", "at least 12.5 mm"),
    "ring thinner than a grain": ({"hub_radius": 106 * MM, "slots": 0, "vane_thickness": 2 * MM}, "drum_radius",
                                  "at least 120.5 mm"),
    "chambers narrower than a grain": ({"vanes": 50, "vane_thickness": 3 * MM}, "vanes", "at most 46"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_name_the_size_and_the_range(name):
    changes, key, allowed = FAULTS[name]
    faults = replace(CLUTCH, **changes).faults(12.5 * MM)
    assert [fault.what for fault in faults] == [key]
    assert allowed in faults[0].allowed
    assert faults[0].remedy


def test_the_shipped_clutch_is_half_full_of_a_thousand_spheres():
    assert not CLUTCH.faults(10 * MM) and not CLUTCH.faults(15 * MM)
    bulk = 1000 * math.pi / 6 * (12.5 * MM) ** 3 / 0.6  # settled at a solid fraction of 0.6
    assert 1 / 3 < bulk / CLUTCH.volume < 0.52
