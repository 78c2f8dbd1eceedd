"""[particles]: sizes and packings of a scene, its derived numbers, and the faults of wrong combinations."""

import math
import tomllib

import numpy as np
import pytest

from emclutch.scene.case import case_from, load_case
from emclutch.scene.errors import SceneError
from emclutch.scene.fill import diameters_of, fill_of
from emclutch.simulation.initial_packing import packed
from particles import CyclicSector

BOX = {
    "scene": {"title": "box", "seed": 5},
    "geometry": {"kind": "box", "size": ["10 mm", "10 mm", "20 mm"]},
    "particles": {"solid_fraction": 0.2},
    "effects": {"gravity": {}},
    "time": {"end": 1},
}
CELL = {
    "geometry": {"kind": "shear_cell", "inner_radius": "20 mm", "outer_radius": "24 mm", "height": "8 mm"},
}
UNIFORM = {"kind": "uniform", "min": "0.8 mm", "max": "1.2 mm"}
SIZES = {
    "uniform": (UNIFORM, 1.0e-3, (0.8e-3, 1.2e-3)),
    "normal": ({"kind": "normal", "mean": "1 mm", "deviation": "0.1 mm"}, 1.0e-3, (0.7e-3, 1.3e-3)),
    "log_normal": ({"kind": "log_normal", "median": "1 mm", "spread": 1.2, "min": "0.5 mm", "max": "2 mm"},
                   1e-3 * math.exp(0.5 * math.log(1.2) ** 2), (0.5e-3, 2e-3)),
    "percentiles": ({"kind": "percentiles", "d10": "0.8 mm", "d50": "1 mm", "d90": "1.25 mm", "by": "number"},
                    0.22725e-3 / math.log(1.25), (0.64e-3, 1.5625e-3)),
    "list": ({"kind": "list", "diameters": ["1 mm", "2 mm"], "shares": [3, 1]}, 1.25e-3, (1e-3, 2e-3)),
}  # fmt: skip


def _case(particles, **sections):
    scene = {name: dict(section) for name, section in (BOX | sections).items()}
    scene["particles"] = particles
    return case_from(scene)


def _faults(particles):
    with pytest.raises(SceneError) as caught:
        _case(particles)
    return {fault.key: fault.message for fault in caught.value.faults}


@pytest.mark.parametrize("sizes, mean, limits", SIZES.values(), ids=SIZES.keys())
def test_sizes_are_read_and_written(sizes, mean, limits):
    case = _case({"sizes": sizes, "solid_fraction": 0.2})
    particles = case.scene.particles
    sizes = particles.distribution()
    assert sizes.mean == pytest.approx(mean, rel=1e-3) and particles.mean_diameter == sizes.mean_by_volume
    assert (particles.smallest_diameter, particles.largest_diameter) == pytest.approx(limits)
    assert case_from(tomllib.loads(case.toml())).scene == case.scene


def test_a_powder_by_name_is_that_of_its_values():
    """Of pure iron, mu_0 Ms = 2.145 T; a value given alike is no conflict, as in a resolved scene."""
    case = _case({"diameter": "1 mm", "count": 10, "material": "Carbonyl iron", "density": 7870})
    found = case.scene.particles
    assert 4e-7 * math.pi * found.saturation == pytest.approx(2.145, abs=1e-3)
    assert (found.density, found.susceptibility) == (7870.0, 999.0)
    assert case_from(tomllib.loads(case.toml())).scene == case.scene
    values = {"density": 7870, "susceptibility": 999, "saturation": found.saturation}
    unnamed = _case({"diameter": "1 mm", "count": 10} | values).scene.particles
    assert unnamed == found.model_copy(update={"material": None})


def test_equal_grains_are_sizes_too():
    particles = _case({"diameter": "1 mm", "count": 10}).scene.particles
    assert particles.mean_diameter == particles.smallest_diameter == particles.largest_diameter == 1e-3
    assert particles.grain_volume == pytest.approx(math.pi / 6.0 * 1e-9)
    assert np.array_equal(diameters_of(particles, 10, 1), np.full(10, 1e-3))


@pytest.mark.parametrize("amount", [{"mass": "3 g"}, {"solid_fraction": 0.2}, {"count": 300}])
@pytest.mark.parametrize("sector", [None, "30 deg"])
def test_the_amount_follows_from_the_drawn_grains(amount, sector):
    case = _case({"sizes": UNIFORM, **amount} | ({} if sector is None else {"sector": sector}), **CELL,
                 effects={"gravity": {"direction": [0, 0, -1]}})  # fmt: skip
    particles, shape = case.scene.particles, case.scene.shape()
    fill = fill_of(shape, particles, 5)
    n = particles.n_sectors
    drawn = math.pi / 6.0 * np.sum(diameters_of(particles, fill.count, 5) ** 3)
    half = 0.5 * math.pi / 6.0 * particles.largest_diameter**3
    assert fill.mass == pytest.approx(n * drawn * particles.density, rel=1e-12)
    assert fill.solid_fraction == pytest.approx(n * drawn / fill.volume, rel=1e-12)
    if "mass" in amount:
        assert abs(fill.mass / particles.density / n - 3e-3 / 7700.0 / n) <= half
    elif "count" in amount:
        assert fill.count == 300
    else:
        assert abs(fill.solid_fraction - 0.2) <= n * half / fill.volume
    expected = fill_of(shape, particles)  # by mean volumes: within five standard errors of the sum
    assert expected.count == pytest.approx(fill.count, rel=5.0 * 0.35 / math.sqrt(fill.count))


