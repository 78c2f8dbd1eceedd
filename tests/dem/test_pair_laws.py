"""Laws by pair of materials, cohesion, rolling and twisting coefficients in the table."""

import math

import numpy as np
import pytest

from particles.laws.cohesion import Cohesion
from particles.laws.columns import COHESION_0, COHESION_1, MU, MU_ROLLING, MU_TWISTING, N_LAW
from particles.laws.contact_law import ContactLaw
from particles.laws.elastic import Elastic
from particles.laws.hertz_mindlin import HertzMindlin
from particles.laws.linear import LinearContact
from particles.laws.pair_table import PairLaws
from particles.laws.rolling_friction import RollingFriction
from particles.laws.springs import law_table, spring
from particles.laws.twisting_friction import TwistingFriction
from particles.laws.walton_braun import WaltonBraun


def test_one_law_fills_grains_and_walls():
    law = LinearContact.from_restitution(1e4, 0.5, 0.3)
    table = PairLaws.of_one(law, n_species=2, n_walls=3)
    assert isinstance(law, ContactLaw) and table.kernel == "linear" and table.rows.shape == (2, N_LAW)
    assert table.pair.tolist() == [[0, 0], [0, 0]] and table.wall.tolist() == [[1] * 3] * 2
    assert table.pair.dtype == table.wall.dtype == np.int64
    assert table.rows[:, MU].tolist() == [0.3, 0.3]
    assert np.array_equal(table.rows[0], table.rows[1])


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


def test_wall_of_the_grains_own_material_has_its_own_row():
    """Rolling at walls may differ although the materials do not."""
    law = LinearContact(1e4, 1e3, 0.1, 0.1, 0.3)
    table = PairLaws.of_pairs(["steel"], ["steel"], {("steel", "steel"): law}, rolling=RollingFriction(0.3, 0.0))
    assert table.rows[table.pair[0, 0], MU_ROLLING] == 0.3 and table.rows[table.wall[0, 0], MU_ROLLING] == 0.0


def test_faults_of_a_table_are_explained():
    linear, hysteretic = LinearContact(1e4, 1e3, 0.1, 0.1, 0.3), WaltonBraun(1e4, 2e4, 1e3, 0.1, 0.3)
    with pytest.raises(ValueError, match="'linear' and 'walton_braun' stand in one scene"):
        PairLaws.of_one(linear, at_walls=hysteretic)
    with pytest.raises(ValueError, match="no contact law between 'a' and 'b'"):
        PairLaws.of_pairs(["a"], ["b"], {("a", "a"): linear})


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


@pytest.mark.parametrize("force", [1e-4, 1e-2])
def test_cohesive_rest_is_where_the_spring_carries_the_pull(force):
    """A contact that nothing else presses rests where f_elastic = F_c."""
    law = HertzMindlin.from_restitution(Elastic(100e9, 0.35), 0.5, 0.3)
    rest = law.overlap_under(force, 1e-6, 0.0, 1e-4)
    table = law_table(law.kernel, law.row()[None])
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
