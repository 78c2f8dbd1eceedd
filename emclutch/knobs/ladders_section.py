"""[accuracy.ladders]: the settings of each knob that `emclutch accuracy` tries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model

from emclutch.knobs.contact import ContactStep, Overlap, RigidStep, RigidSweeps, RigidTolerance
from emclutch.knobs.field import ElementOrder, FieldMesh, FieldTolerance
from emclutch.knobs.knob import Knob
from emclutch.knobs.magnetism import (
    CouplingWindow,
    FeedbackTolerance,
    MomentTolerance,
    RigidUpdateInterval,
    SmearWidth,
    UpdateInterval,
)
from emclutch.knobs.powder import GrainsAcross, InertialNumber, SectorWidth, StartUp
from emclutch.scene.section import Section

KNOBS: tuple[type[Knob], ...] = (
    GrainsAcross,  # what others follow from comes first: a scene is given its settings in this order
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

_DOC = "Settings of each knob that `emclutch accuracy` tries, beside the scene's own; default: those of the knob."

if TYPE_CHECKING:

    class LaddersSection(Section):
        """The table [accuracy.ladders]."""

        def __getattr__(self, name: str) -> Any: ...

else:
    LaddersSection = create_model(
        "LaddersSection",
        __base__=Section,
        __doc__=_DOC,
        **{
            one.name: (
                tuple[Annotated[float, one.entry], ...] | None,
                Field(default=None, description=f"{one.key}: {one.__doc__.splitlines()[0]}"),
            )
            for one in KNOBS
        },
    )
