"""How different the candidates of a generation are from each other."""

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


def diversity(run: "Run") -> NDArray[np.float64]:
    """Return the diversity of the candidates evaluated in each generation, (generations,).

    For genes that are numbers: the median distance of the candidates to their centroid, each gene in units of
    its spread in the first generation (median absolute deviation; genes that did not vary there are left out
    where others did), divided by what the first generation has. So 1 is as diverse as at the beginning, 0 is
    all alike. For genes that are choices: the share of genes in which two candidates differ, 0 to 1. NaN for
    a generation of a single candidate.
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
    """Return the unit of each gene; infinite for one that is left out."""
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
    """Return in how many genes two different candidates differ, as a share, on average."""
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
