"""Races: numbers of remaining candidates by episode or instance, and which candidates were dropped."""

from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.methods.rankings.race import Race, RaceOptions
from swarmwright.runs.instances import averages_instances

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

Unit = Literal["episodes", "instances"]
State = Literal["remained", "dropped", "failed", "not evaluated again"]
_MOST_EVALUATIONS = 1_000_000
"""Largest number of evaluations of an iterated racing run in which races are identified by genomes."""


class Entrant(NamedTuple):
    """A candidate of a race, at its last evaluation in the race."""

    generation: int
    candidate: int
    steps: int
    """Number of episodes, or of instances, on which it was evaluated in this race."""
    fitness: float
    state: State
    """State; "not evaluated again" is an elite of a former race, evaluated neither at the end nor later."""


@dataclass(frozen=True, eq=False)
class Races:
    """The races of a run, evenly spaced if there are many."""

    unit: Unit
    """Episodes with `ranking: race`, whose races are generations; instances with the method `racing`."""
    numbers: NDArray[np.int64]
    """(races,), the generation, or the number of the race from 0."""
    count: int
    """Number of all races of the run."""
    steps: NDArray[np.int64]
    """(steps,), numbers of episodes or instances, ascending from 1."""
    candidates: NDArray[np.int64]
    """(races,), number of candidates at the start."""
    remaining: NDArray[np.float64]
    """(races, steps), candidates with at least that many evaluations; NaN after the end of a race."""


def has_races(run: "Run") -> bool:
    """Return whether a run has races: by its ranking or its method."""
    experiment = run.experiment
    return run.generations > 0 and (
        isinstance(experiment.ranking, RaceOptions) or averages_instances(experiment)
    )


def races(run: "Run", *, most: int = 150, most_steps: int = 200) -> Races:
    """Return the numbers of remaining candidates in the races of a run.

    Args:
        run: a run of `racing`, or with `ranking: race`.
        most: largest number of races, 1 to 2,000.
        most_steps: largest number of counts of episodes or instances, 1 to 2,000.

    Raises InputError for another run, and for numbers that are out of range.
    """
    for name, value in (("most", most), ("most_steps", most_steps)):
        if not 1 <= value <= 2000:
            raise InputError(f"{name}: must be from 1 to 2000, not {value}")
    _check(run)
    if isinstance(run.experiment.ranking, RaceOptions):
        return _count_by_episodes(run, most, most_steps)
    return _count_by_instances(run, most, most_steps)


def entrants(run: "Run", number: int) -> list[Entrant]:
    """Return the candidates of a race, those with the most episodes or instances first, then by fitness.

    Args:
        run: a run as in `races`.
        number: the generation, or the number of the race.

    Raises InputError for another run, or a race that does not exist.
    """
    _check(run)
    entered = (
        _enter_episodes(run, number)
        if isinstance(run.experiment.ranking, RaceOptions)
        else _enter_instances(run, number)
    )
    return sorted(
        entered,
        key=lambda entrant: (-entrant.steps, -np.nan_to_num(entrant.fitness, nan=-np.inf), entrant.candidate),
    )


def _check(run: "Run") -> None:
    if not has_races(run):
        raise InputError(f"{run.path}: has no races; use a run of racing, or with ranking: race")


def _space(count: int, most: int) -> list[int]:
    """Return at most `most` evenly spaced numbers from 0 to `count` - 1, including the last."""
    spaced: list[int] = np.unique(np.linspace(0, count - 1, min(count, most)).round()).astype(int).tolist()
    return spaced


def _count_by_episodes(run: "Run", most: int, most_steps: int) -> Races:
    episodes = run.experiment.ranking.episodes
    steps = np.array(_space(episodes, most_steps)) + 1
    numbers, candidates, rows = [], [], []
    for result in run._store.read_generations(_space(run.generations, most)):
        # Skipped episodes have no result. If the last one failed, only the tests show it; see `entrants`.
        present = np.isfinite(result.episodes)
        lengths = np.where(present.any(axis=1), episodes - present[:, ::-1].argmax(axis=1), 0)
        numbers.append(result.generation)
        candidates.append(len(lengths))
        rows.append([int((lengths >= step).sum()) for step in steps.tolist()])
    return Races(
        "episodes", np.array(numbers), run.generations, steps, np.array(candidates), np.array(rows, float)
    )