@pytest.mark.parametrize("packing", ["random", "grow", "lattice", "pour"])
def test_every_packing_is_made_from_its_scene(packing):
    case = _case({"sizes": UNIFORM, "solid_fraction": 0.2, "packing": packing})
    scene, shape = case.scene, case.scene.shape()
    fill = fill_of(shape, scene.particles, scene.scene.seed)
    made, again = (packed(scene, shape, shape.walls(), fill.count, None) for _ in range(2))
    assert made.count == fill.count and np.array_equal(made.position, again.position)
    assert 4.0 / 3.0 * math.pi * np.sum(made.radius**3) == pytest.approx(fill.mass / scene.particles.density)


def test_a_packed_powder_has_its_makers_percentiles():
    """By mass, of the grains packed, within five standard errors of a share; the fill is reached to half a grain."""
    sizes = {"kind": "percentiles", "d10": "0.25 mm", "d50": "0.4 mm", "d90": "0.6 mm"}
    case = _case({"sizes": sizes, "solid_fraction": 0.4}, geometry={"kind": "box", "size": ["6 mm", "6 mm", "8 mm"]})
    scene, shape = case.scene, case.scene.shape()
    fill = fill_of(shape, scene.particles, scene.scene.seed)
    made = packed(scene, shape, shape.walls(), fill.count, None)
    d, mass = 2.0 * made.radius, made.radius**3
    half_grain = 0.5 * math.pi / 6.0 * scene.particles.largest_diameter**3
    assert abs(math.pi / 6.0 * np.sum(d**3) - 0.4 * 288e-9) <= half_grain
    for share, diameter in ((0.1, 0.25e-3), (0.5, 0.4e-3), (0.9, 0.6e-3)):
        finer = d < diameter
        error = math.sqrt(np.sum((mass * (finer - share)) ** 2)) / mass.sum()
        assert error < 0.02
        assert abs(mass[finer].sum() / mass.sum() - share) < 5.0 * error


def test_a_sector_is_packed():
    case = _case({"sizes": UNIFORM, "solid_fraction": 0.3, "sector": "30 deg"}, **CELL,
                 effects={"gravity": {"direction": [0, 0, -1]}})  # fmt: skip
    scene, shape = case.scene, case.scene.shape()
    fill = fill_of(shape, scene.particles, scene.scene.seed)
    sector = CyclicSector(scene.particles.sector)
    made = packed(scene, shape.boxes_to_fill("cavity"), shape.walls(), fill.count, sector)
    assert not sector.wraps(made.position).any() and len(np.unique(made.radius)) == fill.count


def test_grains_from_a_file_beside_the_scene(tmp_path):
    (tmp_path / "bed.csv").write_text("x [mm], y [mm], z [mm], diameter [mm]\n0, 0, 5, 1\n2, 0, 5, 2\n")
    (tmp_path / "scene.toml").write_text(
        "scene.title = 'from a file'\ngeometry = { kind = 'box', size = ['10 mm', '10 mm', '20 mm'] }\n"
        "particles = { packing = 'file', packing_file = 'bed.csv' }\neffects.gravity = {}\ntime.end = 1\n"
    )
    scene = load_case(tmp_path / "scene.toml").scene
    fill = fill_of(scene.shape(), scene.particles)
    assert fill.count == 2 and fill.mass == pytest.approx(7700.0 * math.pi / 6.0 * 9e-9)
    assert scene.particles.largest_diameter == pytest.approx(2e-3)
    assert packed(scene, scene.shape(), scene.shape().walls(), 2, None).radius == pytest.approx([0.5e-3, 1e-3])


def test_pour_settles_and_others_when_asked():
    assert _case({"diameter": "1 mm", "count": 10, "packing": "pour"}).scene.particles.settles
    assert not _case({"diameter": "1 mm", "count": 10}).scene.particles.settles
    assert _case({"diameter": "1 mm", "count": 10, "settle": True}).scene.particles.settles


def test_what_fits_depends_on_packing_and_sizes():
    """Random 0.60; lattices pi/6 and pi/sqrt 18 (equal grains); grown 0.634, more with a spread of sizes."""
    equal = {"diameter": "1 mm", "count": 10}
    for more, most in (({}, 0.60), ({"packing": "lattice"}, 0.7405), ({"packing": "lattice", "lattice": "sc"}, 0.5236),
                       ({"packing": "grow"}, 0.634)):  # fmt: skip
        assert _case(equal | more).scene.particles.largest_solid_fraction == pytest.approx(most, abs=5e-5)
    spread = _case({"sizes": UNIFORM, "count": 10, "packing": "grow"}).scene.particles
    assert spread.largest_solid_fraction == pytest.approx(0.634 + 0.0658 * 0.4 / math.sqrt(12.0), abs=1e-6)


