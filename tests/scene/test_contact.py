"""[contact] by law, [effects.cohesion] and [effects.twisting_friction]: keys, units, refusals, and the laws made."""

import math

import pytest
from pydantic import ValidationError

from emclutch.contact_laws import LAWS
from emclutch.effects import EffectsSection
from emclutch.scene.contact import ContactSection
from particles.laws.elastic import Elastic

GRAIN = {"mass": 1e-6, "diameter": 5e-4}
LOADS = [{"force": 1e-3}, {"speed": 0.3}, {"force": 1e-3, "speed": 0.3}]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("load", LOADS)
def test_stiffness_follows_from_the_overlap_allowed(law, load):
    """No contact is deeper than max_overlap; Hertzian ones only where load and impact are not both there."""
    reference = {"reference_speed": 0.1} if "reference_speed" in LAWS[law].KEYS else {}
    between, at_walls = ContactSection(law=law, max_overlap=0.01, **reference).laws(**GRAIN, **load)
    force, speed = load.get("force", 0.0), load.get("speed", 0.0)
    depths = [
        between.overlap_under(force, 0.5e-6, speed, 1.25e-4) / 5e-4,
        at_walls.overlap_under(force, 1e-6, speed, 2.5e-4) / 5e-4,
    ]
    assert between.kernel == at_walls.kernel == law
    assert max(depths) <= 0.01 * (1 + 1e-9)
    if len(load) == 1:
        assert max(depths) == pytest.approx(0.01, rel=1e-9)


def test_units_of_every_new_quantity():
    assert ContactSection(law="hertz", hertz_stiffness="1e9 N/m^1.5").hertz_stiffness == 1e9
    assert ContactSection(law="hertz", hertz_stiffness="1 kN/mm^1.5").hertz_stiffness == pytest.approx(1e3 / 1e-3**1.5)
    assert ContactSection(law="hertz_mindlin", youngs_modulus="210 GPa").youngs_modulus == 210e9
    assert ContactSection(law="hertz", reference_speed="50 cm/s").reference_speed == pytest.approx(0.5)
    assert EffectsSection(cohesion={"force": "2 uN"}).cohesion.force == pytest.approx(2e-6)
    jkr = EffectsSection(cohesion={"model": "jkr", "work_of_adhesion": "50 mJ/m^2"}).cohesion
    assert jkr.work_of_adhesion == pytest.approx(0.05)
    assert EffectsSection(twisting_friction={}).twisting_friction.coefficient == 0.05


def test_hertz_mindlin_at_walls_of_another_material():
    contact = ContactSection(
        law="hertz_mindlin", youngs_modulus="210 GPa", wall_youngs_modulus="70 GPa", wall_restitution=0.9
    )
    between, at_walls = contact.laws(**GRAIN)
    assert between.partner == between.grain == at_walls.grain == Elastic(210e9, 0.3)
    assert at_walls.partner == Elastic(70e9, 0.3)
    assert (between.restitution, at_walls.restitution) == pytest.approx((0.5, 0.9))


def test_restitution_is_met_for_the_mass_in_motion():
    """Half a grain's mass between grains, all of it at a wall, at the reference speed."""
    for contact in (
        ContactSection(law="hertz", hertz_stiffness=1e7, reference_speed=0.2, restitution=0.6),
        ContactSection(law="thesis", stiffness=1e5, reference_speed=0.2, restitution=0.6),
        ContactSection(law="thesis", stiffness=1e5, overlap_factor="one", restitution=0.6),
    ):
        between, at_walls = contact.laws(**GRAIN)
        assert between.restitution_at(0.5e-6, 0.2) == pytest.approx(0.6, abs=1e-9)
        assert at_walls.restitution_at(1e-6, 0.2) == pytest.approx(0.6, abs=1e-9)


def test_wall_twins_and_friction():
    contact = ContactSection(friction=0.4, wall_friction=0.1, stiffness="10 kN/m", wall_stiffness="20 kN/m")
    between, at_walls = contact.laws(**GRAIN)
    assert (between.friction, at_walls.friction) == (0.4, 0.1)
    assert (between.stiffness_n, at_walls.stiffness_n) == (1e4, 2e4)
    assert at_walls.stiffness_t == pytest.approx(2e4 * 2 / 7)


