"""Post-evaluation: a candidate's fitness in episodes with held-out seeds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.core.errors import InputError, RunError
from swarmwright.core.statistics import Estimate, Summary, estimate, quantile
from swarmwright.core.untrusted import one_line
from swarmwright.evaluation.base import Backend, Controllers, Progress, Servers
from swarmwright.evaluation.opening import open_backend
from swarmwright.experiment.experiment import Experiment
from swarmwright.rankings import Ranking
from swarmwright.runs.code import used_for
from swarmwright.simulations import catalogue
from swarmwright.store import StoreReader
from swarmwright.typing import Genome

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


EPISODES = 60
"""Episodes of a post-evaluation, unless another number is given."""
_FIRST = 1_000_000_000  # far from the seeds that runs use
_SHARE = 0.05  # of a run's episodes, at most, are spent on evaluating its best after it
_LEAST = 10  # episodes; fewer are not informative
_PROBED = 200  # evaluations of a run from which on it is tried whether fitness depends on the seed


@dataclass(frozen=True, kw_only=True)
class PostEvaluation:
    """A candidate's recorded fitness, and its fitness in other episodes."""

    number: int
    """Of the evaluation in the whole run, from 0."""
    generation: int
    candidate: int
    recorded: float
    """Fitness in the record, by which it was chosen."""
    seeds: list[int]
    """Simulation seed of each episode."""
    seen: int
    """How many of these seeds the run had used as well."""
    episodes: NDArray[np.float64]
    """(episodes,) fitness of each, NaN where it failed."""
    ranking: Ranking
    """Of the experiment."""

    @cached_property
    def measured(self) -> list[float]:
        """Fitness of the episodes that did not fail."""
        return [value for value in self.episodes.tolist() if math.isfinite(value)]

    @property
    def failed(self) -> int:
        """Episodes that failed."""
        return len(self.episodes) - len(self.measured)

    @cached_property
    def mean(self) -> Estimate:
        """Mean fitness of an episode, with Student's interval."""
        return estimate(self.measured)

    @cached_property
    def fitness(self) -> Estimate:
        """Fitness as the experiment's ranking makes it of its number of episodes: beside `recorded`.

        With the aggregate mean it is the mean of the episodes.
        """
        return estimate(
            [value for value in self.ranking.samples(self.measured).tolist() if math.isfinite(value)]
        )

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values."""
        ordered = sorted(self.measured)
        return {
            "number": self.number,
            "generation": self.generation,
            "candidate": self.candidate,
            "recorded": self.recorded,
            "fitness": vars(self.fitness),
            "episodes": len(self.episodes),
            "failed": self.failed,
            "seed": self.seeds[0],
            "seeds_of_the_run": self.seen,
            "mean": self.mean.mean,
            "standard_deviation": self.mean.standard_deviation,
            "standard_error": self.mean.standard_error,
            "median": quantile(ordered, 0.5),
            "min": ordered[0] if ordered else math.nan,
            "max": ordered[-1] if ordered else math.nan,
            "confidence": 0.95,
            "interval": "t",
            "low": self.mean.low,
            "high": self.mean.high,
            "seeds": self.seeds,
            "values": self.episodes.tolist(),
        }

    def stored(self) -> dict[str, Any]:
        """Return the values that a run's store keeps."""
        values = [value if math.isfinite(value) else None for value in self.episodes.tolist()]
        return {
            "number": self.number, "generation": self.generation, "candidate": self.candidate,
            "recorded": self.recorded, "seeds": self.seeds, "seen": self.seen, "episodes": values,
        }  # fmt: skip

    @classmethod
    def of_store(cls, values: dict[str, Any], ranking: Ranking) -> Self:
        """Return a post-evaluation from the values that a store keeps."""
        episodes = [math.nan if value is None else value for value in values["episodes"]]
        return cls(**{**values, "episodes": np.array(episodes, dtype=np.float64)}, ranking=ranking)


