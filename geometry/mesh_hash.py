"""One hash for a mesh's arrays and names."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np


def hash_of(
    arrays: Mapping[str, np.ndarray],
    regions: Mapping[str, np.ndarray],
    boundaries: Mapping[str, np.ndarray],
    prefix: str = "",
) -> str:
    """SHA-256 (hex) of arrays by name, of regions and boundaries in the order of their names, and of a prefix."""
    digest = hashlib.sha256(prefix.encode())
    named = dict(arrays)
    named |= {f"region {name}": regions[name] for name in sorted(regions)}
    named |= {f"boundary {name}": boundaries[name] for name in sorted(boundaries)}
    for name, array in named.items():
        digest.update(f"{name} {array.shape} {array.dtype}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