def test_unloading_stiffness_is_the_other_face_of_restitution():
    given = ContactSection(law="walton_braun", stiffness=1e4, unloading_stiffness=4e4, wall_restitution=0.8)
    between, at_walls = given.laws(**GRAIN)
    assert between.restitution == pytest.approx(0.5) and between.unloading_stiffness == pytest.approx(4e4)
    assert at_walls.restitution == pytest.approx(0.8)
    assert ContactSection(law="walton_braun", stiffness=1e4).laws(**GRAIN)[0].unloading_stiffness == pytest.approx(4e4)


@pytest.mark.parametrize("law", LAWS)
def test_resolved_contact_loads_to_the_same(law):
    """A run writes its scene with what follows from it; that scene may be run again."""
    extra = {"stiffness": 1e4, "unloading_stiffness": 3e4} if law == "walton_braun" else {}
    contact = ContactSection(law=law, **extra)
    assert ContactSection(**contact.model_dump(exclude_none=True)) == contact


@pytest.mark.parametrize(
    "keys, message",
    [
        ({"hertz_stiffness": 1e9}, "does not belong to contact.law = 'linear'; remove it, or take law = 'hertz'"),
        ({"law": "hertz", "youngs_modulus": 1e9}, "take law = 'hertz_mindlin'"),
        ({"law": "hertz", "stiffness": 1e3}, "take law = 'linear' or 'thesis' or 'walton_braun'"),
        ({"law": "walton_braun", "stiffness": 1e4, "unloading_stiffness": 4e4, "restitution": 0.6}, "it makes it sqrt"),
        ({"law": "walton_braun", "unloading_stiffness": 4e4}, "needs stiffness as well"),
        ({"law": "walton_braun", "stiffness": 1e4, "unloading_stiffness": 1e3}, "below the stiffness 10000 N/m"),
        ({"law": "hurtz"}, "did you mean 'hertz'"),
        ({"law": "hertz", "hertz_stiffness": "1e9 N/m"}, "is a stiffness; a Hertz stiffness is needed"),
        ({"law": "hertz_mindlin", "poisson_ratio": 0.6}, "is out of range"),
    ],
)
def test_key_of_another_law_and_contradictions_are_refused(keys, message):
    with pytest.raises(ValidationError) as fault:
        ContactSection(**keys)
    assert message in str(fault.value)


@pytest.mark.parametrize(
    "cohesion, message",
    [
        ({}, "is missing for model = 'constant'; give it, e.g. force = '1 mN'"),
        ({"model": "dmt"}, "is missing for model = 'dmt'"),
        ({"model": "jkr", "work_of_adhesion": 0.1, "wall_force": 1.0}, "does not belong to model = 'jkr'"),
        ({"model": "jrk", "work_of_adhesion": 0.1}, "available: constant, dmt, jkr"),
    ],
)
def test_cohesion_asks_for_what_its_model_needs(cohesion, message):
    with pytest.raises(ValidationError) as fault:
        EffectsSection(cohesion=cohesion)
    assert message in str(fault.value)


@pytest.mark.parametrize("law", LAWS)
def test_nothing_expected_and_nothing_given_is_refused(law):
    with pytest.raises(ValueError, match="no stiffness follows"):
        ContactSection(law=law).laws(**GRAIN)


def test_speed_dependent_restitution_without_an_impact_is_refused():
    with pytest.raises(ValueError, match=r"give contact\.reference_speed"):
        ContactSection(law="hertz", hertz_stiffness=1e9).laws(**GRAIN)


def test_thesis_spring_equals_the_hertz_one_of_the_same_stiffness():
    """k sqrt(delta/d) delta = (k/sqrt d) delta^1.5."""
    thesis = ContactSection(law="thesis").laws(**GRAIN, speed=0.3)[1]
    hertz = ContactSection(law="hertz").laws(**GRAIN, speed=0.3)[1]
    assert thesis.stiffness_n / math.sqrt(5e-4) == pytest.approx(hertz.stiffness_n)