EQUAL = {"diameter": "1 mm", "count": 10}


@pytest.mark.parametrize(
    "particles, key, words",
    [
        ({"count": 10}, "particles.diameter", "is missing; a length is needed"),
        (EQUAL | {"sizes": UNIFORM}, "particles.sizes", "conflicts with diameter"),
        ({"count": 10, "sizes": {"kind": "uniform", "min": "2 mm", "max": "1 mm"}}, "particles.sizes.min",
         "is not below max = 1 mm"),
        ({"count": 10, "sizes": {"kind": "uniform", "min": "2 mm"}}, "particles.sizes.max", "a length is needed"),
        ({"count": 10, "sizes": {"kind": "weibull"}}, "particles.sizes.kind", "available: uniform, normal"),
        ({"count": 10, "sizes": {"kind": "normal", "mean": "1 mm", "deviation": "0.5 mm"}}, "particles.sizes.min",
         "three deviations below mean is -0.5 mm"),
        ({"count": 10, "sizes": {"kind": "log_normal", "median": "1 mm", "spread": 1.2, "min": "1.1 mm"}},
         "particles.sizes.median", "is not between the limits 1.1 and"),
        ({"count": 10, "sizes": {"kind": "list", "diameters": ["1 mm", "2 mm"], "shares": [1]}},
         "particles.sizes.shares", "has 1 entries, but diameters 2"),
        ({"count": 10, "sizes": {"kind": "percentiles", "d10": "60 um", "d50": "45 um", "d90": "90 um"}},
         "particles.sizes.d50", "is not above d10 = 0.06 mm; percentiles ascend"),
        ({"count": 10, "sizes": {"kind": "percentiles", "d10": "45 um", "d50": "60 um", "d90": "90 um",
                                  "max": "90 um"}},
         "particles.sizes.max", "is not above d90 = 0.09 mm"),
        ({"count": 10, "sizes": {"kind": "percentiles", "d10": "45 um", "d50": "60 um"}}, "particles.sizes.d90",
         "a length is needed"),
        ({"count": 10, "sizes": {"kind": "percentiles", "d10": "45 um", "d50": "60 um", "d90": "1 mm", "by": "sieve"}},
         "particles.sizes.by", "available: mass, number"),
        ({"count": 10, "sizes": {"kind": "file", "file": "no.csv"}}, "particles.sizes.file", "No such file"),
        ({"count": 10, "sizes": {"kind": "list", "diameters": ["60 um", "90 um", "120 um"], "shares": [5, 75, 100]}},
         "particles.sizes.shares", "are they cumulative"),
        (EQUAL | {"packing": "file"}, "particles.count", "says how many grains"),
        ({"diameter": "1 mm", "packing": "file"}, "particles.packing_file", "is missing"),
        ({"diameter": "1 mm", "packing": "file", "packing_file": "no.csv"}, "particles.packing_file", "does not exist"),
        (EQUAL | {"packing_file": "bed.csv"}, "particles.packing_file", "not used by packing = 'random'"),
        (EQUAL | {"noise": 0.5}, "particles.noise", "take packing = 'lattice'"),
        (EQUAL | {"packing": "sieve"}, "particles.packing", "available: random, grow, lattice, pour, file"),
        (EQUAL | {"material": "carbonyl"}, "particles.material", "available: carbonyl_iron, stainless_430; or"),
        (EQUAL | {"material": "stainless_430", "susceptibility": 100}, "particles.susceptibility",
         "conflicts with material = 'stainless_430', which says 273; remove one of the two"),
        (EQUAL | {"settle_kinetic": 0.5}, "particles.settle_kinetic", "out of range"),
        (EQUAL | {"initial_velocity": "sheared"}, "particles.initial_velocity", "no gap between two shafts"),
        (EQUAL | {"initial_velocity": "sheared", "settle": True}, "particles.initial_velocity", "come to rest"),
    ],
)  # fmt: skip
def test_wrong_combinations_are_reported(particles, key, words):
    faults = _faults(particles)
    assert key in faults and words in faults[key]


def test_diameters_in_a_file_need_their_unit(tmp_path):
    particles = {"count": 10, "sizes": {"kind": "file", "file": str(tmp_path / "sieve.csv")}}
    (tmp_path / "sieve.csv").write_text("# of a sieve\ndiameter, mass [%]\n1, 40\n1.2, 60\n")
    assert "the column 'diameter' has no unit" in _faults(particles)["particles.sizes.file"]
    (tmp_path / "sieve.csv").write_text("# of a sieve\ndiameter [mm], mass [%]\n1, 40\n1.2, 60\n")
    assert _case(particles).scene.particles.largest_diameter == pytest.approx(1.2e-3)
