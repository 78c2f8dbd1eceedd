"""The version of numba that the compiled kernels were tested with; another one is refused when they are imported.

The kernels use parts of numba that it does not promise to keep (geometry/kernels/README.md lists them), some
of which are replaced for the whole process. With another minor version they may fail in any way, wrong numbers
included.
"""

from __future__ import annotations

TESTED = "0.68"
"""Minor version; pyproject.toml allows the same."""


class NumbaVersionError(ImportError):
    """The installed numba is not the tested one."""


def require_tested_version(installed: str) -> None:
    """Check the installed version of numba, for example ``0.68.1``.

    Raises
    ------
    NumbaVersionError
        It belongs to another minor version than `TESTED`.
    """
    if installed.split(".")[:2] != TESTED.split("."):
        raise NumbaVersionError(
            f"numba {installed} is installed, and emclutch's compiled kernels are tested with numba {TESTED} alone, of "
            f"which they use internal parts; run: pip install 'numba=={TESTED}.*' (how to move to another version: "
            "geometry/kernels/README.md)"
        )
