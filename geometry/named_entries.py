"""Names of entries in what is said of bad input.

A package that does not know the scene names what is wrong by its own arguments, between backticks: "raise `gap` or
lower `grain_diameter`". Whoever knows them under other names puts those in.
"""

from __future__ import annotations

import re
from collections.abc import Callable

_NAME = re.compile(r"`([^`]*)`")


def with_keys(text: str, key_of: Callable[[str], str]) -> str:
    """The text with `key_of(name)` in place of each name and its backticks."""
    return _NAME.sub(lambda found: key_of(found[1]), text)
