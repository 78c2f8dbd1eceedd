"""The contact laws of a scene, one module each: keys, stiffness entry, construction, cost.

To add one: a module here and its line in `LAWS`, with its compiled spring in `particles/laws`
(docs/how_to/extend.md).
"""

from __future__ import annotations

from emclutch.contact_laws.hertz import Hertz
from emclutch.contact_laws.hertz_mindlin import HertzMindlinKind
from emclutch.contact_laws.law_kind import LawKind
from emclutch.contact_laws.linear import Linear
from emclutch.contact_laws.thesis import Thesis
from emclutch.contact_laws.walton_braun import WaltonBraunKind

LAWS: dict[str, type[LawKind]] = {law.name: law for law in (Linear, HertzMindlinKind, Hertz, Thesis, WaltonBraunKind)}
"""By their entry of `contact.law`."""

KEYS: dict[str, tuple] = {key: field for law in LAWS.values() for key, field in law.KEYS.items()}
"""Keys of [contact] that only some laws have."""

__all__ = ["KEYS", "LAWS", "LawKind"]
