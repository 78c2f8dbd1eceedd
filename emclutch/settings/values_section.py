"""[accuracy.values]: the values of each setting that `emclutch accuracy` measures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model

from emclutch.scene.section import Section
from emclutch.settings.contact import ContactStep, Overlap, RigidStep, RigidSweeps, RigidTolerance
from emclutch.settings.field import ElementOrder, FieldMesh, FieldTolerance
from emclutch.settings.magnetism import (
    CouplingWindow,
    FeedbackTolerance,
    MomentTolerance,
    RigidUpdateInterval,
    SmearWidth,
    UpdateInterval,
)
from emclutch.settings.powder import GrainsPerGap, InertialNumber, SectorWidth, StartUp
from emclutch.settings.setting import Setting

SETTINGS: tuple[type[Setting], ...] = (
    GrainsPerGap,  # what others follow from comes first: a scene is given its values in this order
    SectorWidth,
    InertialNumber,
    StartUp,
    FieldMesh,
    FieldTolerance,
    ElementOrder,
    SmearWidth,
    MomentTolerance,
    FeedbackTolerance,
    Overlap,
    ContactStep,
    UpdateInterval,
    CouplingWindow,
    RigidStep,
    RigidUpdateInterval,
    RigidTolerance,
    RigidSweeps,
)

_DOC = "Values of each setting that `emclutch accuracy` measures, beside the scene's own; default: a choice for each."

if TYPE_CHECKING:

    class ValuesSection(Section):
        """The table [accuracy.values]."""

        def __getattr__(self, name: str) -> Any: ...

else:
    ValuesSection = create_model(
        "ValuesSection",
        __base__=Section,
        __doc__=_DOC,
        **{
            one.name: (
                tuple[Annotated[float, one.entry], ...] | None,
                Field(default=None, description=f"{one.key}: {one.__doc__.splitlines()[0]}"),
            )
            for one in SETTINGS
        },
    )
