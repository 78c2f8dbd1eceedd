"""The table of two spheres: interpolation, its limits, and where tables are kept."""

import itertools
import warnings

import numpy as np
import pytest

from field import FroehlichLaw, GrainLaw, LangevinLaw, LinearLaw, ThesisLaw
from field.spheres import pair_table as module
from field.spheres.neck_estimate import neck_potential, two_zone_force
from field.spheres.pair_table import FIELDS, GAPS, PairTable, pair_table
from field.spheres.table_files import cache_folder, law_digest, read_table

IRON = GrainLaw(999.0, 1.7e6)


@pytest.fixture(scope="module")
def iron():
    return pair_table(IRON, cache="no folder is needed for a shipped table")


def dipoles(M, g):
    return np.pi / 6.0 * M**2 * (2.0 / (2.0 + g)) ** 4


def test_nodes_are_met(iron):
    g, h = iron.gap[:, None], iron.field
    assert np.allclose(iron.force_of(g, h), iron.force, rtol=1e-12)
    assert np.allclose(iron.moment_of(g, h), iron.moment, rtol=1e-12)
    assert iron.force.shape == (GAPS.size, FIELDS.size) and iron.Ms == 1.7e6
    assert "shipped" in iron.source and len(iron.digest) == 64


def test_below_the_lowest_field_all_is_linear(iron):
    g, low = np.array([1e-3, 0.1, 0.9]), iron.field[0]
    for f in (0.0, 1e-9, 0.3):
        assert np.allclose(iron.force_of(g, f * low), f**2 * iron.force_of(g, low), rtol=1e-12)
        assert np.allclose(iron.moment_of(g, f * low), f * iron.moment_of(g, low), rtol=1e-12)


def test_beyond_the_highest_field_the_spheres_saturate(iron):
    g, high = np.array([1e-3, 0.1, 1.0]), iron.field[-1]
    for function in (iron.force_of, iron.moment_of):
        assert np.allclose(function(g, 1.0001 * high), function(g, high), rtol=1e-3)
    assert np.allclose(iron.force_of(g, 1e4), dipoles(1.0, g), rtol=1e-4)
    assert np.allclose(iron.moment_of(g, 1e4), 1.0, atol=1e-6)
    assert np.all(np.diff(iron.moment_of(0.1, np.geomspace(0.1, 100.0, 50))) > 0.0)


def test_below_the_smallest_gap_the_gap_is_held(iron):
    h, least = np.array([1e-3, 0.05, 0.5]), iron.gap[0]
    assert np.array_equal(iron.force_of(0.0, h), iron.force_of(least, h))
    assert np.array_equal(iron.moment_of(-0.01, h), iron.moment_of(least, h))


def test_beyond_the_largest_gap_two_dipoles_stand_for_the_spheres(iron):
    h = np.array([1e-3, 0.05, 0.5])
    inside, outside = iron.gap[-1] * 0.9999, iron.gap[-1] * 1.0001
    # what the spheres have beside dipoles there, at weak field: 6 % of force and 0.2 % of moment
    assert np.allclose(iron.force_of(outside, h), iron.force_of(inside, h), rtol=0.07)
    assert np.allclose(iron.moment_of(outside, h), iron.moment_of(inside, h), rtol=3e-3)
    far = iron.moment_of(50.0, h)
    assert np.allclose(far, iron.lone_sphere(h), rtol=1e-4)


def test_one_table_serves_every_saturation(iron):
    other = pair_table(FroehlichLaw(999.0, 4e5))
    assert np.array_equal(other.force, iron.force) and other.Ms == 4e5 and other.digest == iron.digest
    assert law_digest(IRON, GAPS, FIELDS) != law_digest(GrainLaw(998.0, 1.7e6), GAPS, FIELDS)
    assert law_digest(IRON, GAPS, FIELDS) != law_digest(IRON, GAPS, FIELDS[:-1])


def test_every_shipped_table_is_there_and_those_between_lie_between():
    forces = []
    for chi in sorted((*module._SHIPPED_CHI, 15.0, 70.0, 200.0, 273.0, 2000.0)):
        table = pair_table(GrainLaw(chi, 1.3e6), cache="none is needed")
        assert ("interpolated" in table.source) != (chi in module._SHIPPED_CHI)
        forces.append(table.force)
    # the softer the iron, the stronger the pair: up to the saturated limit, which all reach
    weak = FIELDS < 0.02
    assert all(np.all(later[:, weak] > earlier[:, weak]) for earlier, later in itertools.pairwise(forces))


@pytest.fixture
def small(monkeypatch):
    """A grid that is built in a second."""
    monkeypatch.setattr(module, "GAPS", np.geomspace(0.03, 1.2, 4))
    monkeypatch.setattr(module, "FIELDS", np.geomspace(0.01, 1.0, 4))
    monkeypatch.setattr(module, "RESOLUTION", 0.7)


