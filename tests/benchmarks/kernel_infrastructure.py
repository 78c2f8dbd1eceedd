"""What SIMD vectors, device functions and the kernel cache each gain (geometry/kernels/README.md).

    python tests/benchmarks/kernel_infrastructure.py

Each line comes from a process of its own with an empty cache and one thread: the step of 10 000 grains of scene A
(settled bed, linear law) with vectors of eight at the width of this processor and at that of SSE2; the processor time
to compile that step with device functions and with ``numba.njit`` in their place, and with bodies of parallel loops
compiled by themselves, as numba does; the time until a second process has its first step, with this project's cache and
with numba's own, after a comment has been added to a module with kernels.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import scene_a

ROOT = Path(__file__).resolve().parents[2]
N = 10_000
STEP = r"""
import sys, time
import numpy as np
begin = time.perf_counter()
sys.path.insert(0, "tests/benchmarks")
import numba
numba.set_num_threads(1)
import scene_a
with np.load("{state}") as file:
    dem = scene_a.make({n}, file["position"][:{n}])
a = time.process_time(); dem.run(1); compiled = time.process_time() - a
first = time.perf_counter() - begin
scene_a.advance(dem, {steps}, 0.0)
times = []
for part in range(5):
    start = time.process_time()
    scene_a.advance(dem, {steps}, (part + 1) * {steps} * scene_a.TIME_STEP)
    times.append(time.process_time() - start)
best = min(times)
print(f"RESULT {{1e9 * best / ({n} * {steps}):.1f}} {{compiled:.1f}} {{first:.1f}}")
"""
LOOPS_COMPILED = ("JITCodeLibrary.add_linking_library = link", "del link"), ('= "__numba_parfor_gufunc"', '= "none"')
AS_NJIT = ("return made(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)", "return made(**options)")


def measured(cache: Path, n: int = N, steps: int = 500, root: Path = ROOT, **env: str) -> list[float]:
    """Nanoseconds a grain and step, seconds of compiling the step, seconds until the first step."""
    code = STEP.format(n=n, steps=steps, state=cache.parent / "state.npz")
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True,
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache), "OMP_NUM_THREADS": "1"} | env,
    )  # fmt: skip
    found = re.search(r"RESULT (\S+) (\S+) (\S+)", result.stdout)
    if found is None:
        raise RuntimeError(result.stderr)
    return [float(x) for x in found.groups()]


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        caches = Path(folder)
        scene_a.write_state(caches / "state.npz", N)
        native = measured(caches / "native")
        narrow = measured(caches / "sse2", NUMBA_CPU_NAME="x86-64", NUMBA_CPU_FEATURES="")
        print(f"step, vectors as wide as the processor's: {native[0]} ns a grain; of SSE2: {narrow[0]} ns")
        copy = caches / "copy"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".venv", ".git", "runs", "__pycache__"))
        module = copy / "geometry" / "kernels" / "device_functions.py"
        text = module.read_text()
        assert AS_NJIT[0] in text
        module.write_text(text.replace(*AS_NJIT))
        plain = measured(caches / "plain", steps=1, root=copy)
        loops = text
        for part in LOOPS_COMPILED:
            assert part[0] in loops
            loops = loops.replace(*part)
        module.write_text(loops)
        numbas = measured(caches / "loops", steps=1, root=copy)
        module.write_text(text)
        device = measured(caches / "device", steps=1)
        print(f"compiling the step: {device[1]} s; with njit for device functions {plain[1]} s", end="")
        print(f"; with bodies of loops compiled by themselves {numbas[1]} s")
        own_second = measured(caches / "device", steps=1)
        names = "UserProvidedCacheLocator,InTreeCacheLocator"
        rows = []
        for label, env in (("own", {}), ("numba's", {"NUMBA_CACHE_LOCATOR_CLASSES": names})):
            cache = caches / f"touched_{label[0]}"
            measured(cache, steps=1, root=copy, **env)
            warm = measured(cache, steps=1, root=copy, **env)
            for name in ("particles/dem/step_kernel.py", "particles/neighbours/contact_list.py"):
                path = copy / name
                path.write_text(path.read_text() + "# a comment\n")
            touched = measured(cache, steps=1, root=copy, **env)
            rows.append(
                f"{label}: {warm[2]} s, after a comment {touched[2]} s ({touched[1]} s of it compiling the step)"
            )
        print(f"first step with a warm cache: {own_second[2]} s", *rows, sep="\n")


if __name__ == "__main__":
    main()
