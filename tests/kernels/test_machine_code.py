"""The digest of machine code is that of the instructions: the same from the cache and compiled, in any process."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import numpy as np
from geometry.kernels.machine_code import machine_code_digest
before = machine_code_digest()

from coupling.smeared_grains import SectionSmear  # a parallel loop with a function in it
places = 1.0 + np.random.default_rng(1).random((50, 2))
SectionSmear(places, np.ones(50), places, 0.2, 1.0).at(places, np.zeros((50, 0), dtype=bool))
after = machine_code_digest()
assert before != after
print(after)
"""


def digest(cache, seed):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()[-1]


def test_the_digest_does_not_depend_on_the_process(tmp_path):
    compiled = digest(tmp_path / "one", "1")
    assert digest(tmp_path / "one", "2") == compiled  # read from the cache
    assert digest(tmp_path / "two", "3") == compiled  # compiled again
