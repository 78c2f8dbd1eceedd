"""A disk that takes no more."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def full_disk(most: int = 0) -> Iterator[None]:
    """No file of this process may become longer than `most` bytes in the block; what is longer already stays.

    Writing then fails as on a full disk, but for the error's number (EFBIG in place of ENOSPC), and without a disk of
    one's own: Python ignores the signal SIGXFSZ. Nothing is to be printed in the block: the test runner keeps it in a
    file.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
