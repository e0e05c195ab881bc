"""Post-evaluation: the fitness of a candidate, or of any controller, in episodes with held-out seeds."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from operator import index
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arguments import check_arguments
from swarmwright.common.arrays import Genomes, read_only_array
from swarmwright.common.errors import InputError
from swarmwright.common.html import facts
from swarmwright.common.statistics import Estimate, estimate, quantile
from swarmwright.common.values import ComparedByValue
from swarmwright.controllers.controller import Controller
from swarmwright.experiment.experiment import Experiment, experiment_of
from swarmwright.methods.rankings import Ranking
from swarmwright.runs.code import used_for
from swarmwright.runs.store import Evaluation
from swarmwright.servers.evaluation.base import Backend, Controllers, Progress, Results, Servers
from swarmwright.servers.evaluation.code_failures import build_error
from swarmwright.servers.evaluation.metrics import select_metrics
from swarmwright.servers.evaluation.module_code import is_in_python
from swarmwright.servers.evaluation.opening import open_backend, open_once

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


EPISODES = 100
"""Episodes of a post-evaluation, unless another number is given."""
_HELD_OUT_OFFSET = 1_000_000_000
"""Of held-out seeds from `parameters.seed`: far from the seeds that evolution uses."""


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ControllerEvaluation(ComparedByValue):
    """The fitness of a controller in episodes with held-out seeds."""

    seeds: list[int]
    """Simulation seed of each episode."""
    episodes: NDArray[np.float64]
    """(episodes,) fitness of each, NaN where it failed."""
    ranking: Ranking = field(compare=False)
    """Of the experiment."""
    metrics: dict[str, NDArray[np.float64]]
    """By name, (episodes,) each, NaN where the episode failed: those that the fitness needs, and those that
    were asked for."""

    def __repr__(self) -> str:
        """Say how good it is."""
        whose = f" of {self.label}" if self.label else ""
        return f"<{type(self).__name__}{whose}: mean fitness {self.result}>"

    @property
    def label(self) -> str:
        """The candidate, `generation:candidate`; empty of a controller from elsewhere."""
        return ""

    @property
    def result(self) -> str:
        """Mean fitness of an episode in words: its interval, and how many episodes there were."""
        interval = ""
        if self.mean.low is not None:
            interval = f", 95 % confidence interval {self.mean.low:.4g} to {self.mean.high:.4g}"
        failed = f", {self.failed_words}" if self.failed else ""
        count = len(self.episodes)
        return f"{self.mean.mean + 0.0:.6g}{interval}, {count} episode{'' if count == 1 else 's'}{failed}"

    def _repr_html_(self) -> str:
        """Return it as a table, for notebooks."""
        return facts(type(self).__name__, self._lines())

    def _lines(self) -> list[tuple[str, object]]:
        measured = [(name, f"{estimate(_finite_of(of)).mean:.6g}") for name, of in self.metrics.items()]
        return [("mean fitness", self.result), *measured]

    @cached_property
    def measured(self) -> list[float]:
        """Fitness of the episodes that did not fail."""
        return _finite_of(self.episodes)

    @property
    def failed(self) -> int:
        """Episodes that failed."""
        return len(self.episodes) - len(self.measured)

    @cached_property
    def counted(self) -> list[float]:
        """Fitness of the episodes that count: failed ones do where `ranking.failed` is a number."""
        return _finite_of(self.ranking.counted(self.episodes))

    @property
    def is_reportable(self) -> bool:
        """Whether every episode counts: none failed, or `ranking.failed` gives failures a fitness.

        Otherwise the figures are those of the episodes that happened to work.
        """
        return len(self.counted) == len(self.episodes)

    @property
    def failed_words(self) -> str:
        """How many episodes failed, and how they count."""
        value = self.ranking.options.failure_fitness
        how = "which are left out" if value is None else f"which count as {value:g}"
        return f"{self.failed} failed, {how}"

    @cached_property
    def mean(self) -> Estimate:
        """Mean fitness of the episodes that count, with Student's interval."""
        return estimate(self.counted)

    @cached_property
    def fitness(self) -> Estimate:
        """Fitness as the experiment's ranking makes it of its number of episodes: beside `recorded`.

        With the aggregate mean it is the mean of the episodes that count.
        """
        return estimate(_finite_of(self.ranking.samples(self.counted)))

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values."""
        ordered = sorted(self.counted)
        return {
            "fitness": vars(self.fitness),
            "episodes": len(self.episodes),
            "failed": self.failed,
            "reportable": self.is_reportable,
            "seed": self.seeds[0],
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
        named = {"fitness" if key == "mean" else key: value for key, value in vars(self.fitness).items()}
        return {**named, "failed": self.failed, "reportable": self.is_reportable}


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class PostEvaluation(ControllerEvaluation):
    """A candidate's recorded fitness, and its fitness in other episodes."""

    number: int
    """Of the evaluation in the whole run, from 0."""
    generation: int
    candidate: int
    recorded: float
    """Fitness in the record, by which it was chosen."""
    seen: int
    """How many of these seeds the evolution of the run had used as well."""
    validated: int = 0
    """How many of these seeds the run's own validation had used as well: there, the results are no further
    evidence."""

    @property
    def label(self) -> str:
        """The candidate, `generation:candidate`."""
        return f"{self.generation}:{self.candidate}"

    def _lines(self) -> list[tuple[str, object]]:
        lines = [("candidate", self.label), ("recorded fitness", f"{self.recorded + 0.0:.6g}")]
        return [*lines, *super()._lines()]

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            **self._identity,
            "seeds_of_the_run": self.seen,
            "seeds_of_the_validation": self.validated,
            **super().to_mapping(),
        }

    def summary(self) -> dict[str, Any]:
        """Return plain values, without those of each episode."""
        return {**self._identity, **super().summary()}

    @property
    def _identity(self) -> dict[str, Any]:
        """Which candidate it is."""
        return {
            "number": self.number,
            "generation": self.generation,
            "candidate": self.candidate,
            "recorded": self.recorded,
        }


