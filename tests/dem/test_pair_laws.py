"""Laws by pair of materials, cohesion, rolling and twisting coefficients in the table."""

import math

import numpy as np
import pytest

from particles.laws.cohesion import Cohesion, tabor_parameter
from particles.laws.columns import COHESION_0, COHESION_1, MU, MU_ROLLING, MU_TWISTING, N_LAW, SHEAR, YOUNG
from particles.laws.contact_law import ContactLaw
from particles.laws.elastic import Elastic, effective_modulus, effective_shear_modulus
from particles.laws.hertz_mindlin import HertzMindlin
from particles.laws.linear import LinearContact
from particles.laws.pair_table import ContactMaterial, PairLaws
from particles.laws.rolling_friction import RollingFriction
from particles.laws.springs import SPRINGS, spring
from particles.laws.twisting_friction import TwistingFriction
from particles.laws.walton_braun import WaltonBraun

STEEL, BRASS, PTFE = Elastic(210e9, 0.3), Elastic(100e9, 0.35), Elastic(0.5e9, 0.46)
MATERIALS = {
    "steel": ContactMaterial(STEEL, 0.8, 0.4),
    "brass": ContactMaterial(BRASS, 0.6, 0.25),
    "ptfe": ContactMaterial(PTFE, 0.5, 0.04),
}


def test_one_law_fills_grains_and_walls():
    law = LinearContact.from_restitution(1e4, 0.5, 0.3, wall_friction=0.1)
    table = PairLaws.of_one(law, n_species=2, n_walls=3)
    assert isinstance(law, ContactLaw) and table.kernel == "linear" and table.rows.shape == (2, N_LAW)
    assert table.pair.tolist() == [[0, 0], [0, 0]] and table.wall.tolist() == [[1] * 3] * 2
    assert table.pair.dtype == table.wall.dtype == np.int64
    assert table.rows[:, MU].tolist() == [0.3, 0.1]
    assert np.array_equal(np.delete(table.rows[0], MU), np.delete(table.rows[1], MU))


def test_walls_may_have_a_law_of_their_own():
    table = PairLaws.of_one(LinearContact(1e4, 1e3, 0.1, 0.1, 0.3), at_walls=LinearContact(3e4, 2e3, 0.2, 0.1, 0.5))
    assert table.rows[:, 0].tolist() == [1e4, 3e4] and table.rows[:, MU].tolist() == [0.3, 0.5]


def test_coefficients_of_the_effects_stand_in_their_columns():
    table = PairLaws.of_one(
        LinearContact(1e4, 1e3, 0.1, 0.1, 0.3),
        rolling=RollingFriction(0.2, 0.1),
        twisting=TwistingFriction(0.05),
        cohesion=Cohesion(force=1e-3, per_radius=2.0, wall_per_radius=0.0),
    )
    wanted = {MU_ROLLING: [0.2, 0.1], MU_TWISTING: [0.05, 0.05], COHESION_0: [1e-3, 1e-3], COHESION_1: [2.0, 0.0]}
    for column, values in wanted.items():
        assert table.rows[:, column].tolist() == values


def test_every_pair_of_materials_has_its_moduli_and_the_mixed_coefficients():
    table = PairLaws.of_materials(MATERIALS, ["steel", "brass"], ["ptfe", "steel"])
    elastic = {name: material.elastic for name, material in MATERIALS.items()}
    assert np.array_equal(table.pair, table.pair.T)
    for rows, partners in ((table.pair, ["steel", "brass"]), (table.wall, ["ptfe", "steel"])):
        for i, a in enumerate(["steel", "brass"]):
            for j, b in enumerate(partners):
                row, law = table.rows[rows[i, j]], table.laws[rows[i, j]]
                assert row[YOUNG] == pytest.approx(effective_modulus(elastic[a], elastic[b]), rel=1e-14)
                assert row[SHEAR] == pytest.approx(effective_shear_modulus(elastic[a], elastic[b]), rel=1e-14)
                first, second = MATERIALS[a], MATERIALS[b]
                assert row[MU] == pytest.approx(math.sqrt(first.friction * second.friction), rel=1e-14)
                assert law.restitution**2 == pytest.approx(first.restitution * second.restitution, rel=1e-10)


