"""The order of candidates by their fitness."""

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.typing import Fitness


def best_first(fitness: Fitness) -> NDArray[np.intp]:
    """Return indices from the best to the worst; equal ones by index, failed ones (NaN) last, by index."""
    order: NDArray[np.intp] = np.argsort(-fitness, kind="stable")  # NaN sorts last
    return order
