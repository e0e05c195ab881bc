"""Types of arrays that all parts share."""

import numpy as np
from numpy.typing import NDArray

Fitness = NDArray[np.float64]
"""A number for each candidate, more is better, NaN where the evaluation failed."""
Genome = NDArray[np.float32]
"""One genome: float32, shape (genome_size,)."""
Genomes = NDArray[np.float32]
"""Several genomes: float32, shape (candidates, genome_size)."""
Limits = tuple[NDArray[np.float64], NDArray[np.float64]]
"""A lower and an upper limit for each gene: float64, shape (genome_size,) each."""