def test_measured_pairs_take_the_place_of_the_mixing_rule():
    table = PairLaws.of_materials(
        MATERIALS, ["steel"], ["brass"], friction={("brass", "steel"): 0.19}, restitution={("steel", "brass"): 0.7}
    )
    assert table.rows[table.wall[0, 0], MU] == 0.19
    assert table.laws[table.wall[0, 0]].restitution == pytest.approx(0.7, rel=1e-10)


def test_wall_of_the_grains_own_material_has_its_own_row():
    """Rolling at walls may differ although the materials do not."""
    table = PairLaws.of_materials(MATERIALS, ["steel"], ["steel"], rolling=RollingFriction(0.3, 0.0))
    assert table.rows[table.pair[0, 0], MU_ROLLING] == 0.3 and table.rows[table.wall[0, 0], MU_ROLLING] == 0.0


def test_faults_of_a_table_are_explained():
    linear, hysteretic = LinearContact(1e4, 1e3, 0.1, 0.1, 0.3), WaltonBraun(1e4, 2e4, 1e3, 0.1, 0.3)
    with pytest.raises(ValueError, match="'linear' and 'walton_braun' stand in one scene"):
        PairLaws.of_one(linear, at_walls=hysteretic)
    with pytest.raises(ValueError, match="no contact law between 'a' and 'b'"):
        PairLaws.of_pairs(["a"], ["b"], {("a", "a"): linear})
    with pytest.raises(ValueError, match="'wood' is no material of the contacts"):
        PairLaws.of_materials(MATERIALS, ["steel"], ["wood"])
    with pytest.raises(ValueError, match="'wood' is no material of the contacts"):
        PairLaws.of_materials(MATERIALS, ["steel"], ["brass"], friction={("steel", "wood"): 0.1})


def test_grains_without_walls_have_a_table_without_wall_columns():
    table = PairLaws.of_pairs(["a"], [], {("a", "a"): LinearContact(1e4, 1e3, 0.1, 0.1, 0.3)})
    assert table.wall.shape == (1, 0) and table.rows.shape == (1, N_LAW)


def test_pull_off_of_derjaguin_and_johnson():
    """DMT 2 pi w R and JKR (3/2) pi w R of a sphere on a flat: 4/3 of each other (Maugis 1992)."""
    w, r = 0.05, 1e-5
    (dmt, _), (jkr, at_wall) = (c.table()[:, 1] * r for c in (Cohesion.dmt(w), Cohesion.jkr(w, 2 * w)))
    assert dmt == pytest.approx(2 * math.pi * w * r) and dmt / jkr == pytest.approx(4 / 3)
    assert at_wall == pytest.approx(2 * jkr)
    assert Cohesion.constant(1e-6).table().tolist() == [[1e-6, 0.0], [1e-6, 0.0]]


def test_tabor_parameter_tells_hard_from_soft():
    """Iron powder of 50 um is near DMT's end, a rubber sphere of 1 cm deep in JKR's (Johnson & Greenwood 1997)."""
    assert tabor_parameter(0.01, 115e9, 12.5e-6) < 0.5
    assert tabor_parameter(0.05, 0.7e6, 1e-2) > 100.0
    assert tabor_parameter(0.04, 1e9, 1e-6) == pytest.approx(4 * tabor_parameter(0.005, 1e9, 1e-6), rel=1e-12)


@pytest.mark.parametrize("force", [1e-4, 1e-2])
def test_cohesive_rest_is_where_the_spring_carries_the_pull(force):
    """A contact that nothing else presses rests where f_elastic = F_c."""
    law = HertzMindlin.from_restitution(BRASS, 0.5, 0.3)
    rest = law.overlap_under(force, 1e-6, 0.0, 1e-4)
    table = SPRINGS[law.kernel].table(law.row()[None])
    assert spring(table, 0, rest, 1e-6, 1e-4, 0.0)[0] == pytest.approx(force, rel=1e-12)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Cohesion(force=-1.0),
        lambda: Cohesion.jkr(float("nan")),
        lambda: Cohesion.dmt(0.1, -0.1),
        lambda: TwistingFriction(-0.1),
        lambda: TwistingFriction(0.1, float("inf")),
    ],
)
def test_bad_coefficients_are_refused(make):
    with pytest.raises(ValueError, match="allowed: 0 or more"):
        make()
