"""Matches of competitions: those of a run's record, and new ones between any controllers."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.arguments import check_arguments
from swarmwright.common.arrays import Genome, Genomes
from swarmwright.common.errors import InputError
from swarmwright.controllers.kinds.team import Team
from swarmwright.experiment.competition import needed_metrics
from swarmwright.experiment.experiment import Experiment, as_experiment
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.runs.store import Evaluation
from swarmwright.servers.evaluation.base import Controllers, Progress, Results, Servers
from swarmwright.servers.evaluation.evaluate import log_failures
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.rows import WarningEntry
from swarmwright.simulations.fitness import FitnessExpression

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

COLUMNS = ("candidate", "fitness", "score")
"""Columns of each side in the record, after the metrics: SIDE.candidate and so on."""


def column_names(options: TournamentOptions) -> list[str]:
    """Return the names of the columns that a competition adds to the metrics of its record."""
    return [f"{side}.{column}" for side in options.sides or () for column in COLUMNS]


FIRST_SEED = 1_000_000_000
"""Seed of the first episode of a match that is not in the record; those of a run are not expected there."""
_CHUNK = 4096
"""Matches that are evaluated at once."""


class SideFitness:
    """Computes the fitness of each side of matches.

    options: with an expression for each side but the first, whose fitness is the experiment's.
    """

    def __init__(self, options: TournamentOptions) -> None:
        _, *others = options.sides.items()
        self._expressions = {name: FitnessExpression(text) for name, text in others}

    def __call__(
        self, names: Sequence[str], results: Results
    ) -> tuple[NDArray[np.float64], list[WarningEntry]]:
        """Return the fitness of each side, (matches, episodes, sides), and warnings.

        A match in which the fitness of any side has no value has failed for all: NaN.

        Args:
            names: names of the measured metrics.
            results: of matches.
        """
        measured = np.isfinite(results.fitness)
        positions = np.argwhere(measured)
        values = np.full((*results.fitness.shape, 1 + len(self._expressions)), np.nan)
        values[..., 0] = results.fitness
        warnings = []
        for side, (name, expression) in enumerate(self._expressions.items(), start=1):
            columns = [names.index(metric) for metric in expression.metrics]
            values[measured, side], faults = expression(
                results.fitness[measured], results.metrics[measured][:, columns]
            )
            for fault in faults:
                match, episode = positions[fault.index].tolist()
                error = f"fitness of {name}: {fault.reason}"
                warnings.append(WarningEntry.from_episode(episode, f": {error}", match, error))
        values[np.isnan(values).any(axis=2)] = np.nan
        return values, warnings


class Champion(NamedTuple):
    """The best candidate of a side in a generation."""

    generation: int
    evaluation: int
    """Number of its match in the run, from 0."""
    genome: Genome
    """Its own genes, (genes of the side,)."""


def sides_of(experiment: Experiment) -> list[str]:
    """Return the names of the sides of a competition, in the order of the joined genome.

    Raises InputError if the experiment is not a competition.
    """
    if not isinstance(experiment.ranking, TournamentOptions):
        raise InputError(
            "the experiment is not a competition: it has no ranking of the kind tournament and no populations"
        )
    return list(experiment.ranking.sides)


def slices_of(experiment: Experiment) -> dict[str, slice]:
    """Return the genes of each side in the joined genome. Raises InputError as `sides_of`."""
    sides = sides_of(experiment)
    representation = experiment.representation()
    assert isinstance(representation, Team)
    slices, first = {}, 0
    for name in sides:
        last = first + representation.parts[name].genome_size
        slices[name] = slice(first, last)
        first = last
    return slices


def champions(run: "Run", side: str) -> list[Champion]:
    """Return the champion of a side in each generation, in order.

    Raises InputError if the run is not a competition, or has no such side.
    """
    slices = slices_of(run.experiment)
    if side not in slices:
        raise InputError(f"side: {side!r} is none of {', '.join(slices)}")
    return [
        Champion(evaluation.generation, evaluation.number, evaluation.genome[slices[side]])
        for generation in range(run.generations)
        for evaluation in (_last_match(run, generation),)
    ]


def _last_match(run: "Run", generation: int) -> Evaluation:
    """Return the last match of a generation, which is that of its champions."""
    return run._store.evaluation(None, generation)


def stack_champions(run: "Run", generations: Sequence[int]) -> Genomes:
    """Return the champions of all sides, (generations, genome_size).

    Raises InputError for a generation that does not exist.
    """
    return np.stack([_last_match(run, generation).genome for generation in generations])


def join_champions(run: "Run", generations: Sequence[int]) -> Genome:
    """Return the joined genome of champions of different generations.

    generations: one of each side.

    Raises InputError if the run is not a competition, has another number of sides, or lacks a generation.
    """
    slices = slices_of(run.experiment)
    if len(generations) != len(slices):
        raise InputError(
            f"match: must have a generation of each of {', '.join(slices)}, not {len(generations)} numbers"
        )
    genomes = stack_champions(run, generations)
    return np.concatenate([genome[cut] for genome, cut in zip(genomes, slices.values(), strict=True)])


def describe_champions(run: "Run") -> str | None:
    """Return the result of the last match of champions: `hunters -0.39, prey 0.39`.

    None if the run is not a competition, or has no generation.
    """
    options = run.experiment.ranking
    if not isinstance(options, TournamentOptions) or not run.history:
        return None
    evaluation = run._store.evaluation(run.history[-1].evaluations - 1, None)
    columns = evaluation.metrics[:, -len(COLUMNS) * len(options.sides) :]
    means = columns.reshape(len(columns), -1, len(COLUMNS))[..., 1].mean(axis=0)
    return ", ".join(f"{side} {mean + 0.0:.6g}" for side, mean in zip(options.sides, means, strict=True))


@check_arguments
def play(
    experiment: Experiment | str | PathLike[str],
    genomes: ArrayLike,
    seeds: Sequence[int],
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> NDArray[np.float64]:
    """Play matches, and return the fitness of each side, (matches, seeds, sides), NaN after failures.

    Args:
        experiment: a competition.
        genomes: joined genomes of all sides, (matches, genome_size).
        seeds: seeds of the episodes of each match.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Raises:
        InputError: the experiment is not a competition, or the genomes have another size.
        RunError: no broker or no matching server.
    """
    rows = np.ascontiguousarray(genomes, dtype=np.float32)
    return _play(
        as_experiment(experiment),
        rows.shape,
        lambda first, end: rows[first:end],
        seeds,
        broker=broker,
        servers=servers,
        on_progress=on_progress,
    )


def play_all(
    experiment: Experiment,
    genomes: Genomes,
    side: str,
    seeds: Sequence[int],
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> NDArray[np.float64]:
    """Let the controllers of one side each meet those of all other sides together; otherwise as `play`.

    Memory is that of the result: genomes are joined as they are needed.

    Args:
        experiment: a competition.
        genomes: joined genomes of all sides, (players, genome_size).
        side: whose part of each genome meets the rest of all genomes.
        seeds: seeds of the episodes of each match.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Returns:
        (players, players, seeds, sides): the first number is that of the controller of `side`.
    """
    own = slices_of(experiment)[side]
    count = len(genomes)

    def join(start: int, end: int) -> Genomes:
        players, opponents = np.divmod(np.arange(start, end), count)
        joined = genomes[opponents]
        joined[:, own] = genomes[players, own]
        return joined

    shape = count**2, genomes.shape[1]
    values = _play(experiment, shape, join, seeds, broker=broker, servers=servers, on_progress=on_progress)
    return values.reshape(count, count, len(seeds), -1)


def _play(
    experiment: Experiment,
    shape: tuple[int, ...],
    join: Callable[[int, int], Genomes],
    seeds: Sequence[int],
    *,
    broker: str | None,
    servers: Servers | None,
    on_progress: Progress | None,
) -> NDArray[np.float64]:
    """Play matches whose joined genomes, of this shape, `join` returns from a first to before another."""
    sides = sides_of(experiment)
    options = experiment.ranking
    assert isinstance(options, TournamentOptions)
    count, seeds = shape[0], [int(seed) for seed in seeds]
    fitness = SideFitness(options)
    values = np.full((count, len(seeds), len(sides)), np.nan)
    names = needed_metrics(options)
    total = count * len(seeds)
    with open_backend(experiment, broker=broker, servers=servers, metrics=names) as backend:
        representation = experiment.representation(backend.sensors, backend.actuators)
        if shape[1:] != (representation.genome_size,):
            raise InputError(f"genomes: shape is {shape}; expected (matches, {representation.genome_size})")
        for first in range(0, count, _CHUNK):
            end = min(first + _CHUNK, count)

            def progress(done: int, _: int, waiting_for: str, before: int = first * len(seeds)) -> None:
                if on_progress is not None:
                    on_progress(before + done, total, waiting_for)

            controllers = Controllers.from_genomes(representation, join(first, end))
            results = backend.evaluate(controllers, seeds, progress)
            values[first:end], warnings = fitness(backend.metrics, results)
            log_failures(backend, replace(results, journal=results.journal.with_warnings(warnings)))
    return values
