"""Clutches with slots: faults, and meshes of a sector against the volumes and areas of the drawing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from geometry import Clutch, GeometryError
from geometry.mesh_3d import EDGES
from geometry.meshing_3d import faces_of
from geometry.slots import Slots
from geometry.slotted import mesh_slotted

DISC_SLOTS, ROTOR_SLOTS = Slots(12, 0.4, 6e-3), Slots(24, 0.3, 3e-3)
# Coarse, with wide gaps: these tests look at the geometry, which no element size may change.
COARSE = {"size_factor": 4.0, "gap_layers": 2}
WIDE = {"gap": 3e-3, "face_gap": 3e-3, "clearance": 1e-3, "air_factor": 2.0}


@pytest.fixture(scope="module")
def slotted():
    clutch = Clutch(**WIDE, disc_slots=DISC_SLOTS, rotor_slots=ROTOR_SLOTS)
    return clutch, mesh_slotted(clutch, **COARSE)


@pytest.fixture(scope="module")
def plain():
    clutch = Clutch(**WIDE)
    return clutch, mesh_slotted(clutch, **COARSE)


def drawn_volumes(clutch):
    """Volume of every region by Pappus from the section's polygons, slots taken off their bodies [m^3]."""
    volumes = {}
    for name, polygons in clutch.section_polygons().items():
        volumes[name] = sum(swept(polygon) for polygon in polygons)
    cut = {"disc": 0.0, "rotor": 0.0}
    if clutch.disc_slots is not None:
        rim, slots = clutch.disc_radius, clutch.disc_slots
        cut["disc"] = slots.fraction * ring(rim - slots.depth, rim, clutch.disc_thickness)
    if clutch.rotor_slots is not None:
        bore, slots = clutch.bore_radius, clutch.rotor_slots
        length = clutch.rotor_length - clutch.ring_width
        cut["rotor"] = slots.fraction * ring(bore, bore + slots.depth, length)
    for body, volume in cut.items():
        volumes[body] -= volume
    if sum(cut.values()) > 0.0:
        volumes["slots"] = sum(cut.values())
    return volumes


def ring(r0, r1, length):
    return math.pi * (r1**2 - r0**2) * length


def swept(polygon):
    r, z = polygon.T
    following = np.roll(r, -1), np.roll(z, -1)
    cross = r * following[1] - following[0] * z
    return 2.0 * math.pi * float(((r + following[0]) * cross).sum()) / 6.0


@pytest.mark.parametrize("which", ["plain", "slotted"])
def test_regions_have_the_volumes_of_the_drawing(which, request):
    """Curved elements: what a chord would lose of a circle, h^2/(8 r^2), is gone up to the fourth power."""
    clutch, mesh = request.getfixturevalue(which)
    expected = drawn_volumes(clutch)
    assert set(mesh.regions) == {"air", *expected}
    for name, volume in expected.items():
        assert mesh.volume(name) == pytest.approx(volume, rel=1e-5), name
    ball = 4.0 / 3.0 * math.pi * clutch.air_radius**3
    assert sum(mesh.volume(name) for name in mesh.regions) == pytest.approx(ball, rel=1e-3)


def test_flat_elements_lose_what_chords_lose(slotted):
    """By first order a body is too small by the h^2/r^2 of its chords; curved elements win two orders of that."""
    clutch, curved = slotted
    flat = mesh_slotted(clutch, **COARSE, order=1)
    assert flat.second_order is None
    for region in ("coil", "disc"):
        exact = drawn_volumes(clutch)[region]
        chords = flat.volume(region) / exact - 1.0
        assert abs(chords) > 2e-5
        assert abs(curved.volume(region) / exact - 1.0) < 0.02 * abs(chords)


def test_half_a_pitch_lies_between_two_mirror_planes(slotted):
    clutch, mesh = slotted
    assert mesh.n_sectors == 24 and mesh.periodic is None
    assert mesh.sector_angle == pytest.approx(math.pi / 12)
    angle = np.arctan2(mesh.points[:, 1], mesh.points[:, 0])[np.hypot(*mesh.points[:, :2].T) > 1e-6]
    assert -1e-12 < angle.min() and angle.max() < mesh.sector_angle + 1e-12
    half_disc = 0.5 * math.pi * clutch.air_radius**2
    for side in ("low_side", "high_side"):
        a, b, c = mesh.points[mesh.boundaries[side]].transpose(1, 0, 2)
        # of the corners alone: the arc is a few chords here
        assert 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(half_disc, rel=3e-2)