def kept_values(evaluation: PostEvaluation) -> dict[str, Any]:
    """Return the values of a post-evaluation that exported packages keep."""
    return {
        **evaluation._identity, "seeds": evaluation.seeds, "seen": evaluation.seen,
        "episodes": finite(evaluation.episodes),
    }  # fmt: skip


def stored_post_evaluation(values: Mapping[str, Any], ranking: Ranking) -> PostEvaluation:
    """Return a post-evaluation from the values that a run's store keeps of a validation."""
    others = {key: values[key] for key in ("number", "generation", "candidate", "recorded", "seen")}
    return PostEvaluation(**others, **_measured(values), ranking=ranking)


def stored_controller_evaluation(values: Mapping[str, Any], ranking: Ranking) -> ControllerEvaluation:
    """Return the evaluation of a controller from the values that a run's store keeps of a validation."""
    return ControllerEvaluation(**_measured(values), ranking=ranking)


def _measured(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return seeds, fitness and metrics of episodes from the values that a store keeps."""
    episodes, names = numbers(values["episodes"]), values["metrics"]
    columns = numbers(values.get("values", [])).reshape(len(episodes), len(names)).T
    return {
        "seeds": values["seeds"], "episodes": episodes, "metrics": dict(zip(names, columns, strict=True))
    }  # fmt: skip


@overload
def post_evaluate(
    run: "Run | str | PathLike[str]",
    candidate: int | None = None,
    generation: int | None = None,
    *,
    controller: None = None,
    episodes: int = EPISODES,
    seed: SupportsIndex | None = None,
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str] | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
    metrics: Sequence[str] | Literal["all"] = (),
) -> PostEvaluation: ...


@overload
def post_evaluate(
    run: "Run | Experiment | Mapping[str, Any] | str | PathLike[str]",
    candidate: None = None,
    generation: None = None,
    *,
    controller: Controller | str | PathLike[str],
    episodes: int = EPISODES,
    seed: SupportsIndex | None = None,
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str] | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
    metrics: Sequence[str] | Literal["all"] = (),
) -> ControllerEvaluation: ...


@check_arguments
def post_evaluate(
    run: "Run | Experiment | Mapping[str, Any] | str | PathLike[str]",
    candidate: int | None = None,
    generation: int | None = None,
    *,
    controller: Controller | str | PathLike[str] | None = None,
    episodes: int = EPISODES,
    seed: SupportsIndex | None = None,
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str] | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
    metrics: Sequence[str] | Literal["all"] = (),
) -> ControllerEvaluation:
    """Evaluate a candidate of a run, or any controller, in other episodes than those it was chosen by.

    Wherever fitness depends on the seed, the best of many evaluations is biased: its recorded fitness is too
    high. New episodes estimate it without bias. Nothing is added to the run.

    Args:
        run: where the candidate is recorded, or its folder; with `controller` also an experiment, its file,
            or a mapping with the keys of one, whose simulation, parameters, fitness and ranking are used.
        candidate: as in `Run.evaluation`; without both, the best of the run.
        generation: as in `Run.evaluation`.
        controller: instead of a candidate of the run: one from elsewhere, a file as `Controller.load` reads
            it, or a run folder with its best. Its fitness is returned as a `ControllerEvaluation`, which has
            no candidate and no recorded fitness.
        episodes: how many, from 1 on; where a fitness is made of several, such as a median, at least these.
        seed: simulation seed of the first episode, the next ones follow; default: held-out seeds, which the
            evolution of the run did not use. They are the same for every run whose `parameters.seed` is the
            same, for its validation, and for its experiment; for fresh ones, name another seed.
        experiment: instead of the run's, with other parameters, say; the controller's sizes are the same.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.
        metrics: names of metrics to be measured beside those that the fitness needs; "all": those that the
            simulation announces.

    Raises:
        InputError: there is no such candidate or metric, the controller does not fit the simulation, or a
            number is out of range.
        SimulationError: every episode failed, the last in the code of the simulation.
        RunError: no broker, no fitting server, or every episode failed for another reason.

    Examples:
        >>> evaluation = swarmwright.post_evaluate("result", episodes=20, servers="in-process")
        >>> len(evaluation.episodes)
        20

    See also: `compare_controllers`, for two controllers in the same episodes; `transfer`, for other
    simulations.
    """
    from swarmwright.runs.run import Run, run_of  # noqa: PLC0415 - it imports this module

    if experiment is not None:
        experiment = experiment_of(experiment)
    where = Where.of(episodes, seed, broker, servers, on_progress, metrics)
    if controller is not None:
        if candidate is not None or generation is not None:
            raise InputError("controller: is evaluated instead of a candidate; leave out one of them")
        if isinstance(run, str | PathLike) and Path(run).is_dir():
            run = run_of(run)
        used = run._store.used_seeds() if isinstance(run, Run) else set()
        if experiment is None:
            experiment = used_for(run, None) if isinstance(run, Run) else experiment_of(run)
        return _of_controller(controller, experiment, where, used)
    if isinstance(run, Experiment | Mapping):
        raise InputError("run: is an experiment, which has no candidates; name a controller=..")
    run = run_of(run)
    evaluation = run.evaluation(candidate, generation)
    experiment = experiment or used_for(run, evaluation.generation)
    return of_candidates(run, [evaluation], experiment, where)[0]


class Where(NamedTuple):
    """In which episodes, and where, a controller is evaluated; seed, broker, .. as in `post_evaluate`."""

    episodes: int
    seed: int | None
    broker: str | None
    servers: Servers | None
    on_progress: Progress | None
    metrics: Sequence[str] | Literal["all"]

    @classmethod
    def of(
        cls,
        episodes: int,
        seed: SupportsIndex | None,
        broker: str | None,
        servers: Servers | None,
        on_progress: Progress | None,
        metrics: Sequence[str] | Literal["all"] = (),
    ) -> Self:
        """Return it from the arguments of `post_evaluate`. Raises InputError for no episode."""
        if episodes < 1:
            raise InputError(f"episodes: must be at least 1, not {episodes}")
        return cls(episodes, None if seed is None else index(seed), broker, servers, on_progress, metrics)

    def seeds(self, experiment: Experiment, used: set[int]) -> list[int]:
        """Return the seed of each episode; used: by evolution. Raises InputError for one out of range."""
        if self.seed is None:
            return unseen_seeds(experiment.first_seed, used, self.episodes)
        if not 0 <= self.seed <= 2**63 - self.episodes:
            raise InputError(f"seed: must be from 0 to 2**63 - {self.episodes}, not {self.seed}")
        return list(range(self.seed, self.seed + self.episodes))

    def check(self, experiment: Experiment) -> None:
        """Raise InputError where there are too few episodes for one fitness."""
        from swarmwright.experiment.ranking_checks import makes_fitness  # noqa: PLC0415 - takes long, not for reading runs

        if not makes_fitness(experiment.ranking, self.episodes):
            needed = experiment.ranking.episodes
            raise InputError(
                f"episodes: must be at least ranking.episodes, {needed}, of which a fitness is made, not "
                f"{self.episodes}"
            )


def of_candidates(
    run: "Run", candidates: Sequence[Evaluation], experiment: Experiment, where: Where
) -> list[PostEvaluation]:
    """Evaluate candidates of a run in the same episodes, by an experiment; raises as `post_evaluate`."""
    used = run._store.used_seeds()
    validated = set((run._store.validation() or {}).get("seeds", ()))
    seeds = where.seeds(run.experiment, used)
    where.check(experiment)
    with open_backend(
        experiment,
        broker=where.broker,
        servers=where.servers,
        most=len(seeds) * len(candidates),
        metrics=select_metrics(experiment, where.metrics),
    ) as backend:
        genomes = np.stack([candidate.genome for candidate in candidates])
        results = evaluated(experiment, backend, genomes, seeds, where.on_progress)
        names = backend.metrics
    return [
        PostEvaluation(
            number=candidate.number,
            generation=candidate.generation,
            candidate=candidate.candidate,
            recorded=candidate.fitness,
            seeds=seeds,
            seen=len(used.intersection(seeds)),
            validated=len(validated.intersection(seeds)),
            episodes=results.fitness[index] + 0.0,
            ranking=experiment.new_ranking(),
            metrics=dict(zip(names, results.metrics[index].T + 0.0, strict=True)),
        )
        for index, candidate in enumerate(candidates)
    ]


def _of_controller(
    given: Controller | str | PathLike[str], experiment: Experiment, where: Where, used: set[int]
) -> ControllerEvaluation:
    """Evaluate a controller from elsewhere. used: seeds that are not taken unless they are asked for."""
    controller = given if isinstance(given, Controller) else Controller.load(given)
    return of_controllers({"controller": controller}, experiment, where, used)[0]


def of_controllers(
    controllers: Mapping[str, Controller],
    experiment: Experiment,
    where: Where,
    used: set[int],
    *,
    may_fail: bool = False,
) -> list[ControllerEvaluation]:
    """Evaluate controllers of any kinds in the same episodes, one after the other.

    Args:
        controllers: by what messages call them.
        experiment: whose simulation, fitness and ranking.
        where: in which episodes, and where.
        used: seeds that are not taken unless they are asked for.
        may_fail: whether a controller may fail in every episode.

    Raises as `post_evaluate`, before the first episode where a controller does not fit.
    """
    from swarmwright.servers.evaluation.evaluate import check_fit  # noqa: PLC0415 - takes long, not for reading runs

    seeds = where.seeds(experiment, used)
    where.check(experiment)
    total = len(controllers) * len(seeds)
    found: list[ControllerEvaluation] = []
    with _servers_for(controllers.values(), experiment, where, total) as (broker, servers):
        for name, controller in controllers.items():
            specification = controller.specification
            with open_backend(
                experiment,
                broker=broker,
                servers=servers,
                most=len(seeds),
                metrics=select_metrics(experiment, where.metrics),
                controller=specification,
            ) as backend:
                for place, member in controllers.items():
                    check_fit(member, backend.sensors, backend.actuators, experiment.simulation, place)
                weights = np.array([specification["weights"]], dtype=np.float32)
                results = _results(
                    backend,
                    Controllers(specification, weights),
                    seeds,
                    _part(where.on_progress, len(found) * len(seeds), total),
                    may_fail=may_fail,
                    whose="" if len(controllers) == 1 else f"{name}: ",
                )
                names = backend.metrics
            found.append(
                ControllerEvaluation(
                    seeds=seeds,
                    episodes=results.fitness[0] + 0.0,
                    ranking=experiment.new_ranking(),
                    metrics=dict(zip(names, results.metrics[0].T + 0.0, strict=True)),
                )
            )
    return found


@contextmanager
def _servers_for(
    controllers: Collection[Controller], experiment: Experiment, where: Where, most: int
) -> Iterator[tuple[str | None, Servers | None]]:
    """Start servers once for several controllers; yield broker and servers as `open_once` does."""
    # Servers are started with the modules in Python of the controllers that they get.
    if len(controllers) == 1 or any(is_in_python(controller.specification) for controller in controllers):
        yield where.broker, where.servers
        return
    with open_once(experiment, where.broker, where.servers, most=most) as opened:
        yield opened


def _part(on_progress: Progress | None, before: int, total: int) -> Progress | None:
    """Return the progress of a part of all episodes. before: episodes of the parts before it."""
    if on_progress is None:
        return None
    return lambda done, _total, waiting_for: on_progress(before + done, total, waiting_for)


def unseen_seeds(first: int, used: set[int], count: int, begin: int | None = None) -> list[int]:
    """Return simulation seeds that are none of `used`, the first ones from `begin` on.

    Default of `begin`: parameters.seed, which is `first`, + 10**9.
    """
    seed = begin if begin is not None else first + _HELD_OUT_OFFSET if first < 2**62 else first - 2**61
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
    controllers = Controllers.from_genomes(representation, genomes)
    return _results(backend, controllers, seeds, on_progress, may_fail=may_fail)


def _results(
    backend: Backend,
    controllers: Controllers,
    seeds: Sequence[int],
    on_progress: Progress | None,
    *,
    may_fail: bool,
    whose: str = "",
) -> Results:
    """Return the results of controllers in an episode of each seed; raises as `evaluated`.

    whose: begins the message when every episode failed.
    """
    backend.announce_post_evaluation()
    results = backend.evaluate(controllers, seeds, on_progress or (lambda *_: None))
    if not (may_fail or np.isfinite(results.fitness).any()):
        words = f"{whose}every episode failed; the last reason: "
        raise build_error(words, results.journal.errors, backend.failure_of, unknown="not known")
    return results


def _finite_of(values: NDArray[np.float64]) -> list[float]:
    return [value for value in values.tolist() if math.isfinite(value)]


def finite(values: NDArray[np.float64]) -> list[Any]:
    """Return numbers as nested lists, None in the place of those that are not finite."""
    if values.ndim > 1:
        return [finite(number) for number in values]
    return [value if math.isfinite(value) else None for value in values.tolist()]


def numbers(values: list[Any]) -> NDArray[np.float64]:
    """Return what `finite` was made of; it cannot be changed, since runs keep it."""
    return read_only_array(np.array(values, dtype=np.float64))  # None becomes NaN
