"""The parametric clutch: closed forms of its section, its walls, and what is refused with a reason."""

from dataclasses import replace

import numpy as np
import pytest

from geometry import Clutch, GeometryError, mesh_clutch

THIN_DISC = Clutch(
    disc_thickness=6e-3,
    seal_radius=20e-3,
    ring_width=7e-3,
    coil_width=8e-3,
    magnetic=frozenset({"disc", "rotor", "cover"}),
    coil_radius=54e-3,
)


def polygon_area(corners):
    r, z = corners.T
    return 0.5 * np.sum(r * np.roll(z, -1) - z * np.roll(r, -1))


def test_defaults_are_the_twelve_newton_metre_class_without_faults():
    clutch = Clutch()
    assert clutch.faults(0.2e-3) == []
    assert clutch.mean_gap_radius == pytest.approx(45e-3)
    assert clutch.pole_length == pytest.approx(12e-3)
    assert clutch.housing_length == pytest.approx(40e-3)
    assert clutch.coil_area == pytest.approx(196e-6)
    assert clutch.coil_mean_radius == pytest.approx(58.8e-3)


def test_drum_and_thin_disc_are_one_family():
    assert THIN_DISC.faults() == []
    assert {wall.name for wall in THIN_DISC.walls()} == {wall.name for wall in Clutch().walls()}


@pytest.mark.parametrize("clutch", [Clutch(), THIN_DISC, Clutch(ring_width=0.0)])
def test_fill_boxes_fill_the_powder_chamber(clutch):
    boxes = clutch.fill_boxes()
    assert set(boxes) == {"rim", "face_left", "face_right"}
    (chamber,) = clutch.section_polygons()["powder"]
    area = sum((box.r1 - box.r0) * (box.z1 - box.z0) for box in boxes.values())
    assert polygon_area(chamber) == pytest.approx(area, rel=1e-12)
    hollow = np.pi * (clutch.bore_radius**2 - clutch.seal_radius**2) * clutch.cavity_length
    disc = np.pi * (clutch.disc_radius**2 - clutch.seal_radius**2) * clutch.disc_thickness
    assert sum(box.volume() for box in boxes.values()) == pytest.approx(hollow - disc, rel=1e-12)


def test_section_polygons_run_counter_clockwise_and_the_gap_midline_lies_in_the_gap():
    clutch = Clutch()
    assert all(polygon_area(p) > 0.0 for polygons in clutch.section_polygons().values() for p in polygons)
    assert np.all(clutch.gap_midline()[:, 0] == clutch.mean_gap_radius)
    assert np.ptp(clutch.gap_midline()[:, 1]) == pytest.approx(clutch.disc_thickness)
    assert clutch.face_midline(5).shape == (5, 2)


@pytest.mark.parametrize("clutch", [Clutch(), THIN_DISC, Clutch(ring_width=0.0)])
def test_walls_enclose_the_powder_chamber_and_steel_faces_are_marked(clutch):
    walls = {wall.name: wall for wall in clutch.walls()}
    (chamber,) = clutch.section_polygons()["powder"]
    perimeter = np.linalg.norm(chamber - np.roll(chamber, 1, axis=0), axis=1).sum()
    assert sum(wall.length for wall in walls.values()) == pytest.approx(perimeter, rel=1e-12)
    bores = [wall for name, wall in walls.items() if name.startswith("bore")]
    assert sum(wall.length for wall in bores) == pytest.approx(clutch.cavity_length)
    assert sum(wall.length for wall in bores if not wall.magnetic) == pytest.approx(clutch.ring_width)
    assert all(wall.magnetic for wall in walls.values() if wall.body == "disc")
    assert walls["cover_left"].magnetic is walls["cover_right"].magnetic is clutch.cover_magnetic
    assert not walls["seal_rim_left"].magnetic


def test_each_edge_circle_of_the_disc_is_owned_exactly_once():
    clutch = Clutch()
    owned = [
        vertex
        for wall in clutch.walls()
        if wall.body == "disc"
        for vertex, neighbour in ((wall.start, wall.start_neighbour), (wall.end, wall.end_neighbour))
        if neighbour is not None
    ]
    assert sorted(owned) == [(clutch.disc_radius, -15e-3), (clutch.disc_radius, 15e-3)]