@pytest.mark.parametrize("which", ["plain", "slotted"])
def test_the_named_boundaries_are_the_whole_outline_and_the_whole_skin_of_the_powder(which, request):
    _, mesh = request.getfixturevalue(which)
    _, sides = faces_of(mesh.tetrahedra)
    outline = {"low_side", "high_side", "outer"}
    assert sum(len(mesh.boundaries[name]) for name in outline) == np.count_nonzero(sides[:, 1] < 0)
    powder = np.isin(sides, mesh.regions["powder"]) & (sides >= 0)
    skin = np.count_nonzero((powder.sum(axis=1) == 1) & (sides[:, 1] >= 0))
    assert sum(len(faces) for name, faces in mesh.boundaries.items() if name not in outline) == skin


@pytest.mark.parametrize("which", ["plain", "slotted"])
def test_no_element_crosses_the_ends_of_the_coil_inside_its_outer_radius(which, request):
    """T0 jumps at z = +-coil_width/2 for r below the coil's outer radius, and bends at its two cylinders."""
    clutch, mesh = request.getfixturevalue(which)
    corners = mesh.points[mesh.tetrahedra]
    radius, z = np.hypot(corners[..., 0], corners[..., 1]), corners[..., 2]
    close, half = 1e-9, 0.5 * clutch.coil_width
    below = radius.max(axis=1) < clutch.coil_outer_radius + close
    for end in (-half, half):
        crosses = (z.min(axis=1) < end - close) & (z.max(axis=1) > end + close)
        assert not np.any(crosses & below)
    # every node of a ring's element, the middles of its edges included, lies within the ring
    nodes = mesh.points[mesh.second_order[mesh.regions["coil"]]]
    r = np.hypot(nodes[..., 0], nodes[..., 1])
    assert r.min() == pytest.approx(clutch.coil_inner_radius, rel=1e-9)
    assert r.max() == pytest.approx(clutch.coil_outer_radius, rel=1e-9)


def test_a_line_across_the_gap_meets_the_layers_that_were_asked_for():
    """Triangles of the section on radial lines under a pole: two of each row."""
    clutch = Clutch(**WIDE)
    for layers in (2, 4):
        mesh = mesh_slotted(clutch, gap_layers=layers, wedge=math.pi / 24)
        corners = mesh.points[mesh.boundaries["low_side"]]
        r, z = corners[..., 0], corners[..., 2]
        in_gap = (r.min(axis=1) > clutch.disc_radius - 1e-9) & (r.max(axis=1) < clutch.bore_radius + 1e-9)
        lines = np.linspace(6.1e-3, 11.9e-3, 20)[:, None]
        met = np.count_nonzero(in_gap & (z.min(axis=1) < lines) & (z.max(axis=1) > lines), axis=1)
        assert met.min() >= 2 * layers - 1
        assert met.mean() == pytest.approx(2 * layers, rel=0.25)


def test_a_whole_pitch_has_matching_sides():
    clutch = Clutch(**WIDE, disc_slots=DISC_SLOTS)
    mesh = mesh_slotted(clutch, **COARSE, periodic=True)
    assert mesh.n_sectors == 12 and mesh.periodic is not None
    slave, master = mesh.periodic.T
    for nodes, side in ((slave, "high_side"), (master, "low_side")):
        off_axis = np.unique(mesh.boundaries[side])
        off_axis = off_axis[np.hypot(*mesh.points[off_axis, :2].T) > 0.0]
        assert np.array_equal(np.sort(nodes), off_axis)
    # matching faces, so that the middles of their edges match as well
    partner = dict(zip(master.tolist(), slave.tolist(), strict=True))
    turned = {frozenset(partner.get(n, n) for n in face) for face in mesh.boundaries["low_side"].tolist()}
    assert turned == {frozenset(face) for face in mesh.boundaries["high_side"].tolist()}
    assert mesh.volume("slots") == pytest.approx(drawn_volumes(clutch)["slots"], rel=1e-5)


def test_turned_slots_need_the_whole_pitch_and_get_it():
    clutch = Clutch(**WIDE, disc_slots=DISC_SLOTS, rotor_slots=replace(ROTOR_SLOTS, angle=math.radians(2.0)))
    mesh = mesh_slotted(clutch, **COARSE)
    assert mesh.periodic is not None and mesh.n_sectors == 12
    assert mesh.volume("slots") == pytest.approx(drawn_volumes(clutch)["slots"], rel=1e-5)
    with pytest.raises(ValueError, match="mirror image"):
        mesh_slotted(clutch, **COARSE, periodic=False)


