"""[accuracy.values]: the values of each setting that `emclutch accuracy` measures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model

from emclutch.scene.section import Section
from emclutch.settings.contact import CONTACT_STEP, OVERLAP, RIGID_STEP, RIGID_SWEEPS, RIGID_TOLERANCE
from emclutch.settings.field import ELEMENT_ORDER, FIELD_MESH, FIELD_TOLERANCE
from emclutch.settings.magnetism import (
    COUPLING_WINDOW,
    FEEDBACK_TOLERANCE,
    MOMENT_TOLERANCE,
    RIGID_UPDATE_INTERVAL,
    SMEAR_WIDTH,
    UPDATE_INTERVAL,
)
from emclutch.settings.powder import GRAINS_PER_GAP, INERTIAL_NUMBER, SECTOR, START_UP
from emclutch.settings.setting import Setting

SETTINGS: tuple[Setting, ...] = (
    GRAINS_PER_GAP,  # what others follow from comes first: a scene is given its values in this order
    SECTOR,
    INERTIAL_NUMBER,
    START_UP,
    FIELD_MESH,
    FIELD_TOLERANCE,
    ELEMENT_ORDER,
    SMEAR_WIDTH,
    MOMENT_TOLERANCE,
    FEEDBACK_TOLERANCE,
    OVERLAP,
    CONTACT_STEP,
    UPDATE_INTERVAL,
    COUPLING_WINDOW,
    RIGID_STEP,
    RIGID_UPDATE_INTERVAL,
    RIGID_TOLERANCE,
    RIGID_SWEEPS,
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
                Field(default=None, description=f"{one.key}: {one.summary}"),
            )
            for one in SETTINGS
        },
    )