def post_evaluate(
    run: "Run",
    candidate: int | None = None,
    generation: int | None = None,
    *,
    episodes: int = EPISODES,
    seed: int | None = None,
    experiment: Experiment | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> PostEvaluation:
    """Evaluate a candidate of a run in other episodes than those it was chosen by.

    Wherever fitness depends on the seed, the best of many evaluations is biased: its recorded fitness is too
    high. New episodes estimate it without bias. Nothing is added to the run.

    Args:
        run: where the candidate is recorded.
        candidate: as in `Run.evaluation`; without both, the best of the run.
        generation: as in `Run.evaluation`.
        episodes: how many, from 1 on.
        seed: simulation seed of the first episode, the next ones follow; default: seeds that the run did not
            use, the same ones for every run whose `parameters.seed` is the same.
        experiment: instead of the run's, with other parameters, say; the controller's sizes are the same.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Raises:
        InputError: there is no such candidate, or a number is out of range.
        RunError: no broker, no fitting server, or every episode failed.
    """
    if episodes < 1:
        raise InputError(f"episodes: must be at least 1, not {episodes}")
    evaluation = run.evaluation(candidate, generation)
    used = run.store.used_seeds()
    if seed is None:
        seeds = unseen_seeds(run.experiment.first_seed, used, episodes)
    elif not 0 <= seed <= 2**63 - episodes:
        raise InputError(f"seed: must be from 0 to 2**63 - {episodes}, not {seed}")
    else:
        seeds = list(range(seed, seed + episodes))
    experiment = experiment or used_for(run, evaluation.generation)
    with open_backend(experiment, broker=broker, servers=servers, most=len(seeds)) as backend:
        values = _evaluated(experiment, backend, evaluation.genome, seeds, on_progress)
    return PostEvaluation(
        number=evaluation.number,
        generation=evaluation.generation,
        candidate=evaluation.candidate,
        recorded=evaluation.fitness,
        seeds=seeds,
        seen=len(used.intersection(seeds)),
        episodes=values,
        ranking=experiment.new_ranking(),
    )


def of_run(run: "Run") -> PostEvaluation | None:
    """Return the best of a run on held-out seeds, if it was evaluated when the run ended."""
    values = run.store.unseen()
    if values is None or values["number"] != run.evaluation().number:
        return None  # the run went on, and another one is the best
    return PostEvaluation.of_store(values, run.experiment.new_ranking())


def after_run(
    experiment: Experiment, reader: StoreReader, backend: Backend, on_progress: Progress | None
) -> PostEvaluation | None:
    """Return the best of a run that has ended on held-out seeds; None where that would add nothing.

    It is done where the fitness depends on the seed, judged by `ranking.seeds`, by the episodes in the
    record, or, of a simulation that is here, by trying. At most a twentieth of the run's episodes are spent.

    Raises RunError as `post_evaluate`.
    """
    last = reader.last()
    asked = experiment.ranking.unseen_episodes
    count = _affordable(experiment, last) if asked is None else asked
    if last is None or count == 0 or not (asked or _depends(experiment, reader, last, backend)):
        return None
    best = reader.evaluation(None, None)
    seeds = unseen_seeds(experiment.first_seed, reader.used_seeds(), count)
    values = _evaluated(experiment, backend, best.genome, seeds, on_progress)
    found = PostEvaluation(
        number=best.number,
        generation=best.generation,
        candidate=best.candidate,
        recorded=best.fitness,
        seeds=seeds,
        seen=0,
        episodes=values,
        ranking=experiment.new_ranking(),
    )
    nothing_new = found.fitness.mean == best.fitness and len(set(found.measured)) == 1 and not found.failed
    return None if nothing_new and not asked else found


def unseen_seeds(first: int, used: set[int], count: int) -> list[int]:
    """Return simulation seeds that are none of `used`: the first ones from parameters.seed + 10**9 on."""
    seed = first + _FIRST if first < 2**62 else first - 2**61
    seeds: list[int] = []
    while len(seeds) < count:
        if seed not in used:
            seeds.append(seed)
        seed += 1
    return seeds


def _evaluated(
    experiment: Experiment,
    backend: Backend,
    genome: Genome,
    seeds: Sequence[int],
    on_progress: Progress | None,
) -> NDArray[np.float64]:
    representation = experiment.representation(backend.sensors, backend.actuators)
    if len(genome) != representation.genome_size:
        raise InputError(
            f"the run's controllers have {len(genome)} genes, those of this experiment have "
            f"{representation.genome_size}"
        )
    controllers = Controllers.of(representation, genome[np.newaxis])
    backend.post_evaluates()
    results = backend.evaluate(controllers, seeds, on_progress or (lambda *_: None))
    values: NDArray[np.float64] = results.fitness[0] + 0.0
    if not np.isfinite(values).any():
        reasons = results.journal.errors
        last = one_line(reasons[-1]) if reasons else "not known"
        raise RunError(f"every episode failed; the last reason: {last}")
    return values


def _affordable(experiment: Experiment, last: Summary | None) -> int:
    """Return how many episodes the budget allows: whole groups as the ranking takes them, 0 for too few."""
    group = experiment.ranking.episodes
    spent = 0 if last is None else last.evaluations * group
    count = min(max(EPISODES, 4 * group), int(spent * _SHARE))
    count -= count % group
    return count if count >= max(_LEAST, group) else 0


def _depends(experiment: Experiment, reader: StoreReader, last: Summary, backend: Backend) -> bool:
    """Whether fitness depends on the seed."""
    ranking = experiment.ranking
    if ranking.seeds == "new":
        return True
    if ranking.episodes > 1:
        ends = (*reader.one_generation(last.generation), *reader.one_generation(0))
        return any(_differ(one.episodes) for one in ends)
    return _tried(experiment, reader, last, backend)


def _differ(rows: NDArray[np.float64]) -> bool:
    """Whether the episodes of any candidate, (candidates, episodes), came out differently."""
    return bool(((rows != rows[:, :1]) & np.isfinite(rows) & np.isfinite(rows[:, :1])).any())


def _tried(experiment: Experiment, reader: StoreReader, last: Summary, backend: Backend) -> bool:
    """Try two candidates with other seeds, where the simulation is here."""
    from swarmwright.evaluation.in_process import InProcessBackend  # noqa: PLC0415 - only where it is evaluated here

    if not catalogue.is_here(experiment.simulation) or last.evaluations < _PROBED:
        return False
    if experiment.simulation in catalogue.titles():
        backend = InProcessBackend(experiment)  # costs almost nothing, without network traffic
    genomes = np.stack([reader.evaluation(None, None).genome, reader.evaluation(0, 0).genome])
    first = experiment.first_seed
    representation = experiment.representation(backend.sensors, backend.actuators)
    seeds = [first, *unseen_seeds(first, set(), 2)]
    return _differ(backend.evaluate(Controllers.of(representation, genomes), seeds, lambda *_: None).fitness)