def test_slots_know_what_they_cut():
    slots = Slots(10, 0.25, 1e-3, angle=0.1)
    middle, half = 0.1 + 3 * slots.pitch, 0.125 * slots.pitch
    assert slots.cuts(middle) and slots.cuts(middle + 0.99 * half) and not slots.cuts(middle + 1.01 * half)
    assert slots.edges(middle - 2 * half, middle + 2 * half) == pytest.approx([middle - half, middle + half])
    assert slots.edges(middle - half, middle + half).size == 0  # a sector that starts at a side has no step there
    assert not slots.mirrored
    assert Slots(10, 0.25, 1e-3).mirrored and Slots(10, 0.25, 1e-3, angle=0.1 * math.pi).mirrored


@pytest.mark.parametrize(
    "body, changes, key, reason",
    [
        ("disc_slots", {"count": 1}, "count", "number of slots"),
        ("disc_slots", {"count": 501}, "count", "number of slots"),
        ("disc_slots", {"fraction": 1.0}, "fraction", "wider than the pitch"),
        ("disc_slots", {"fraction": 0.0}, "fraction", "no width"),
        ("disc_slots", {"depth": -1e-3}, "depth", "positive"),
        ("disc_slots", {"depth": 36.5e-3}, "depth", "shaft"),
        ("rotor_slots", {"depth": 6e-3}, "depth", "clearance"),
        ("rotor_slots", {"angle": math.nan}, "angle", "not an angle"),
    ],
)
def test_impossible_slots_are_refused_with_key_value_range_and_remedy(body, changes, key, reason):
    clutch = Clutch(**{body: replace(DISC_SLOTS if body == "disc_slots" else ROTOR_SLOTS, **changes)})
    (fault,) = clutch.faults()
    assert fault.what == f"{body}.{key}"
    assert reason in fault.message and fault.value and fault.allowed and fault.remedy
    with pytest.raises(GeometryError, match=body):
        mesh_slotted(clutch)


@pytest.mark.parametrize(
    "clutch, options, message",
    [
        (Clutch(disc_slots=Slots(12, 0.4, 5e-3), rotor_slots=Slots(7, 0.4, 3e-3)), {}, "common sector"),
        (Clutch(), {"wedge": 0.3}, "2 pi over a whole number"),
        (Clutch(), {"size_factor": 9.0}, "size_factor"),
        (Clutch(), {"order": 3}, "order"),
    ],
)
def test_what_cannot_be_meshed_is_said(clutch, options, message):
    with pytest.raises(ValueError, match=message):
        mesh_slotted(clutch, **options)


def test_a_clutch_says_whether_its_section_is_the_whole_truth():
    assert Clutch().axisymmetric
    assert not Clutch(disc_slots=DISC_SLOTS).axisymmetric
    assert not Clutch(rotor_slots=ROTOR_SLOTS).axisymmetric


def test_edges_of_the_second_order_nodes_are_where_the_corners_say(slotted):
    """An edge within a half-plane is straight, 8 of a prism's 18: the order of the ten nodes is the right one."""
    _, mesh = slotted
    middle = mesh.points[mesh.second_order[:, 4:]]
    ends = mesh.points[mesh.second_order[:, EDGES]]
    length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    offset = np.linalg.norm(middle - ends.mean(axis=2), axis=2) / length
    assert offset.max() < 0.3
    angle = np.arctan2(ends[..., 1], ends[..., 0])
    on_axis = np.hypot(ends[..., 0], ends[..., 1]).min(axis=2) == 0.0
    within = on_axis | (np.abs(np.diff(angle, axis=2)[..., 0]) < 1e-9)
    outer = np.linalg.norm(ends, axis=3).min(axis=2) > 0.999 * np.linalg.norm(mesh.points, axis=1).max()
    assert np.all(offset[within & ~outer] < 1e-9)
    assert np.all(offset[~within] > 1e-9)
    assert np.mean(within) == pytest.approx(8 / 18, abs=0.02)


def test_layers_are_thin_beside_the_slots_and_grow_away_from_them():
    """Every side of a slot is an angle of the mesh; neighbouring layers differ by less than a factor of 2.5."""
    clutch = Clutch(disc_slots=Slots(8, 0.3, 5e-3))
    mesh = mesh_slotted(clutch, size_factor=2.0, gap_layers=2)
    corners = mesh.points[: mesh.n_corners]
    angle = np.unique(np.round(np.arctan2(corners[:, 1], corners[:, 0])[np.hypot(*corners[:, :2].T) > 0.0], 9))
    side = clutch.disc_slots.edges(0.0, mesh.sector_angle)
    assert np.abs(angle[:, None] - side).min(axis=0).max() < 1e-8
    steps = np.diff(angle)
    assert np.all(steps[1:] / steps[:-1] < 2.5) and np.all(steps[:-1] / steps[1:] < 2.5)
    beside = np.searchsorted(angle, side[0] - 1e-8)
    assert steps[beside] == steps[:].min() or steps[beside - 1] == steps.min()
    assert steps.max() > 3.0 * steps.min()
