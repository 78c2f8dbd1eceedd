"""[effects.magnetic_force]: the force mu_0 V (M . grad) H of the field on each grain (`coupling.MagneticForce`)."""

from __future__ import annotations

from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When

TORQUE_DISC_FIELD = Column(
    "torque_disc_field",
    "N m",
    "part of torque_disc: reaction to the force that its slots exert through the field",
    When.MEAN,
)
TORQUE_ROTOR_FIELD = Column(
    "torque_rotor_field",
    "N m",
    "part of torque_rotor: reaction to the force that its slots exert through the field",
    When.MEAN,
)
TORQUE_FIELD_GRADIENT = Column(
    "torque_field_gradient", "N m", "part of torque_field from the gradient of the field", When.MEAN
)


class MagneticForceSection(EffectSection):
    """Force mu_0 V (M . grad) H of the field on each grain."""

    name = "magnetic_force"
    summary = "force of the field on each grain"
    columns = (TORQUE_DISC_FIELD, TORQUE_ROTOR_FIELD, TORQUE_FIELD_GRADIENT)
    needs_field = True
    needs_moments = True
    has_lagged_forces = True

    def acting(self, scene, bodies):
        """Yield the force of the field's gradient."""
        from coupling import MagneticForce  # local: the schema itself needs no fields

        yield MagneticForce()

    def warnings(self, scene):
        """Yield that grains without attraction form no chains."""
        effects = scene.effects
        if effects.attraction is None:
            yield (
                f"{effects.tables(role='attraction')} is missing: without the forces between magnetised grains the "
                "powder forms no chains, and the torque will be near zero"
            )

    @classmethod
    def omitted_effects(cls, at):
        """Yield the pull of the field over that of touching grains."""
        if at.M > 0.0:
            yield OmittedEffect(
                cls.name, OFF, "force of the field divided by the attraction of touching grains", at.gradient, 0.1
            )