def _enter_episodes(run: "Run", number: int) -> list[Entrant]:
    ranking = run.experiment.new_ranking()
    assert isinstance(ranking, Race)
    results = list(run._store.read_generations([number]))
    if not results:
        raise InputError(f"race: {run.path} has no generation {number}")
    (result,) = results
    lengths = ranking.count_episodes(result.episodes)
    entered = []
    for candidate, (length, fitness) in enumerate(
        zip(lengths.tolist(), result.fitness.tolist(), strict=True)
    ):
        state: State = "remained" if length >= result.episodes.shape[1] else "dropped"
        entered.append(
            Entrant(number, candidate, length, fitness, state if np.isfinite(fitness) else "failed")
        )
    return entered


def _count_by_instances(run: "Run", most: int, most_steps: int) -> Races:
    split = _split(run)
    chosen = _space(len(split), most)
    longest = max(len(race) for race in split)
    steps = np.array(_space(longest, most_steps)) + 1
    remaining = np.full((len(chosen), len(steps)), np.nan)
    candidates = []
    for row, number in enumerate(chosen):
        race = split[number]
        genomes = {key for step in race for key in step.keys}
        candidates.append(len(genomes))
        sizes = [len(step.keys) for step in race]
        for column, step in enumerate(steps.tolist()):
            if step <= len(race):
                remaining[row, column] = sizes[step - 1]
    return Races("instances", np.array(chosen), len(split), steps, np.array(candidates), remaining)


class _Step(NamedTuple):
    """What is kept of an instance."""

    keys: list[bytes]
    """Digests of its genomes, which tell them apart."""
    generation: int
    fitness: list[float]


@lru_cache(maxsize=1)
def _split(run: "Run") -> list[list[_Step]]:
    """Return the instances of each race; a race begins with an instance that has new candidates.

    The last result is kept: all evaluations are read, and several questions about a run follow each other.
    """
    if run.evaluations > _MOST_EVALUATIONS:
        raise InputError(
            f"{run.path}: has {run.evaluations:,} evaluations; races are told apart in up to "
            f"{_MOST_EVALUATIONS:,}"
        )
    former: set[bytes] = set()
    split: list[list[_Step]] = []
    for result in run._store.generations():
        if result.generation >= run.generations:
            break
        keys = [blake2b(genome.tobytes(), digest_size=16).digest() for genome in result.expand_genomes()]
        if not former.issuperset(keys) or not split:
            split.append([])
        former.update(keys)
        split[-1].append(_Step(keys, result.generation, result.fitness.tolist()))
    return split


def _enter_instances(run: "Run", number: int) -> list[Entrant]:
    split = _split(run)
    if not 0 <= number < len(split):
        raise InputError(f"race: {run.path} has races 0 to {len(split) - 1}, but no race {number}")
    race = split[number]
    former = {key for earlier in split[:number] for step in earlier for key in step.keys}
    later = {key for following in split[number + 1 :] for step in following for key in step.keys}
    final = {*race[-1].keys, *later}
    counts: dict[bytes, int] = {}
    last: dict[bytes, tuple[int, int, float]] = {}
    for step in race:
        for candidate, (key, fitness) in enumerate(zip(step.keys, step.fitness, strict=True)):
            counts[key] = counts.get(key, 0) + 1
            last[key] = step.generation, candidate, fitness
    entered = []
    for key, (generation, candidate, fitness) in last.items():
        state: State = "not evaluated again" if key in former else "dropped"
        if not np.isfinite(fitness):
            state = "failed"
        elif key in final:
            state = "remained"
        entered.append(Entrant(generation, candidate, counts[key], fitness, state))
    return entered
