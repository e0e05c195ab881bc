"""Find evaluations in a store by number, or the best ones."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.arrays import Genome, best_first
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.json_text import loads
from swarmwright.common.values import ComparedByValue
from swarmwright.runs.store.best_of_equals import BestOfEquals
from swarmwright.runs.store.blocks import Record, concatenate_records
from swarmwright.runs.store.generations import Generations, Row


@dataclass(frozen=True, eq=False)
class Evaluation(ComparedByValue):
    """An evaluation in the record."""

    number: int
    """In the whole run, from 0."""
    generation: int
    candidate: int
    fitness: float
    """From the ranking; NaN if the evaluation failed or violates constraints."""
    seeds: list[int]
    """Simulation seed of each episode."""
    episodes: NDArray[np.float64]
    """(episodes,) fitness"""
    metrics: NDArray[np.float64]
    """(episodes, metrics)"""
    genome: Genome


@dataclass(frozen=True, eq=False)
class Best(ComparedByValue):
    """The best evaluation at the end; of equals the first, in a run of `nsga2` a member of the front."""

    fitness: float
    generation: int
    candidate: int
    genome: Genome


@dataclass(frozen=True)
class _Whole:
    """A generation in memory."""

    row: Row
    sample: _engine.Sample | None
    """Sample that its genomes are made from; None if `part` has the genomes."""
    part: Record

    def __contains__(self, number: int) -> bool:
        """Return whether the evaluation with this number in the run belongs to it."""
        return self.row.first <= number < self.row.summary.evaluations


_SEARCHED_PER_RESULT = 50
"""Largest number of evaluations read per returned evaluation, since many may have the same genome."""


class Lookup:
    """Finds evaluations in an open store; use it within `reading`, which reports damage.

    Args:
        generations: generations of the store.
        folder: folder of the run, for messages.
        metrics: number of stored metrics.
        equals: finds the best of equals; None chooses the first.
        ends_with_best: whether the last evaluation of a generation is its best, as the match of its champions
            is in a competition.
        violations: returns the violations of constraints of candidates by their metrics; None without any.
    """

    def __init__(
        self,
        generations: Generations,
        folder: Path,
        metrics: int,
        equals: BestOfEquals | None,
        *,
        ends_with_best: bool = False,
        violations: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
    ) -> None:
        self._generations = generations
        self._folder = folder
        self._metrics = metrics
        self._equals = equals
        self._ends_with_best = ends_with_best
        self._violations = violations

    def leading(
        self,
        count: int,
        *,
        last_only: bool = False,
        by_instance: bool = False,
        key: Callable[[Genome], object] = bytes,
    ) -> list[Evaluation]:
        """Return the best evaluations of the run with different genomes, the best first.

        Args:
            count: largest number of evaluations; fewer are returned if fewer genomes succeeded.
            last_only: take all except the best from the last generation.
            by_instance: whether genomes were evaluated instance by instance, so that those with the most
                evaluations are the best.
            key: returns equal values for equivalent genomes, such as those of the same controller.
        """
        row, number = self._locate(None, None)
        whole = self._read_generation(row)
        best = self._extract(whole, number)
        leading, keys = [best], {key(best.genome)}
        last = self._generations.last()
        first = last.first if last_only and last is not None else 0
        numbers: Sequence[int] = ()
        if count > 1 and by_instance:
            numbers = self._generations.rank_by_instances(_SEARCHED_PER_RESULT * count)
        elif count > 1:
            numbers = self._generations.rank_by_fitness(first, _SEARCHED_PER_RESULT * count).tolist()
        for number in numbers:
            if len(leading) >= count:
                break
            if number not in whole:  # the best are often from the same generation
                whole = self._read_generation(self._locate(number, None)[0])
            evaluation = self._extract(whole, number)
            if key(evaluation.genome) not in keys:
                keys.add(key(evaluation.genome))
                leading.append(evaluation)
        return leading

    def evaluation(self, candidate: int | None, generation: int | None) -> Evaluation:
        """Return an evaluation; None as in `Run.evaluation`."""
        row, number = self._locate(candidate, generation)
        return self._extract(self._read_generation(row), number)

    def leader(self, generation: int) -> Evaluation:
        """Return the best evaluation of the run up to this generation."""
        row = self.row(generation)
        equals = self._equals
        number = row.leader if equals is None else equals.number(self._generations, row)
        return self.evaluation(number, None)

    def evaluations_of(self, evaluation: Evaluation) -> list[Evaluation]:
        """Return all evaluations of the same genome up to this evaluation, in order."""
        numbers = self._generations.find_by_genome(
            evaluation.genome.astype("<f4").tobytes(), evaluation.number
        )
        return [self.evaluation(number, None) for number in numbers[:-1]] + [evaluation]

    def best(self) -> Best | None:
        """Return the best evaluation; None if there is none."""
        if self._generations.last() is None:
            return None
        evaluation = self.evaluation(None, None)
        return Best(evaluation.fitness, evaluation.generation, evaluation.candidate, evaluation.genome)

    def row(self, generation: int) -> Row:
        """Return a generation. Raises InputError if it does not exist."""
        row = self._generations.row(generation)
        if row is None:
            last = self._generations.last()
            available = _format_range(0 if last is None else last.generation + 1, "generation")
            raise InputError(f"{self._folder}: has {available}, but no generation {generation}")
        return row

    def _read_generation(self, row: Row) -> _Whole:
        """Read a generation and compare it with its digest."""
        sample = self._generations.sample(row)
        return _Whole(
            row,
            sample,
            concatenate_records(list(self._generations.evaluations(row, make_genomes=False)), self._metrics),
        )

    def _extract(self, whole: _Whole, number: int | None) -> Evaluation:
        """Return an evaluation of a generation by its number in the run; None for the best."""
        row, part = whole.row, whole.part
        if number is None:
            index = row.count - 1 if self._ends_with_best else self._find_best(part)
        else:
            index = number - row.first
        return Evaluation(
            row.first + index,
            row.generation,
            index,
            float(part.fitness[index]),
            loads(row.seeds),
            part.episodes[index],
            part.metrics[index],
            part.genomes[index] if whole.sample is None else whole.sample.genomes(index, 1)[0],
        )

    def _find_best(self, part: Record) -> int:
        """Return the index of the best candidate; that with the smallest violation if none is feasible."""
        index = int(best_first(part.fitness)[0])
        if self._violations is not None and np.isnan(part.fitness[index]):
            return int(np.argmin(self._violations(part.metrics)))
        return index

    def _locate(self, candidate: int | None, generation: int | None) -> tuple[Row, int | None]:
        """Return the generation of an evaluation and its number, None for the best of the generation."""
        if generation is None:
            if candidate is None:
                last = self._generations.last()
                if last is None:
                    raise RunError(explain_missing_best(self._folder))
                equals = self._equals
                candidate = last.leader if equals is None else equals.number(self._generations, last)
            row = self._generations.find_by_evaluation(candidate)
            if row is None:
                last = self._generations.last()
                available = _format_range(0 if last is None else last.summary.evaluations, "evaluation")
                raise InputError(f"{self._folder}: has {available}, but no evaluation {candidate}")
            return row, candidate
        row = self.row(generation)
        if candidate is None:
            return row, None
        if not 0 <= candidate < row.count:
            available = _format_range(row.count, "candidate")
            raise InputError(
                f"{self._folder}: generation {generation} has {available}, but no candidate {candidate}"
            )
        return row, row.first + candidate


def explain_missing_best(folder: Path) -> str:
    """Explain that there is no best candidate yet."""
    return f"{folder}: has no finished generation, so there is no best candidate"


def _format_range(count: int, noun: str) -> str:
    if count == 0:
        return f"no finished {noun}"
    return f"only {noun} 0" if count == 1 else f"{noun}s 0 to {count - 1}"
