"""Hypervolume: how much of the space of objectives a front dominates."""

import numpy as np

from swarmwright.methods.archive import Values, ranks


def hypervolume(values: Values, reference: Values) -> float:
    """Return the volume that is dominated by at least one row and dominates the reference point; exact.

    Rows that are not better than the reference point in every column add nothing (as in pymoo). The time
    grows quickly with the number of columns.

    Args:
        values: (n, columns), columns at least two; more is better in each.
        reference: (columns,), a value of each that is worse than those of interest.

    Source: While, Bradstreet and Barone, "A fast way of calculating exact hypervolumes", IEEE Transactions on
    Evolutionary Computation 16(1), 2012.
    """
    gains = values - reference
    return _volume(gains[np.logical_and.reduce(gains > 0, axis=1)])


def _volume(gains: Values) -> float:
    """Return the volume of the union of boxes from the origin to each row."""
    if gains.shape[1] == 2:
        return _area(gains)
    unique = np.unique(gains, axis=0)
    gains = unique[ranks(unique, last=0) == 0]
    gains = gains[np.argsort(gains[:, -1], kind="stable")]
    total = 0.0
    for index, row in enumerate(gains[:, :-1]):
        # What the box shares with those behind it, which reach farther in the last column, has its own
        # extent there; so one column fewer is left.
        shared = _volume(np.minimum(gains[index + 1 :, :-1], row))
        total += float(gains[index, -1]) * max(0.0, float(np.prod(row)) - shared)
    return total


def _area(gains: Values) -> float:
    """Return the area of the union of rectangles, (n, 2)."""
    ordered = gains[np.argsort(-gains[:, 0], kind="stable")]
    heights = np.maximum.accumulate(ordered[:, 1])
    widths = ordered[:, 0] - np.append(ordered[1:, 0], 0.0)
    return float(heights @ widths)
