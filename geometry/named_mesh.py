"""Elements by the names of their regions and boundaries: what meshes of a section and of a solid share."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np


class NamedMesh:
    """Mix-in of a mesh with `regions` (indexes of elements) and `boundaries` (nodes of edges or faces) by name."""

    __slots__ = ()
    regions: dict[str, np.ndarray]
    boundaries: dict[str, np.ndarray]

    def elements_of(self, region: str) -> np.ndarray:
        """Return the indexes of a region's elements, shape (k,).

        Raises
        ------
        KeyError
            No such region.
        """
        if region not in self.regions:
            raise KeyError(f"no region {region!r} in this mesh; it has {', '.join(sorted(self.regions))}")
        return self.regions[region]

    def region_of_element(self) -> np.ndarray:
        """Name of the region of every element, shape (n_elements,), dtype str."""
        names = np.empty(sum(map(len, self.regions.values())), dtype=f"<U{max(map(len, self.regions), default=1)}")
        for name, elements in self.regions.items():
            names[elements] = name
        return names

    def _check_partition(self, count: int) -> None:
        """Refuse regions that do not hold each of `count` elements once."""
        uses = np.zeros(count, dtype=np.int64)
        for elements in self.regions.values():
            np.add.at(uses, elements, 1)
        if not np.all(uses == 1):
            raise ValueError(f"{np.count_nonzero(uses != 1)} element(s) are not in exactly one region")

    def _hash_with(self, arrays: Mapping[str, np.ndarray], prefix: str = "") -> str:
        """SHA-256 (hex) of a prefix, arrays by name, and regions and boundaries in the order of their names."""
        digest = hashlib.sha256(prefix.encode())
        named = dict(arrays)
        named |= {f"region {name}": self.regions[name] for name in sorted(self.regions)}
        named |= {f"boundary {name}": self.boundaries[name] for name in sorted(self.boundaries)}
        for name, array in named.items():
            digest.update(f"{name} {array.shape} {array.dtype}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()
