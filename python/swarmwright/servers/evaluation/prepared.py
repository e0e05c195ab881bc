"""Evaluation of genomes by the engine without Python, prepared once for equal experiments."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Fitness
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.processes import use_threads
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.experiment.derived import evaluation_key
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.unavailable import ranking_of
from swarmwright.methods.rankings.absolute import Absolute
from swarmwright.servers.evaluation.base import Progress
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.evaluation.seeds import seeds_of
from swarmwright.simulations import catalogue

_MAX_CACHED = 16
"""Size of the cache."""


class PreparedEvaluation(NamedTuple):
    """Everything needed to compute the fitness of genomes."""

    evaluator: _engine.Evaluator
    genome_size: int
    ranking: Absolute
    first_seed: int
    """`parameters.seed`"""
    seeds: Sequence[int]
    """Of the episodes of generation 0."""

    def scores(
        self, genomes: NDArray[np.float32], on_progress: Progress | None, generation: int = 0
    ) -> Fitness:
        """Return the fitness of genomes, (candidates, genome_size), on the seeds of a generation.

        Raises InputError for genomes of a wrong shape or that are not finite, and for an experiment that
        cannot be run; RunError in a process that was forked after the engine had started its threads.
        """
        check_size(genomes, self.genome_size)
        seeds = seeds_of(self.ranking, self.first_seed, generation) if generation else self.seeds
        options = self.ranking.options
        use_threads()
        try:
            with engine_errors():
                return self.evaluator.scores(genomes, seeds, options.aggregate, options.level, on_progress)
        except InputError:
            check_finite(genomes)
            raise


_cache: dict[tuple[bytes, type, type, type, type], PreparedEvaluation | None] = {}


def prepare_evaluation(experiment: Experiment) -> PreparedEvaluation | None:
    """Prepare the evaluation of an experiment's genomes in this process; None if it involves Python.

    Equal experiments share the result. Raises InputError if the experiment cannot be run.
    """
    if experiment.simulation not in catalogue.titles() or experiment.fitness is not None:
        return None
    key = _key(experiment)
    if key is None:
        return _prepare(experiment)
    if key not in _cache:
        if len(_cache) >= _MAX_CACHED:
            _cache.clear()
        _cache[key] = _prepare(experiment)
    return _cache[key]


def _key(experiment: Experiment) -> tuple[bytes, type, type, type, type] | None:
    """Return the cache key of an experiment; None if it cannot be compared."""
    content = evaluation_key(experiment)
    if content is None:
        return None
    representation = REPRESENTATIONS.get(experiment.controller.kind)
    ranking = ranking_of(experiment.ranking)
    return content, type(experiment.controller), representation, type(experiment.ranking), ranking


def _prepare(experiment: Experiment) -> PreparedEvaluation | None:
    ranking = experiment.new_ranking()
    seeds = ranking.seeds(experiment.first_seed)
    with open_backend(experiment, servers="in-process") as backend:
        representation = experiment.representation(backend.sensors, backend.actuators)
        evaluator = backend.evaluator(dict(representation.architecture()))
    genes_are_weights = type(representation).weights is Representation.weights
    if evaluator is None or type(ranking) is not Absolute or not genes_are_weights:
        return None
    return PreparedEvaluation(evaluator, representation.genome_size, ranking, experiment.first_seed, seeds)


def check_size(genomes: NDArray[np.float32], genome_size: int) -> None:
    """Raise InputError unless genomes have the shape (candidates, genome_size)."""
    if genomes.shape[1] != genome_size:
        raise InputError(
            f"genomes: have {genomes.shape[1]} genes; this experiment's controllers have {genome_size}"
        )


def check_finite(genomes: NDArray[np.float32]) -> None:
    """Raise InputError for genes that are NaN or infinite."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = genomes.sum()  # cheap first test: finite only if all genes are
    if not (np.isfinite(total) or np.isfinite(genomes).all()):
        bad = int(np.flatnonzero(~np.isfinite(genomes).all(axis=1))[0])
        raise InputError(f"genomes: row {bad} has a gene that is not finite")