@pytest.mark.parametrize(
    "changes, key, reason",
    [
        ({"gap": 0.0}, "gap", "positive"),
        ({"yoke": -1e-3}, "yoke", "positive"),
        ({"disc_radius": float("nan")}, "disc_radius", "positive"),
        ({"ring_width": -1e-3}, "ring_width", "no ring"),
        ({"air_factor": 1.0}, "air_factor", "1.5 to 20"),
        ({"gap": 0.1e-3}, "gap", "grain"),
        ({"face_gap": 0.1e-3}, "face_gap", "grain"),
        ({"seal_radius": 44.4e-3}, "seal_radius", "grain"),
        ({"seal_radius": 44.5e-3}, "seal_radius", "covers the whole face"),
        ({"seal_radius": 7e-3}, "seal_radius", "inside the shaft"),
        ({"shaft_radius": 50e-3, "seal_radius": 41e-3}, "shaft_radius", "as thick as the disc"),
        ({"ring_width": 30e-3}, "ring_width", "no pole"),
        ({"coil_width": 40e-3}, "coil_width", "side walls"),
        ({"coil_width": 40e-3, "housing_width": 60e-3}, "coil_width", "face no rotor"),
        ({"housing_width": 5e-3, "coil_width": 4e-3}, "housing_width", "face no steel"),
        ({"coil_radius": 40e-3}, "coil_radius", "the disc"),
        ({"coil_radius": 45e-3}, "coil_radius", "powder cavity"),
        ({"coil_radius": 50e-3}, "coil_radius", "rotor's shell"),
        ({"coil_radius": 51.6e-3}, "coil_radius", "running clearance"),
        ({"disc_thickness": 30.0}, "gap", "units"),
    ],
)
def test_bad_sizes_are_refused_with_key_value_range_and_remedy(changes, key, reason):
    faults = {fault.what: fault for fault in Clutch(**changes).faults(0.2e-3)}
    fault = faults[key]
    assert reason in fault.message
    assert fault.value and fault.allowed and fault.remedy


def test_all_faults_are_reported_at_once_and_before_meshing():
    broken = replace(Clutch(), gap=-1e-3, coil_width=50e-3, seal_radius=5e-3)
    assert {fault.what for fault in broken.faults()} == {"gap", "coil_width", "seal_radius"}
    with pytest.raises(GeometryError, match=r"(?s)`gap`.*`seal_radius`.*`coil_width`"):
        mesh_clutch(broken)


def test_a_fault_is_reported_with_the_callers_keys():
    fault = next(fault for fault in Clutch(gap=0.1e-3).faults(0.2e-3) if fault.what == "gap")
    assert "raise <gap> or lower <grain_diameter>" in fault.message_with(lambda name: f"<{name}>")


def test_a_coil_radius_equal_to_the_bore_but_for_rounding_is_the_bore():
    clutch = Clutch(coil_radius=51.8e-3 * (1.0 - 1e-12))
    assert clutch.faults() == []
    assert clutch.coil_inner_radius == clutch.housing_bore


@pytest.mark.parametrize("region", ["rim", "faces"])
def test_a_steady_shear_goes_from_the_disc_to_the_rotor_and_has_the_curl_of_its_velocity(region):
    clutch = Clutch()
    gap = clutch.sheared_gap(region)
    (*_, box) = clutch.boxes_to_fill(region)
    rng = np.random.default_rng(3)
    r, angle, z = rng.uniform([box.r0, 0.0, box.z0], [box.r1, 2.0 * np.pi, box.z1], (50, 3)).T
    sides = np.where(rng.random(50) < 0.5, -1.0, 1.0)
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle), z * sides])

    def velocity(at):
        omega, _ = gap.speed(at, 3.0, 10.0)
        return np.column_stack([-omega * at[:, 1], omega * at[:, 0], 0.0 * omega])

    h = 1e-8
    dv = [(velocity(points + h * axis) - velocity(points - h * axis)) / (2.0 * h) for axis in np.eye(3)]
    curl = np.column_stack([dv[j][:, k] - dv[k][:, j] for j, k in ((1, 2), (2, 0), (0, 1))])
    omega, given = gap.speed(points, 3.0, 10.0)
    assert given == pytest.approx(curl, rel=1e-5, abs=1e-3)
    assert np.all((omega >= 3.0) & (omega <= 10.0))
    middle = np.array([[clutch.disc_radius + 0.5 * clutch.gap, 0.0, 0.0]])
    if region == "faces":
        middle = np.array([[0.0, 0.7 * clutch.disc_radius, -0.5 * clutch.disc_thickness - 0.5 * clutch.face_gap]])
    assert gap.speed(middle, 3.0, 10.0)[0] == pytest.approx([6.5])


@pytest.mark.parametrize("region", ["rim", "poles", "faces", "cavity"])
def test_the_sheared_parts_of_a_region_are_disjoint_parts_of_it_between_the_shafts(region):
    """Of powder between the pole faces, 2 pi R g L of each face; once the whole rim was counted for each."""
    clutch = Clutch()
    filled = clutch.boxes_to_fill(region)
    parts = [box for box, _ in clutch.gap_parts(filled)]
    for part, box in zip(parts, filled, strict=True):
        assert box.r0 <= part.r0 < part.r1 <= box.r1 and box.z0 <= part.z0 < part.z1 <= box.z1
    if region == "poles":
        volume = sum(part.volume() for part in parts)
        assert volume == pytest.approx(2.0 * 2.0 * np.pi * clutch.mean_gap_radius * clutch.gap * clutch.pole_length)
