"""[effects.cohesion]: pull between grains that touch (`particles.laws.cohesion`)."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from emclutch.effects.effect import EffectSection, Load
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.scene.section import Choice, refuse
from emclutch.scene.units import Force, WorkOfAdhesion
from emclutch.scene.usual_ranges import WORK_OF_ADHESION


class CohesionSection(EffectSection):
    """Pull between grains that touch: constant, or from the work of adhesion w and r = R_i R_j/(R_i + R_j)."""

    name = "cohesion"
    changes_stress = has_scale = True
    summary = "touching grains attract each other"
    size_note = "the stress of a pull scales as 1/d (dmt, jkr) or 1/d^2 (constant)"

    USUAL: ClassVar = {"work_of_adhesion": WORK_OF_ADHESION, "wall_work_of_adhesion": WORK_OF_ADHESION}

    model: Annotated[str, Choice(("constant", "dmt", "jkr"))] = Field(
        default="constant",
        description="constant: force; dmt: 2 pi w r, small stiff grains; jkr: 3/2 pi w r, large soft grains",
    )
    force: Force | None = Field(default=None, description="constant: pull of a contact")
    wall_force: Force | None = Field(default=None, description="constant: at walls; default: force")
    work_of_adhesion: WorkOfAdhesion | None = Field(
        default=None,
        description="dmt and jkr: energy to part a unit of area, twice the surface energy of like grains",
    )
    wall_work_of_adhesion: WorkOfAdhesion | None = Field(
        default=None, description="dmt and jkr: at walls; default: work_of_adhesion"
    )

    @model_validator(mode="after")
    def _has_what_its_model_needs(self) -> Self:
        needed, other = ("force", "work_of_adhesion") if self.model == "constant" else ("work_of_adhesion", "force")
        for key in (other, f"wall_{other}"):
            if getattr(self, key) is not None:
                raise refuse(f"does not belong to model = '{self.model}'; remove it, or take another model", key=key)
        if getattr(self, needed) is None:
            example = "'1 mN'" if needed == "force" else "'0.05 J/m^2'"
            raise refuse(f"is missing for model = '{self.model}'; give it, e.g. {needed} = {example}", key=needed)
        return self

    def contact_terms(self):
        """Return the pull for the contacts."""
        from particles.laws.cohesion import Cohesion  # local: the schema itself needs no particles

        if self.model == "constant":
            assert self.force is not None  # by the model's rule
            return {"cohesion": Cohesion.constant(self.force, self.wall_force)}
        assert self.work_of_adhesion is not None
        return {"cohesion": getattr(Cohesion, self.model)(self.work_of_adhesion, self.wall_work_of_adhesion)}

    def loads(self, scene, device, M_max):
        """Yield the pull of the largest grains."""
        pull, d = self.contact_terms()["cohesion"].table(), scene.particles.largest_diameter
        yield Load(self.name, float(max(pull[0] @ (1.0, 0.25 * d), pull[1] @ (1.0, 0.5 * d))), "cohesion")

    @classmethod
    def omitted_effects(cls, at):
        """Yield the van der Waals force of rough grains over the largest other force."""
        yield OmittedEffect(
            cls.name, OFF, "van der Waals force of rough grains divided by attraction and weight", at.bond, 0.1
        )
