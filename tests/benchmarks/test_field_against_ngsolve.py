"""Wall-clock of the nonlinear axisymmetric solve beside NGSolve: same triangles, order, laws and tolerance.

    pip install emclutch[bench]; python -m pytest tests/benchmarks/test_field_against_ngsolve.py -s

Both are warmed up and run in turn; the best of some repetitions counts. `solve` is the Newton iteration alone,
`all` with what has to be set up for a mesh (numbering, pattern, symbolic factorisation).
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from emclutch import load_case
from emclutch.device import build_device
from field import AxisymmetricProblem
from field.factorisation import describe_backend

pytest.importorskip("ngsolve", reason="the peer of this benchmark: pip install ngsolve")

AMPERE_TURNS = 1500.0
REPETITIONS = 5
QUICKSTART = Path(__file__).parents[2] / "cases" / "quickstart.toml"


@pytest.mark.parametrize("threads", [1, 2])
def test_wall_clock_beside_ngsolve(threads):
    from ngsolve_oracle import solve_section

    print(f"\n{os.cpu_count()} cores, NGSolve on {threads} thread(s), ours on 1 ({describe_backend()})")
    print(
        "order  unknowns | ours: steps  solve    all | NGSolve: steps  solve    all [ms] | ratio solve  all | linkage"
    )
    case = load_case(QUICKSTART)
    for order, size in ((2, 0.75), (2, 0.5), (2, 0.3), (3, 1.0), (3, 0.7), (3, 0.45)):
        built = build_device(case.with_values({"field.size_factor": size}).scene).coil.problem
        laws = {name: law for name, law in built.laws.items() if name != "powder"}
        ours, theirs = [], []
        for _ in range(REPETITIONS + 1):
            start = time.perf_counter()
            problem = AxisymmetricProblem(built.mesh, laws, order=order)
            field = problem.solve(AMPERE_TURNS)
            everything = time.perf_counter() - start
            start = time.perf_counter()
            again = problem.solve(AMPERE_TURNS)
            ours.append((time.perf_counter() - start, everything))
            answer = solve_section(built.mesh, laws, AMPERE_TURNS, order, 1e-8, threads=threads)
            theirs.append((answer["seconds_solve"], answer["seconds_total"]))
        assert np.array_equal(field.psi, again.psi)
        solve, whole = 1e3 * np.min(ours, axis=0)
        ng_solve, ng_whole = 1e3 * np.min(theirs, axis=0)
        linkage = field.flux_linkage_per_turn / answer["flux_linkage_per_turn"] - 1.0
        # the two quadratures differ in saturated elements
        assert abs(linkage) < 2e-4
        print(
            f"P{order}    {problem.n_dofs:9d} | {len(field.newton) - 1:11d} {solve:6.1f} {whole:6.1f} |"
            f" {answer['newton_steps']:14d} {ng_solve:6.1f} {ng_whole:6.1f}      |"
            f"        {solve / ng_solve:4.2f} {whole / ng_whole:4.2f} | {linkage:+.1e}"
        )
