"""Where two workers run tests at a time, each has its own cache of compiled kernels.

numba numbers the files of a cache by how many signatures its index holds: two processes that compile one function for
different arguments at the same time may take each other's code.
"""

import os
from pathlib import Path

worker = os.environ.get("PYTEST_XDIST_WORKER")
if worker is not None:
    home = os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[1] / ".pytest_cache" / "numba"
    os.environ["NUMBA_CACHE_DIR"] = str(Path(home) / worker)
