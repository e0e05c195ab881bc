"""The diversity of the candidates of a generation."""

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


def diversity(run: "Run") -> NDArray[np.float64]:
    """Return the diversity of the candidates evaluated in each generation, (generations,).

    For numeric genes, it is the median distance of the candidates to their centroid, divided by that of the
    first generation: 1 is as diverse as at the beginning, 0 means that all are equal. Each gene is in units
    of its spread in the first generation (median absolute deviation); genes that did not vary there are
    excluded if others did. For genes that are choices, it is the mean share of genes in which two candidates
    differ, 0 to 1. NaN for a generation of a single candidate.
    """
    record = run.record
    starts = np.searchsorted(record.generation, np.arange(run.generations + 1))
    generations = [record.genomes[begin:end] for begin, end in pairwise(starts)]
    if not generations:
        return np.empty(0)
    if not run.experiment.representation().continuous:
        return np.array([_disagreement(genomes) for genomes in generations])
    scale = _scale(generations[0])
    spreads = np.array([_spread(genomes, scale) for genomes in generations])
    first = spreads[0]
    return spreads / first if first > 0 else spreads


def _scale(genomes: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the unit of each gene; infinite for excluded genes."""
    middle = np.median(genomes, axis=0)
    spread = np.median(np.abs(genomes - middle), axis=0).astype(np.float64)
    if not (spread > 0).any():
        return np.ones(len(spread))
    return np.where(spread > 0, spread, np.inf)


def _spread(genomes: NDArray[np.float32], scale: NDArray[np.float64]) -> float:
    if len(genomes) < 2:
        return float("nan")
    scaled = genomes / scale
    scaled -= scaled.mean(axis=0)
    return float(np.median(np.sqrt(np.einsum("ij,ij->i", scaled, scaled))))


def _disagreement(genomes: NDArray[np.float32]) -> float:
    """Return the mean share of genes in which two candidates differ."""
    count = len(genomes)
    if count < 2:
        return float("nan")
    ordered = np.sort(genomes, axis=0)
    alike = 0.0
    for column in ordered.T:
        borders = np.flatnonzero(np.concatenate([[True], column[1:] != column[:-1], [True]]))
        sizes = np.diff(borders).astype(np.float64)
        alike += float((sizes * (sizes - 1)).sum())
    pairs: int = genomes.shape[1] * count * (count - 1)
    return 1.0 - alike / pairs