def test_a_table_is_built_once_and_kept(small, tmp_path, monkeypatch):
    law, calls = LangevinLaw(50.0, 1e6), []
    first = pair_table(law, cache=tmp_path / "new", progress=lambda done, of: calls.append((done, of)))
    assert calls == [(i, 16) for i in range(1, 17)]
    (kept,) = (tmp_path / "new").iterdir()  # nothing half-written lies beside it
    with monkeypatch.context() as patched:
        patched.setattr(module, "build_table", None)
        again = pair_table(LangevinLaw(50.0, 1.7e6), cache=tmp_path / "new")
    for name in ("gap", "field", "force", "moment"):
        assert np.array_equal(getattr(again, name), getattr(first, name))
    assert again.Ms == 1.7e6 and str(kept) in again.source
    # damaged, cut short, of another law: built again and replaced
    whole = kept.read_bytes()
    for damaged in (b"no table", whole[: len(whole) // 2], b""):
        kept.write_bytes(damaged)
        assert read_table(kept) is None
    fresh = pair_table(law, cache=tmp_path / "new")
    assert np.array_equal(fresh.force, first.force) and read_table(kept, first.digest) is not None
    assert read_table(kept, "of another law") is None and read_table(tmp_path / "nowhere.npz") is None


def test_a_table_that_cannot_be_kept_is_given_with_a_warning(small, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    built = PairTable(*(np.geomspace(0.1, 1.0, 4),) * 2, *(np.ones((4, 4)),) * 2, LangevinLaw(50.0, 1e6))
    monkeypatch.setattr(module, "build_table", lambda law, **_: built)
    with pytest.warns(RuntimeWarning, match="could not be kept"):
        assert pair_table(LangevinLaw(50.0, 1e6), cache=tmp_path / "file") is built


def test_the_users_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("EMCLUTCH_CACHE", str(tmp_path / "a"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "a"
    monkeypatch.delenv("EMCLUTCH_CACHE")
    assert cache_folder() == tmp_path / "emclutch"


def test_what_cannot_be_is_refused(iron):
    for law in (LinearLaw(1000.0, "ideal iron"), GrainLaw(999.0)):
        with pytest.raises(ValueError, match="no saturation"):
            pair_table(law)
    with pytest.raises(ValueError, match="no bulk material"):
        pair_table(ThesisLaw(0.3, 1e6))
    for g, h in ((np.nan, 0.1), (0.1, -0.1), (0.1, np.inf)):
        with pytest.raises(ValueError, match="magnitudes"):
            iron.force_of(g, h)
    nodes, law = np.geomspace(0.1, 1.0, 4), FroehlichLaw(999.0, 1e6)
    with pytest.raises(ValueError, match="one of each"):
        PairTable(nodes, nodes, np.ones((4, 3)), np.ones((4, 4)), law)
    with pytest.raises(ValueError, match="above 0"):
        PairTable(nodes, nodes, np.zeros((4, 4)), np.ones((4, 4)), law)
    with pytest.raises(ValueError, match="geometric"):
        PairTable(nodes, np.linspace(0.1, 1.0, 4), np.ones((4, 4)), np.ones((4, 4)), law)


def test_a_table_is_read_without_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pair_table(IRON)


def test_two_zones_explain_a_contact(iron):
    """Up to gaps of 0.01: 11 % below to 35 % above finite elements, within 20 % before the spheres saturate."""
    g, h = np.array([3e-4, 1e-3, 3e-3, 1e-2])[:, None], np.geomspace(1e-3, 1.0, 40)
    ratio = two_zone_force(g, h) / iron.force_of(g, h)
    assert 0.88 < ratio.min() and ratio.max() < 1.36
    assert np.abs(ratio[:, h < 0.07] - 1.0).max() < 0.2


def test_the_necks_capacity_is_that_of_the_bispherical_series():
    """4 pi sinh(a) sum of 1/sinh(n a), cosh a = 1 + g/2, of a sphere over a plane at half the gap (Maxwell 1873)."""
    for g in (1e-4, 1e-6):
        a = np.arccosh(1.0 + 0.5 * g)
        exact = 2.0 * np.sinh(a) * (1.0 / np.sinh(a * np.arange(1, int(60.0 / a)))).sum()
        assert np.log(4.0 * np.exp(2.0 * np.euler_gamma) / g) == pytest.approx(exact, rel=1e-4)
    # unsaturated: the flux that two spheres in touch collect returns through it
    assert neck_potential(1e-3, 1e-6) * np.log(4e3 * np.exp(2 * np.euler_gamma)) == pytest.approx(2e-6 * np.pi**2 / 3)
