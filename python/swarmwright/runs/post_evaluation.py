"""Post-evaluation: a candidate's fitness in episodes with held-out seeds."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright.core.arguments import checked
from swarmwright.core.errors import InputError, RunError
from swarmwright.core.statistics import Estimate, estimate, quantile
from swarmwright.core.untrusted import one_line
from swarmwright.evaluation.base import Backend, Controllers, Progress, Results, Servers
from swarmwright.evaluation.metrics import asked_for
from swarmwright.evaluation.opening import open_backend
from swarmwright.experiment.experiment import Experiment, experiment_of
from swarmwright.rankings import Ranking
from swarmwright.runs.code import used_for
from swarmwright.typing import Genomes

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


EPISODES = 100
"""Episodes of a post-evaluation, unless another number is given."""
_FIRST = 1_000_000_000  # far from the seeds that runs use


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
    """How many of these seeds the evolution of the run had used as well."""
    validated: int = 0
    """How many of these seeds the run's own validation had used as well: there, the results are no further
    evidence."""
    episodes: NDArray[np.float64]
    """(episodes,) fitness of each, NaN where it failed."""
    ranking: Ranking
    """Of the experiment."""
    metrics: dict[str, NDArray[np.float64]]
    """By name, (episodes,) each, NaN where the episode failed: those that the fitness needs, and those that
    were asked for."""

    @cached_property
    def measured(self) -> list[float]:
        """Fitness of the episodes that did not fail."""
        return _finite_of(self.episodes)

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
        return estimate(_finite_of(self.ranking.samples(self.measured)))

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
            "seeds_of_the_validation": self.validated,
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
            "metrics": {
                name: {
                    **vars(estimate(_finite_of(column))),
                    "without": len(column) - len(_finite_of(column)),
                    "values": column.tolist(),
                }
                for name, column in self.metrics.items()
            },
        }

    def summary(self) -> dict[str, Any]:
        """Return plain values, without those of each episode."""
        return {
            "number": self.number,
            "generation": self.generation,
            "candidate": self.candidate,
            "recorded": self.recorded,
            **{"fitness" if key == "mean" else key: value for key, value in vars(self.fitness).items()},
            "failed": self.failed,
        }

    def stored(self) -> dict[str, Any]:
        """Return the values that exported packages keep."""
        return {
            "number": self.number, "generation": self.generation, "candidate": self.candidate,
            "recorded": self.recorded, "seeds": self.seeds, "seen": self.seen,
            "episodes": finite(self.episodes),
        }  # fmt: skip

    @classmethod
    def of_store(cls, values: Mapping[str, Any], ranking: Ranking) -> Self:
        """Return a post-evaluation from the values that a run's store keeps of a validation."""
        episodes, names = numbers(values["episodes"]), values["metrics"]
        columns = numbers(values.get("values", [])).reshape(len(episodes), len(names)).T
        others = {
            key: values[key] for key in ("number", "generation", "candidate", "recorded", "seeds", "seen")
        }
        metrics = dict(zip(names, columns, strict=True))
        return cls(**others, episodes=episodes, ranking=ranking, metrics=metrics)


