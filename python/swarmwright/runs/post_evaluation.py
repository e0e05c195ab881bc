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
from swarmwright.experiment.experiment import Experiment, as_experiment
from swarmwright.experiment.settings import parameter_settings
from swarmwright.methods.rankings import Ranking
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.store import Evaluation
from swarmwright.servers.evaluation.base import Backend, Controllers, Progress, Results, Servers, build_error
from swarmwright.servers.evaluation.evaluate import select_metrics
from swarmwright.servers.evaluation.module_code import is_in_python
from swarmwright.servers.evaluation.opening import open_backend, open_once

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


EPISODES = 100
"""Default number of episodes of a post-evaluation."""
_HELD_OUT_OFFSET = 1_000_000_000
"""Distance of held-out seeds from `parameters.seed`, far from the seeds that evolution uses."""


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ControllerEvaluation(ComparedByValue):
    """The fitness of a controller in episodes with held-out seeds."""

    seeds: list[int]
    """Simulation seed of each episode."""
    episodes: NDArray[np.float64]
    """Fitness of each episode, (episodes,), NaN for failed episodes."""
    ranking: Ranking = field(compare=False)
    """Ranking of the experiment."""
    metrics: dict[str, NDArray[np.float64]]
    """Metrics by name, (episodes,) each, NaN for failed episodes: those that the fitness needs, and the
    requested ones."""

    def __repr__(self) -> str:
        """Return the candidate and its mean fitness."""
        candidate = f" of {self.label}" if self.label else ""
        return f"<{type(self).__name__}{candidate}: mean fitness {self.result}>"

    @property
    def label(self) -> str:
        """The candidate as `generation:candidate`; empty for a controller that is not from a run."""
        return ""

    @property
    def result(self) -> str:
        """Description of the mean fitness, with its interval and the number of episodes."""
        interval = ""
        if self.mean.low is not None:
            interval = f", 95 % confidence interval {self.mean.low:.4g} to {self.mean.high:.4g}"
        failed = f", {self.failed_words}" if self.failed else ""
        count = len(self.episodes)
        return f"{self.mean.mean + 0.0:.6g}{interval}, {count} episode{'' if count == 1 else 's'}{failed}"

    def _repr_html_(self) -> str:
        """Return a table, for notebooks."""
        return facts(type(self).__name__, self._lines())

    def _lines(self) -> list[tuple[str, object]]:
        metrics = [
            (name, f"{estimate(_select_finite(column)).mean:.6g}") for name, column in self.metrics.items()
        ]
        return [("mean fitness", self.result), *metrics]

    @cached_property
    def measured(self) -> list[float]:
        """Fitness of the successful episodes."""
        return _select_finite(self.episodes)

    @property
    def failed(self) -> int:
        """Number of failed episodes."""
        return len(self.episodes) - len(self.measured)

    @cached_property
    def counted(self) -> list[float]:
        """Fitness of the episodes that count; failed ones count if `ranking.failed` is a number."""
        return _select_finite(self.ranking.replace_failures(self.episodes))

    @property
    def is_reportable(self) -> bool:
        """Whether every episode counts: none failed, or `ranking.failed` gives failures a fitness.

        Otherwise the statistics cover only the episodes that happened to succeed.
        """
        return len(self.counted) == len(self.episodes)

    @property
    def failed_words(self) -> str:
        """Description of the failed episodes and how they count."""
        value = self.ranking.options.failure_fitness
        effect = "which are excluded" if value is None else f"which count as {value:g}"
        return f"{self.failed} failed, {effect}"

    @cached_property
    def mean(self) -> Estimate:
        """Mean fitness of the episodes that count, with Student's t interval."""
        return estimate(self.counted)

    @cached_property
    def fitness(self) -> Estimate:
        """Fitness as the experiment's ranking aggregates it, comparable with `recorded`.

        With the aggregate mean it is the mean of the episodes that count.
        """
        return estimate(_select_finite(self.ranking.samples(self.counted)))

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
                    **vars(estimate(_select_finite(column))),
                    "without": len(column) - len(_select_finite(column)),
                    "values": column.tolist(),
                }
                for name, column in self.metrics.items()
            },
        }

    def summary(self) -> dict[str, Any]:
        """Return plain values, without those of each episode."""
        fitness = {"fitness" if key == "mean" else key: value for key, value in vars(self.fitness).items()}
        return {**fitness, "failed": self.failed, "reportable": self.is_reportable}


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class PostEvaluation(ControllerEvaluation):
    """A candidate's recorded fitness, and its fitness in other episodes."""

    number: int
    """Number of the evaluation in the whole run, from 0."""
    generation: int
    candidate: int
    recorded: float
    """Fitness in the record, by which it was chosen."""
    seen: int  # pylint: disable=disallowed-name # the name in the store
    """How many of the seeds the evolution had used as well."""
    validated: int = 0
    """How many of the seeds the run's validation had used as well; these results are not additional
    evidence."""

    @property
    def label(self) -> str:
        """The candidate as `generation:candidate`."""
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
        """The numbers and the recorded fitness of the candidate."""
        return {
            "number": self.number,
            "generation": self.generation,
            "candidate": self.candidate,
            "recorded": self.recorded,
        }


