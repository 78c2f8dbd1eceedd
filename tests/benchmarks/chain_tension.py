"""Tension of a chain of 61 iron grains against the field, by both models, beside finite elements of an infinite chain.

python tests/benchmarks/chain_tension.py PICTURE.png
"""

import sys

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from coupling.cluster import magnetised_cluster
from field import MU_0, GrainLaw

A, LAW, GAPS = 1e-4, GrainLaw(999.0, 1.7e6), (0.001, 0.03, 0.1)
FIELDS = np.array([1, 5, 18, 46, 80, 120, 200, 300, 500]) * 1e3  # A/m
# [mu_0 Ms^2 a^2], p = 4; tests/coupling/test_magnetised_contact.py has the same numbers
ELEMENTS = {
    0.001: (1.717e-3, 0.01632, 0.06616, 0.1689, 0.2804, 0.3923, 0.5563, 0.6585, 0.6819),
    0.03: (6.240e-5, 1.557e-3, 0.02003, 0.1076, 0.2171, 0.3300, 0.4993, 0.6093, 0.6377),
    0.1: (1.610e-5, 4.024e-4, 5.207e-3, 0.03386, 0.1012, 0.2044, 0.3795, 0.5056, 0.5463),
}


def tension(gap: float, field: float, model: str) -> float:
    """Pull of one half on the other [mu_0 Ms^2 a^2]."""
    x = np.column_stack([np.zeros((61, 2)), (2.0 + gap) * A * np.arange(61)])
    force = magnetised_cluster(x, A, LAW, [0.0, 0.0, field], model=model, smallest_gap=3e-4, tolerance=1e-6).force
    return -float(force[31:, 2].sum()) / (MU_0 * LAW.Ms**2 * A**2)


def main(path: str) -> None:
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    fields = np.geomspace(1e3, 5e5, 28)
    for number, gap in enumerate(GAPS):
        for model, style in (("near_field", "-"), ("mutual", "--")):
            label = f"gap {gap:g} radii" + (": with necks" if style == "-" else ": dipoles")
            axes.loglog(fields / 1e3, [tension(gap, H, model) for H in fields], style, color=f"C{number}", lw=1.4,
                        label=label)  # fmt: skip
        axes.loglog(FIELDS / 1e3, ELEMENTS[gap], "o", color=f"C{number}", ms=5, mfc="none")
    axes.plot([], [], "o", color="0.3", mfc="none", label="finite elements, same gaps")
    axes.set(xlabel="field H [kA/m]", ylabel="tension / (µ₀ Ms² a²) [1]", ylim=(1e-6, 2.0),
             title="Tension of a chain of iron grains")
    axes.legend(frameon=False, fontsize=8)
    axes.grid(alpha=0.3, which="both", lw=0.4)
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main(sys.argv[1])
