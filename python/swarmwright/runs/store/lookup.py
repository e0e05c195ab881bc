"""Finding one evaluation in a store, and the best ones."""

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
from swarmwright.runs.store.blocks import Record, joined
from swarmwright.runs.store.generations import Generations, Row


@dataclass(frozen=True, eq=False)
class Evaluation(ComparedByValue):
    """One line of the record."""

    number: int
    """In the whole run, from 0."""
    generation: int
    candidate: int
    fitness: float
    """As the ranking made it; NaN when it failed."""
    seeds: list[int]
    """Simulation seed of each episode."""
    episodes: NDArray[np.float64]
    """(episodes,) fitness"""
    metrics: NDArray[np.float64]
    """(episodes, metrics)"""
    genome: Genome


@dataclass(frozen=True, eq=False)
class Best(ComparedByValue):
    """The evaluation that leads in the end; of equals, the first, in a run of `nsga2` one of the front."""

    fitness: float
    generation: int
    candidate: int
    genome: Genome


@dataclass(frozen=True)
class _Whole:
    """A generation that was read."""

    row: Row
    sample: _engine.Sample | None
    """What its genomes are made from; None where `part` has them."""
    part: Record

    def __contains__(self, number: int) -> bool:
        """Return whether the evaluation of this number in the run belongs to it."""
        return self.row.first <= number < self.row.summary.evaluations


_LOOKED_AT = 50
"""Evaluations that are read for each of the leading ones, at most: many may have the same genome."""


class Lookup:
    """Finds evaluations in a store that is open, within `reading`, which says what damage is.

    Args:
        generations: of the store.
        folder: of the run, for messages.
        metrics: how many are stored.
        equals: finds the best of equals; None: it is the first.
    """

    def __init__(
        self, generations: Generations, folder: Path, metrics: int, equals: BestOfEquals | None
    ) -> None:
        self._generations = generations
        self._folder = folder
        self._metrics = metrics
        self._equals = equals

    def leading(
        self,
        count: int,
        *,
        last_only: bool = False,
        by_instance: bool = False,
        key: Callable[[Genome], object] = bytes,
    ) -> list[Evaluation]:
        """Return the best evaluation of the run, and the next best with other genomes, the best first.

        Args:
            count: how many, at most. Fewer where there are fewer genomes whose evaluation has not failed.
            last_only: whether those beside the best are of the last generation only.
            by_instance: whether genomes were evaluated on one instance after the other, so that those with
                the most evaluations are the best.
            key: the same for genomes that count as one, such as those of the same controller.
        """
        row, number = self._place(None, None)
        whole = self._whole(row)
        best = self._line(whole, number)
        found, known = [best], {key(best.genome)}
        last = self._generations.last()
        first = last.first if last_only and last is not None else 0
        numbers: Sequence[int] = ()
        if count > 1 and by_instance:
            numbers = self._generations.by_instances(_LOOKED_AT * count)
        elif count > 1:
            numbers = self._generations.by_fitness(first, _LOOKED_AT * count).tolist()
        for number in numbers:
            if len(found) >= count:
                break
            if number not in whole:  # the best ones are often of the same generation
                whole = self._whole(self._place(number, None)[0])
            candidate_line = self._line(whole, number)
            if key(candidate_line.genome) not in known:
                known.add(key(candidate_line.genome))
                found.append(candidate_line)
        return found

    def evaluation(self, candidate: int | None, generation: int | None) -> Evaluation:
        """Return one evaluation; None as in `Run.evaluation`."""
        row, number = self._place(candidate, generation)
        return self._line(self._whole(row), number)

    def leader(self, generation: int) -> Evaluation:
        """Return the evaluation that would be the best of the run if it had ended after this generation."""
        row = self.row(generation)
        equals = self._equals
        number = row.leader if equals is None else equals.number(self._generations, row)
        return self.evaluation(number, None)

    def evaluations_of(self, evaluation: Evaluation) -> list[Evaluation]:
        """Return the evaluations of the same genome up to `one`, which is the last of them."""
        numbers = self._generations.of_genome(evaluation.genome.astype("<f4").tobytes(), evaluation.number)
        return [self.evaluation(number, None) for number in numbers[:-1]] + [evaluation]

    def best(self) -> Best | None:
        """Return the best evaluation; None when there is none."""
        if self._generations.last() is None:
            return None
        evaluation = self.evaluation(None, None)
        return Best(evaluation.fitness, evaluation.generation, evaluation.candidate, evaluation.genome)

    def row(self, generation: int) -> Row:
        """Return a generation. Raises InputError without that one."""
        row = self._generations.row(generation)
        if row is None:
            last = self._generations.last()
            there = _range(0 if last is None else last.generation + 1, "generation")
            raise InputError(f"{self._folder}: holds {there}, not {generation}")
        return row

    def _whole(self, row: Row) -> _Whole:
        """Read a generation, compared with its digest."""
        sample = self._generations.sample(row)
        return _Whole(
            row, sample, joined(list(self._generations.evaluations(row, made=False)), self._metrics)
        )

    def _line(self, whole: _Whole, number: int | None) -> Evaluation:
        """Return an evaluation of a generation by its number in the run; None: the best."""
        row, part = whole.row, whole.part
        index = int(best_first(part.fitness)[0]) if number is None else number - row.first
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

    def _place(self, candidate: int | None, generation: int | None) -> tuple[Row, int | None]:
        """Return the generation of the evaluation that is meant, and its number; None for the best there."""
        if generation is None:
            if candidate is None:
                last = self._generations.last()
                if last is None:
                    raise RunError(nothing(self._folder))
                equals = self._equals
                candidate = last.leader if equals is None else equals.number(self._generations, last)
            row = self._generations.of_evaluation(candidate)
            if row is None:
                last = self._generations.last()
                there = _range(0 if last is None else last.summary.evaluations, "evaluation")
                raise InputError(f"{self._folder}: holds {there}, not {candidate}")
            return row, candidate
        row = self.row(generation)
        if candidate is None:
            return row, None
        if not 0 <= candidate < row.count:
            there = _range(row.count, "candidate")
            raise InputError(f"{self._folder}: generation {generation} has {there}, not {candidate}")
        return row, row.first + candidate


def nothing(folder: Path) -> str:
    """Say that there is no best candidate yet."""
    return f"{folder}: holds no finished generation, so there is no best candidate"


def _range(count: int, what: str) -> str:
    if count == 0:
        return f"no finished {what}"
    return f"one {what}, number 0" if count == 1 else f"the {what}s 0 to {count - 1}"