@checked
def post_evaluate(
    run: "Run | str | Path",
    candidate: int | None = None,
    generation: int | None = None,
    *,
    episodes: int = EPISODES,
    seed: int | None = None,
    experiment: Experiment | str | Path | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
    metrics: Sequence[str] | Literal["all"] = (),
) -> PostEvaluation:
    """Evaluate a candidate of a run in other episodes than those it was chosen by.

    Wherever fitness depends on the seed, the best of many evaluations is biased: its recorded fitness is too
    high. New episodes estimate it without bias. Nothing is added to the run.

    Args:
        run: where the candidate is recorded, or its folder.
        candidate: as in `Run.evaluation`; without both, the best of the run.
        generation: as in `Run.evaluation`.
        episodes: how many, from 1 on; where a fitness is made of several, such as a median, at least these.
        seed: simulation seed of the first episode, the next ones follow; default: held-out seeds, which the
            evolution of the run did not use. They are the same for every run whose `parameters.seed` is the
            same, and for its validation; for fresh ones, name another seed.
        experiment: instead of the run's, with other parameters, say; the controller's sizes are the same.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.
        metrics: names of metrics to be measured beside those that the fitness needs; "all": those that the
            simulation announces.

    Raises:
        InputError: there is no such candidate or metric, or a number is out of range.
        RunError: no broker, no fitting server, or every episode failed.
    """
    from swarmwright.experiment.checks import makes_fitness  # noqa: PLC0415 - takes long, not for reading runs
    from swarmwright.runs.run import run_of  # noqa: PLC0415 - it imports this module

    run = run_of(run)
    if experiment is not None:
        experiment = experiment_of(experiment)
    if episodes < 1:
        raise InputError(f"episodes: must be at least 1, not {episodes}")
    evaluation = run.evaluation(candidate, generation)
    used = run.store.used_seeds()
    validated = set((run.store.validation() or {}).get("seeds", ()))
    if seed is None:
        seeds = unseen_seeds(run.experiment.first_seed, used, episodes)
    elif not 0 <= seed <= 2**63 - episodes:
        raise InputError(f"seed: must be from 0 to 2**63 - {episodes}, not {seed}")
    else:
        seeds = list(range(seed, seed + episodes))
    experiment = experiment or used_for(run, evaluation.generation)
    if not makes_fitness(experiment.ranking, episodes):
        needed = experiment.ranking.episodes
        raise InputError(
            f"episodes: must be at least ranking.episodes, {needed}, of which a fitness is made, not "
            f"{episodes}"
        )
    asked = asked_for(experiment, metrics)
    with open_backend(experiment, broker=broker, servers=servers, most=len(seeds), metrics=asked) as backend:
        results = evaluated(experiment, backend, evaluation.genome[np.newaxis], seeds, on_progress)
        names = backend.metrics
    return PostEvaluation(
        number=evaluation.number,
        generation=evaluation.generation,
        candidate=evaluation.candidate,
        recorded=evaluation.fitness,
        seeds=seeds,
        seen=len(used.intersection(seeds)),
        validated=len(validated.intersection(seeds)),
        episodes=results.fitness[0] + 0.0,
        ranking=experiment.new_ranking(),
        metrics=dict(zip(names, results.metrics[0].T + 0.0, strict=True)),
    )


def unseen_seeds(first: int, used: set[int], count: int, begin: int | None = None) -> list[int]:
    """Return simulation seeds that are none of `used`, the first ones from `begin` on.

    Default of `begin`: parameters.seed, which is `first`, + 10**9.
    """
    seed = begin if begin is not None else first + _FIRST if first < 2**62 else first - 2**61
    seeds: list[int] = []
    while len(seeds) < count:
        if seed not in used:
            seeds.append(seed)
        seed += 1
    return seeds


def evaluated(
    experiment: Experiment,
    backend: Backend,
    genomes: Genomes,
    seeds: Sequence[int],
    on_progress: Progress | None,
    *,
    may_fail: bool = False,
) -> Results:
    """Return the results of genomes, (candidates, genome_size), in an episode of each seed.

    Raises RunError when every episode failed, unless that may be.
    """
    representation = experiment.representation(backend.sensors, backend.actuators)
    if genomes.shape[1] != representation.genome_size:
        raise InputError(
            f"the run's controllers have {genomes.shape[1]} genes, those of this experiment have "
            f"{representation.genome_size}"
        )
    backend.post_evaluates()
    controllers = Controllers.of(representation, genomes)
    results = backend.evaluate(controllers, seeds, on_progress or (lambda *_: None))
    if not (may_fail or np.isfinite(results.fitness).any()):
        reasons = results.journal.errors
        last = one_line(reasons[-1]) if reasons else "not known"
        raise RunError(f"every episode failed; the last reason: {last}")
    return results


def _finite_of(values: NDArray[np.float64]) -> list[float]:
    return [value for value in values.tolist() if math.isfinite(value)]


def finite(values: NDArray[np.float64]) -> list[Any]:
    """Return numbers as nested lists, None in the place of those that are not finite."""
    if values.ndim > 1:
        return [finite(one) for one in values]
    return [value if math.isfinite(value) else None for value in values.tolist()]


def numbers(values: list[Any]) -> NDArray[np.float64]:
    """Return what `finite` was made of."""
    return np.array(values, dtype=np.float64)  # None becomes NaN
