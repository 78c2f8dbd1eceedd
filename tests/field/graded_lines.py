"""Lines of a tensor grid that are even where it matters and grow away from there."""

import numpy as np


def graded_lines(step, inside, reach, growth=1.35):
    """Lines `step` apart in `inside` = (a, b), growing geometrically towards `reach` = (low, high)."""
    n = round((inside[1] - inside[0]) / step)
    lines = list(np.linspace(*inside, n + 1))
    for sign, edge, end in ((1, inside[1], reach[1]), (-1, inside[0], reach[0])):
        x, h = edge, step
        while sign * (end - x) > 1e-9:
            h *= growth
            x = x + sign * h
            # a last cell that would be a sliver is joined to the one before
            if sign * (end - x) < h:
                x = end
            lines.append(x)
    return np.unique(np.round(lines, 9))
