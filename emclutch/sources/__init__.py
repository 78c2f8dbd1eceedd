"""The sources of a scene's field, one module each: table [field], needs, checks, construction.

To add one: a module here with a subclass of `SourceSection`, its import and its place in `SOURCES`; what it gives to
the coupled loop is a `coupling.field_source.FieldSource`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import Field

from emclutch.sources.coil import CoilFieldSection
from emclutch.sources.source_section import SourceSection
from emclutch.sources.uniform import UniformFieldSection

SOURCES: tuple[type[SourceSection], ...] = (
    CoilFieldSection,
    UniformFieldSection,
)

if TYPE_CHECKING:
    FieldSection = SourceSection
else:
    FieldSection = Annotated[Union[SOURCES], Field(discriminator="source")]  # noqa: UP007 (of a tuple)


def sources_in_words(**of: bool) -> str:
    """Return "'coil' or 'uniform'": the sources whose attributes have the values given."""
    return " or ".join(f"'{one.name()}'" for one in SOURCES if all(getattr(one, key) == of[key] for key in of))


__all__ = ["SOURCES", "FieldSection", "SourceSection", "sources_in_words"]
