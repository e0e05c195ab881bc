"""Genes over the generations of a run."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Genome, Genomes, best_first
from swarmwright.common.errors import InputError
from swarmwright.controllers import REPRESENTATIONS

if TYPE_CHECKING:
    from swarmwright.runs.run import Run
    from swarmwright.servers.rows import GenerationResult

Of = Literal["best", "mean", "spread"]
"""The best candidate of a generation, the mean of its candidates, or their standard deviation."""
_MOST_BYTES = 1 << 27
"""Approximate number of bytes to read; if generations are large, fewer are shown."""


@dataclass(frozen=True, eq=False)
class GeneHistory:
    """Genes of some generations, which are evenly spaced if there are many."""

    of: Of
    generations: NDArray[np.int64]
    """(generations,), ascending."""
    candidates: NDArray[np.int64]
    """(generations,), index of the best candidate in each."""
    values: NDArray[np.float32]
    """(generations, groups); the mean if several genes share a group."""
    first_genes: NDArray[np.int64]
    """(groups,), index of the first gene of each group."""
    genes: int
    """Number of genes of a genome."""
    names: tuple[str, ...]
    """(genes,); empty if the representation has no names for them."""


def gene_history(run: "Run", of: Of = "best", *, generations: int = 200, groups: int = 256) -> GeneHistory:
    """Return the genes of a run over its generations.

    Args:
        run: a run with at least one finished generation.
        of: genes to return: those of the best candidate, or the mean or standard deviation over all
            candidates; the latter is 0 if all candidates have the same gene.
        generations: largest number of generations, 2 to 2,000; fewer if generations are large.
        groups: largest number of rows, 1 to 2,000; if there are more genes, neighbouring genes share a row.

    Raises InputError if a number is out of range, the run has no generation, or the store is damaged.
    """
    if of not in get_args(Of):
        raise InputError(f"of: must be {', '.join(get_args(Of)[:-1])} or {get_args(Of)[-1]}, not {of!r}")
    for name, value, least in (("generations", generations, 2), ("groups", groups, 1)):
        if not least <= value <= 2000:
            raise InputError(f"{name}: must be from {least} to 2000, not {value}")
    if not run.generations:
        raise InputError(f"{run.path}: has no finished generation")
    chosen = np.unique(np.linspace(0, run.generations - 1, _count_readable(run, generations)).round())
    numbers, candidates, rows = [], [], []
    for result in run._store.read_generations(chosen.astype(int).tolist()):
        best = int(best_first(result.fitness)[0])
        numbers.append(result.generation)
        candidates.append(best)
        rows.append(_row_of(result, of, best))
    genes = len(rows[0])
    edges = np.linspace(0, genes, min(groups, genes) + 1).astype(np.int64)
    sums = np.add.reduceat(np.array(rows), edges[:-1], axis=1)
    return GeneHistory(
        of,
        np.array(numbers, dtype=np.int64),
        np.array(candidates, dtype=np.int64),
        (sums / np.diff(edges)).astype(np.float32),
        edges[:-1],
        genes,
        _find_names(run, genes),
    )


def _count_readable(run: "Run", most: int) -> int:
    """Return the number of generations to read within the byte limit, at least two if there are two."""
    bytes_each = run._store.measure_generation_bytes()
    return max(1, min(run.generations, most, max(2, _MOST_BYTES // max(bytes_each, 1))))


def _row_of(result: "GenerationResult", of: Of, best: int) -> NDArray[np.float64]:
    genomes = result.genomes
    if of == "best":
        genome: Genome = genomes.genomes(best, 1)[0] if isinstance(genomes, _engine.Sample) else genomes[best]
        return genome.astype(np.float64)
    every: Genomes = result.expand_genomes()
    row: NDArray[np.float64] = (every.mean if of == "mean" else every.std)(axis=0, dtype=np.float64)
    return row


def _find_names(run: "Run", genes: int) -> tuple[str, ...]:
    """Return the names of the genes; empty if the representation is unknown here.

    Plug-ins are excluded, since viewing a run must not execute their code.
    """
    if run.experiment.controller.kind not in REPRESENTATIONS.built_in:
        return ()
    try:
        names = run.experiment.representation().gene_names
    except InputError:  # the simulation is not installed
        return ()
    return names if len(names) == genes else ()
