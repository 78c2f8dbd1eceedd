"""Files of pair tables: shipped with the package, or in the user's cache, by the identity of their law.

A table depends on the shape of the law alone, B/(mu_0 Ms) over H/Ms, on the grid and on how it is made, so its name
in the cache is a hash of these three.  The cache is the folder that the environment names in EMCLUTCH_CACHE, else
`emclutch` in XDG_CACHE_HOME, else `~/.cache/emclutch`.
"""

from __future__ import annotations

import hashlib
import os
import zipfile
from pathlib import Path

import numpy as np

from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import MU_0, Law
from field.spheres.lone_sphere import bulk_law, saturation

# Of the mesh, the solver and the grid: raised with each change that moves the numbers by more than 1e-4.
GENERATOR = 1

SHIPPED = Path(__file__).parent / "tables"

_NAMES = ("gap", "field", "force", "moment")
# Flux densities [mu_0 Ms] at which a law is compared: from 1e-6, where iron is linear, to far in saturation.
_SAMPLES = np.logspace(-6.0, 1.0, 141)


def cache_folder() -> Path:
    """The user's folder of tables; it need not be there."""
    named = os.environ.get("EMCLUTCH_CACHE")
    if named:
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "emclutch"


def law_digest(law: Law | GrainLaw, gap: np.ndarray, field: np.ndarray) -> str:
    """SHA-256 (hex) of a law scaled by its Ms, a grid of gaps [radii] and fields [Ms], and the generator.

    To six digits: rounding must not distinguish two laws of one shape and different Ms.

    Raises
    ------
    ValueError
        A law that does not saturate.
    """
    Ms = saturation(law)
    H = bulk_law(law).H_of_B(MU_0 * Ms * _SAMPLES)[0] / Ms
    text = [f"generator {GENERATOR}", *(f"{value:.5e}" for value in np.concatenate((H, gap, field)))]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()


def write_table(path: Path, columns: dict[str, np.ndarray], digest: str) -> None:
    """Write a table's arrays to a temporary file and move it into place in one step; makes the folder.

    Force and moment in single precision, a thousand times finer than they are solved for.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}.new")  # two runs may build one table at the same time
    try:
        with temporary.open("wb") as stream:
            np.savez_compressed(
                stream,
                digest=np.array(digest),
                gap=columns["gap"],
                field=columns["field"],
                force=columns["force"].astype(np.float32),
                moment=columns["moment"].astype(np.float32),
            )
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def read_table(path: Path, digest: str | None = None) -> dict[str, np.ndarray] | None:
    """The arrays of a table; None where there is none, or one that is damaged or of another law.

    Parameters
    ----------
    path : Path
    digest : str or None
        What it must be of; None: anything.
    """
    try:
        # opened here: of a damaged file numpy leaves its own stream open
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            columns = {name: np.asarray(stored[name], dtype=float) for name in _NAMES}
            of = str(stored["digest"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    shape = (columns["gap"].size, columns["field"].size)
    valid = all(np.all(np.isfinite(one)) and np.all(one > 0.0) for one in columns.values())
    fits = columns["force"].shape == shape and columns["moment"].shape == shape
    return columns if valid and fits and digest in (None, of) else None
