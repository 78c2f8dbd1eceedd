"""Packings from files: what is written comes back, units count, what is wrong is reported with its place."""

import io
import math

import numpy as np
import pytest
import pyvista

from geometry.box import Box
from geometry.table_file import FileFault
from particles import CyclicSector, PackingError
from particles.packing.file_packing import OVERLAP_LIMIT, read_packing
from particles.packing.packing import require_fit
from particles.packing.space import Space

BOX = Box((0.02, 0.02, 0.02))
SPACE = Space.of(BOX, BOX.walls())
CSV = "x [mm], y [mm], z [mm], diameter [mm], vx [mm/s], vy [mm/s], vz [mm/s]\n-2, 0, 5, 2, 0, 0, -100\n2,0,5,3,0,0,0\n"


def fitted(space, path, radius=None, limit=OVERLAP_LIMIT):
    packing = read_packing(path, radius=radius)
    require_fit(packing, space, limit)
    return packing


@pytest.mark.parametrize(
    ("name", "text"),
    [("start.csv", CSV), ("start.csv", CSV.replace(",", ";").replace("5", "5,0")),
     ("start.txt", CSV.replace(", ", "\t").replace(",", "\t")), ("start.tab", "sep=;\n" + CSV.replace(",", ";"))],
)  # fmt: skip
def test_tables_with_units(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    packing = fitted(SPACE, path)
    assert packing.position == pytest.approx(np.array([[-2e-3, 0, 5e-3], [2e-3, 0, 5e-3]]))
    assert packing.radius == pytest.approx([1e-3, 1.5e-3])
    assert packing.velocity[0] == pytest.approx([0, 0, -0.1]) and packing.angular_velocity is None


def test_columns_and_arrays_that_are_not_used_are_named(tmp_path):
    path = tmp_path / "start.csv"
    path.write_text("id, x [mm], y [mm], z [mm], mass [g], diameter [mm]\n1, 1, 2, 3, 4, 5\n")
    with pytest.warns(UserWarning, match="start.csv: not used: id, mass"):
        assert read_packing(path).position.tolist() == [[1e-3, 2e-3, 3e-3]]
    path.write_text("x [m], y [m], z [m], fx [N], fy [N], fz [N], t_x [N m], t_y [N m], t_z [N m]\n1, 2, 3" + 6 * ", 0")
    with pytest.warns(UserWarning, match="start.csv: not used: fx, fy, fz, t_x, t_y, t_z"):
        assert read_packing(path, radius=1.0).position.tolist() == [[1.0, 2.0, 3.0]]
    path = _npz(tmp_path, position=np.zeros((1, 3)), radius=np.ones(1), v=np.ones((1, 3)))
    with pytest.warns(UserWarning, match="start.npz: not used: v"):
        assert read_packing(path).velocity is None


@pytest.mark.parametrize("suffix", [".npz", ".vtp"])
def test_arrays_come_back(tmp_path, suffix):
    rng = np.random.default_rng(1)
    x = np.array([[i, j, k] for i in (-6, 0, 6) for j in (-6, 0, 6) for k in (3, 9, 15)]) * 1e-3
    r, v = rng.uniform(1e-3, 2.5e-3, 27), rng.normal(size=(27, 3))
    path = tmp_path / f"start{suffix}"
    if suffix == ".npz":
        np.savez(path, position=x, diameter=2.0 * r, velocity=v)
    else:
        cloud = pyvista.PolyData(x)
        cloud.point_data["radius"], cloud.point_data["velocity"] = r, v
        cloud.save(path)
    packing = fitted(SPACE, path)
    for found, written in ((packing.position, x), (packing.radius, r), (packing.velocity, v)):
        assert np.array_equal(found, written)


def _npz(tmp_path, **arrays):
    path = tmp_path / "start.npz"
    np.savez(path, **arrays)
    return path


def test_faults_name_grain_and_place(tmp_path):
    two = np.array([[0.0, 0.0, 5e-3], [1.9e-3, 0.0, 5e-3]])
    path = _npz(tmp_path, position=two)
    with pytest.raises(PackingError, match=r"grain 0 at .* \(0, 0, 5\) mm overlaps a neighbour by 5 % .*limit|allowed"):
        fitted(SPACE, path, radius=1e-3, limit=0.04)
    assert fitted(SPACE, path, radius=1e-3, limit=0.051).count == 2
    path = _npz(tmp_path, position=two - np.array([0.0, 0.0, 4.3e-3]), radius=np.full(2, 0.8e-3))
    with pytest.raises(PackingError, match=r"grain 0 at .* overlaps a wall by 6.25 % of the diameter \(allowed: 5 %\)"):
        fitted(SPACE, path)
    path = _npz(tmp_path, position=1e3 * two, radius=np.full(2, 0.5e-3))  # millimetres taken for metres
    with pytest.raises(PackingError, match=r"outside the walls or in a solid \(2 of 2 grains do\); check .*unit"):
        fitted(SPACE, path)


def test_grains_beside_the_sector_are_refused(tmp_path):
    path = _npz(tmp_path, position=np.array([[5e-3, -1e-3, 5e-3]]), radius=np.array([1e-4]))
    with pytest.raises(PackingError, match="outside the sector"):
        fitted(Space.of(BOX, BOX.walls(), CyclicSector(math.radians(90.0))), path)


@pytest.mark.parametrize(
    "arrays, radius, words",
    [
        ({"radius": np.ones(1)}, None, "has no positions; it has radius"),
        ({"position": np.zeros((1, 3))}, None, "neither radius nor diameter"),
        ({"position": np.zeros((1, 3)), "radius": np.ones(1)}, 1.0, "keep one of the two"),
        ({"position": np.zeros((1, 2)), "radius": np.ones(1)}, None, r"position has shape \(1, 2\)"),
        ({"position": np.zeros((2, 3)), "radius": np.ones(1)}, None, "2 positions but 1 of radius"),
        ({"position": np.array([[0, np.nan, 0]]), "radius": np.ones(1)}, None, "position of grain 0 is not finite"),
        ({"position": np.zeros((1, 3)), "radius": -np.ones(1)}, None, "radius of grain 0 is -1000 mm"),
        ({"position": np.zeros((0, 3)), "radius": np.zeros(0)}, None, "holds no grain"),
    ],
)
def test_wrong_arrays_are_reported(tmp_path, arrays, radius, words):
    with pytest.raises(ValueError, match=words):
        read_packing(_npz(tmp_path, **arrays), radius=radius)


LONE_ARRAY = io.BytesIO()
np.save(LONE_ARRAY, np.zeros((2, 3)))


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("a.csv", "x [m], y [m]\n1, 2\n", "only x, y; give all three"),
        ("a.csv", "x [m], y [m], z [m]\n", "has no table"),
        ("a.csv", "x [m], y [m], z [m]\n1, 2\n", "line 2 has 2 entries for 3 columns"),
        ("a.csv", "x [m], y [m], z\n1, 2, 3\n", "line 1: the column 'z' has no unit; .* e.g. z .m., z .cm."),
        ("a.csv", "x [m], y [m], z [kg]\n1, 2, 3\n", "'z' is in 'kg', which is unknown or of another quantity"),
        ("a.csv", "x [m], y [m], z [m], vx [mm], vy [mm], vz [mm]\n1, 2, 3, 4, 5, 6\n", "'vx' is in 'mm'.* m/s"),
        ("a.csv", "x [m], y [m], z [m], v_x [m/s], v_y [m/s], v_z [m/s]\n1, 2, 3, 4, 5, 6\n", "column 'v_x', which"),
        ("a.csv", "x [m], y [m], z [m], omega_x, omega_y, omega_z\n1, 2, 3, 4, 5, 6\n", "column 'omega_x', which"),
        ("a.csv", "x [m], y [m], z [m], size [mm]\n1, 2, 3, 4\n", "column 'size', which may be"),
        ("a.csv", "x [m], y [m], z [m], radius [mm], diameter [mm]\n1, 2, 3, 4, 8\n", "both radius and diameter"),
        ("a.dat", "", "suffix '.dat'"),
        ("a.npz", "text", "not an npz archive"),
        ("a.npz", b"", "not an npz archive"),
        ("a.npz", b"\x89HDF\r\n\x1a\n" + bytes(90), "not an npz archive"),
        ("a.npz", b"PK\x03\x04 a zip that was cut off", "not an npz archive"),
        ("a.npz", LONE_ARRAY.getvalue(), "not an npz archive .*one array without a name"),
        ("a.vtp", "text", "not a VTK file in XML"),
        ("a.vtp", b"\x89HDF\r\n\x1a\n" + bytes(90), "not a VTK file in XML"),
        ("a.vtp", '<VTKFile type="PolyData"><PolyData><Piece NumberOfPoints="3"><Points>', "cannot be read as VTK"),
        ("a.csv", b"\x89HDF\r\n\x1a\n" + bytes(90), "not text in UTF-8"),
    ],
)
def test_wrong_files_are_reported(tmp_path, name, text, words):
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ValueError, match=words):
        read_packing(tmp_path / name)
    with pytest.raises(FileFault, match="does not exist"):
        read_packing(tmp_path / "none.csv")