def export_values(evaluation: PostEvaluation) -> dict[str, Any]:
    """Return the values of a post-evaluation for exported packages."""
    return {
        **evaluation._identity, "seeds": evaluation.seeds, "seen": evaluation.seen,
        "episodes": encode_numbers(evaluation.episodes),
    }  # fmt: skip


def load_post_evaluation(values: Mapping[str, Any], ranking: Ranking) -> PostEvaluation:
    """Build a post-evaluation from the values of a validation in a run's store."""
    identity = {key: values[key] for key in ("number", "generation", "candidate", "recorded", "seen")}
    return PostEvaluation(**identity, **_parse_episodes(values), ranking=ranking)


def load_controller_evaluation(values: Mapping[str, Any], ranking: Ranking) -> ControllerEvaluation:
    """Build the evaluation of a controller from the values of a validation in a run's store."""
    return ControllerEvaluation(**_parse_episodes(values), ranking=ranking)


def _parse_episodes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parse seeds, fitness and metrics of episodes from stored values."""
    episodes, names = decode_numbers(values["episodes"]), values["metrics"]
    columns = decode_numbers(values.get("values", [])).reshape(len(episodes), len(names)).T
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
    parameters: Mapping[str, Any] | None = None,
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
    parameters: Mapping[str, Any] | None = None,
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
    parameters: Mapping[str, Any] | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
    metrics: Sequence[str] | Literal["all"] = (),
) -> ControllerEvaluation:
    """Evaluate a candidate of a run, or any controller, in new episodes.

    If fitness depends on the seed, the recorded fitness of the best of many evaluations is biased upwards.
    New episodes give an unbiased estimate. Nothing is added to the run.

    Args:
        run: the run of the candidate, or its folder; with `controller` also an experiment, its file, or a
            mapping with the keys of such a file, to use its simulation, parameters, fitness and ranking.
        candidate: as in `Run.evaluation`; by default the best of the run.
        generation: as in `Run.evaluation`.
        controller: evaluate this controller instead of a candidate: a controller, a file as for
            `Controller.load`, or a run folder, for its best. The result is a `ControllerEvaluation`, which
            has no candidate and no recorded fitness.
        episodes: number of episodes, at least 1; at least `ranking.episodes` if the ranking aggregates
            several episodes, such as by their median.
        seed: simulation seed of the first episode, followed by consecutive seeds. By default held-out seeds,
            which the evolution did not use. They are the same for all runs with the same `parameters.seed`,
            for the validation, and for the experiment; choose another seed for fresh episodes.
        experiment: replaces the run's experiment, for example to change parameters; numbers of sensors and
            actuators must be the same.
        parameters: other values for parameters of the simulation, with keys such as `robots` or
            `robot.drive.noise`.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.
        metrics: names of metrics to measure besides those that the fitness needs, or "all" for all metrics of
            the simulation.

    Raises:
        InputError: the candidate or a metric does not exist, the controller does not fit the simulation, or a
            number is out of range.
        SimulationError: every episode failed, the last in the code of the simulation.
        RunError: no broker, no suitable server, or every episode failed for another reason.

    Examples:
        >>> evaluation = swarmwright.post_evaluate("result", episodes=20, servers="in-process")
        >>> len(evaluation.episodes)
        20

    See also: `compare_controllers`, for two controllers in the same episodes; `transfer`, for other
    simulations.
    """
    from swarmwright.runs.run import Run, open_run  # noqa: PLC0415 - it imports this module

    if experiment is not None:
        experiment = as_experiment(experiment)
    where = EvaluationOptions.of(episodes, seed, broker, servers, on_progress, metrics)
    changes = parameter_settings(parameters or {})
    if controller is not None:
        if candidate is not None or generation is not None:
            raise InputError(
                "controller: cannot be combined with a candidate or generation; omit one of them"
            )
        if isinstance(run, str | PathLike) and Path(run).is_dir():
            run = open_run(run)
        used = run._store.collect_seeds() if isinstance(run, Run) else set()
        if experiment is None:
            experiment = resolve_experiment(run, None) if isinstance(run, Run) else as_experiment(run)
        if not isinstance(controller, Controller):
            controller = Controller.load(controller)
        return evaluate_controllers(
            {"controller": controller}, experiment.with_settings(changes), where, used
        )[0]
    if isinstance(run, Experiment | Mapping):
        raise InputError("run: an experiment has no candidates; specify controller=..")
    run = open_run(run)
    evaluation = run.evaluation(candidate, generation)
    experiment = experiment or resolve_experiment(run, evaluation.generation)
    return evaluate_candidates(run, [evaluation], experiment.with_settings(changes), where)[0]


class EvaluationOptions(NamedTuple):
    """Options of a post-evaluation, as in `post_evaluate`."""

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
        """Check and convert arguments of `post_evaluate`. Raises InputError for fewer than 1 episode."""
        if episodes < 1:
            raise InputError(f"episodes: must be at least 1, not {episodes}")
        return cls(episodes, None if seed is None else index(seed), broker, servers, on_progress, metrics)

    def seeds(self, experiment: Experiment, used: set[int]) -> list[int]:
        """Return the seed of each episode. Raises InputError for seeds out of range.

        used: seeds of the evolution, which are skipped unless a seed was requested.
        """
        if self.seed is None:
            return choose_unseen_seeds(experiment.first_seed, used, self.episodes)
        if not 0 <= self.seed <= 2**63 - self.episodes:
            raise InputError(f"seed: must be from 0 to 2**63 - {self.episodes}, not {self.seed}")
        return list(range(self.seed, self.seed + self.episodes))

    def check(self, experiment: Experiment) -> None:
        """Raise InputError if there are too few episodes for a fitness."""
        from swarmwright.experiment.ranking_checks import makes_fitness  # noqa: PLC0415 - takes long, not for reading runs

        if not makes_fitness(experiment.ranking, self.episodes):
            needed = experiment.ranking.episodes
            raise InputError(
                f"episodes: must be at least ranking.episodes ({needed}), which the fitness aggregates, not "
                f"{self.episodes}"
            )


def evaluate_candidates(
    run: "Run", candidates: Sequence[Evaluation], experiment: Experiment, where: EvaluationOptions
) -> list[PostEvaluation]:
    """Evaluate candidates of a run in the same episodes of an experiment; raises as `post_evaluate`."""
    used = run._store.collect_seeds()
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
        results = evaluate_genomes(experiment, backend, genomes, seeds, where.on_progress)
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


def evaluate_controllers(
    controllers: Mapping[str, Controller],
    experiment: Experiment,
    where: EvaluationOptions,
    used: set[int],
    *,
    may_fail: bool = False,
) -> list[ControllerEvaluation]:
    """Evaluate controllers of any kinds in the same episodes, sequentially.

    Args:
        controllers: by their names in messages.
        experiment: has the simulation, fitness and ranking.
        where: options of the evaluation.
        used: seeds to skip, unless a seed was requested.
        may_fail: accept controllers that fail in every episode.

    Raises as `post_evaluate`, and before the first episode if a controller does not fit.
    """
    from swarmwright.servers.evaluation.evaluate import check_fit  # noqa: PLC0415 - takes long, not for reading runs

    seeds = where.seeds(experiment, used)
    where.check(experiment)
    total = len(controllers) * len(seeds)
    evaluations: list[ControllerEvaluation] = []
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
                for label, member in controllers.items():
                    check_fit(member, backend.sensors, backend.actuators, experiment.simulation, label)
                weights = np.array([specification["weights"]], dtype=np.float32)
                results = _evaluate(
                    backend,
                    Controllers(specification, weights),
                    seeds,
                    _offset_progress(where.on_progress, len(evaluations) * len(seeds), total),
                    may_fail=may_fail,
                    prefix="" if len(controllers) == 1 else f"{name}: ",
                )
                names = backend.metrics
            evaluations.append(
                ControllerEvaluation(
                    seeds=seeds,
                    episodes=results.fitness[0] + 0.0,
                    ranking=experiment.new_ranking(),
                    metrics=dict(zip(names, results.metrics[0].T + 0.0, strict=True)),
                )
            )
    return evaluations


@contextmanager
def _servers_for(
    controllers: Collection[Controller], experiment: Experiment, where: EvaluationOptions, most: int
) -> Iterator[tuple[str | None, Servers | None]]:
    """Start servers once for several controllers; yield broker and servers as `open_once` does."""
    # Servers that run modules in Python are started for a single controller.
    if len(controllers) == 1 or any(is_in_python(controller.specification) for controller in controllers):
        yield where.broker, where.servers
        return
    with open_once(experiment, where.broker, where.servers, most=most) as broker_and_servers:
        yield broker_and_servers


def _offset_progress(on_progress: Progress | None, before: int, total: int) -> Progress | None:
    """Return a callback for a part of all episodes, with `before` episodes before it."""
    if on_progress is None:
        return None
    return lambda done, _total, waiting_for: on_progress(before + done, total, waiting_for)


def choose_unseen_seeds(first: int, used: set[int], count: int, begin: int | None = None) -> list[int]:
    """Return the first `count` simulation seeds from `begin` on that are not in `used`.

    `begin` is by default `first`, which is parameters.seed, + 10**9.
    """
    seed = begin if begin is not None else first + _HELD_OUT_OFFSET if first < 2**62 else first - 2**61
    seeds: list[int] = []
    while len(seeds) < count:
        if seed not in used:
            seeds.append(seed)
        seed += 1
    return seeds


def evaluate_genomes(
    experiment: Experiment,
    backend: Backend,
    genomes: Genomes,
    seeds: Sequence[int],
    on_progress: Progress | None,
    *,
    may_fail: bool = False,
) -> Results:
    """Evaluate genomes, (candidates, genome_size), in an episode of each seed.

    Raises RunError when every episode failed, unless `may_fail`.
    """
    representation = experiment.representation(backend.sensors, backend.actuators)
    if genomes.shape[1] != representation.genome_size:
        raise InputError(
            f"the run's controllers have {genomes.shape[1]} genes, but those of this experiment have "
            f"{representation.genome_size}"
        )
    controllers = Controllers.from_genomes(representation, genomes)
    return _evaluate(backend, controllers, seeds, on_progress, may_fail=may_fail)


def _evaluate(
    backend: Backend,
    controllers: Controllers,
    seeds: Sequence[int],
    on_progress: Progress | None,
    *,
    may_fail: bool,
    prefix: str = "",
) -> Results:
    """Evaluate controllers in an episode of each seed; raises as `evaluate_genomes`.

    prefix: prefix of the message when every episode failed.
    """
    backend.announce_post_evaluation()
    results = backend.evaluate(controllers, seeds, on_progress or (lambda *_: None))
    if not (may_fail or np.isfinite(results.fitness).any()):
        message = f"{prefix}every episode failed; the last reason: "
        raise build_error(message, results.journal.errors, backend.failure_of, unknown="not known")
    return results


def _select_finite(values: NDArray[np.float64]) -> list[float]:
    return [value for value in values.tolist() if math.isfinite(value)]


def encode_numbers(values: NDArray[np.float64]) -> list[Any]:
    """Return numbers as nested lists for JSON, with None for those that are not finite."""
    if values.ndim > 1:
        return [encode_numbers(number) for number in values]
    return [value if math.isfinite(value) else None for value in values.tolist()]


def decode_numbers(values: list[Any]) -> NDArray[np.float64]:
    """Return the read-only array that `encode_numbers` encoded."""
    return read_only_array(np.array(values, dtype=np.float64))  # None becomes NaN
