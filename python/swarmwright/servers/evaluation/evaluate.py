"""Evaluation of genomes and controllers without optimization."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import index
from os import PathLike
from typing import Any, Literal, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright import _engine
from swarmwright.common.arguments import check_arguments, instance, require_list, simulation_seed, text
from swarmwright.common.arrays import Fitness, float32_of
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.plug_in_code import report_failures
from swarmwright.common.processes import use_threads
from swarmwright.common.random_numbers import Stream
from swarmwright.common.simulation_names import is_python
from swarmwright.common.suggestions import unknown
from swarmwright.common.untrusted import escape_line
from swarmwright.common.values import ComparedByValue
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.controllers.controller import Controller
from swarmwright.experiment.derived import evaluation_key, has_python_modules, place_of, steers_agents
from swarmwright.experiment.evolved import iter_unknown
from swarmwright.experiment.experiment import Experiment, as_experiment
from swarmwright.experiment.unavailable import ranking_of
from swarmwright.methods.rankings.absolute import Absolute
from swarmwright.methods.rankings.slow_simulation import SlowOptions
from swarmwright.servers.evaluation.base import (
    BROKERLESS,
    Backend,
    Controllers,
    Progress,
    Results,
    Servers,
    build_error,
    seeds_of,
)
from swarmwright.servers.evaluation.in_process import PythonBackend
from swarmwright.servers.evaluation.module_code import is_in_python
from swarmwright.servers.evaluation.opening import is_here, open_backend
from swarmwright.servers.rows import Journal
from swarmwright.simulations import catalogue
from swarmwright.simulations.user_code.changes import warn_of_edits
from swarmwright.simulations.user_code.parts import read_simulation


def select_metrics(experiment: Experiment, metrics: Sequence[str] | Literal["all"]) -> list[str]:
    """Return the names of the requested metrics; "all" selects every metric that the simulation announces.

    Raises InputError for an unknown metric, and for "all" if only servers know the simulation.
    """
    if metrics != "all":
        require_list("metrics", metrics, "names of metrics")
        metrics = [text("metrics", name, "a list of names") for name in metrics]
    if not catalogue.has_description(experiment.simulation):
        if metrics == "all":
            raise InputError(
                f"metrics: {experiment.label} is not available in this process; list the metrics by name"
            )
        return list(metrics)
    announced = list(catalogue.description(experiment.simulation, experiment.parameters)["metrics"])
    if metrics == "all":
        return announced
    for name in metrics:
        if name not in announced:
            raise InputError(f"metrics: {unknown('metric', name, announced)}")
    return list(metrics)


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


_log = logging.getLogger("swarmwright")
_MAX_LOGGED_REASONS = 10
"""Upper limit of logged failure reasons."""


@check_arguments
def evaluate(
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str],
    genomes: ArrayLike,
    *,
    generation: int = 0,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> NDArray[np.float64]:
    """Return the fitness of genomes, aggregated over episodes by the experiment's ranking.

    For optimizers of other libraries with an ask/tell interface:

        for generation in range(200):
            genomes = optimizer.ask()
            optimizer.tell(genomes, evaluate(experiment, genomes, generation=generation))

    `ranking.reevaluate` has no effect: the caller decides which genomes to evaluate again.

    Args:
        experiment: or its file, or a mapping with its keys; its method is ignored.
        genomes: float32, (candidates, experiment.genome_size), finite.
        generation: selects the episodes' seeds, from 0. With `ranking.seeds: new` they start at
            `parameters.seed + generation * episodes`; with `same` all generations use those of generation 0.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Returns:
        float64, (candidates,), higher is better, NaN where the evaluation failed; the logger `swarmwright`
        warns of the reason. The values do not depend on where they were computed.

    Raises:
        InputError: the genomes have a wrong shape or are not finite, the generation is negative, the ranking
            needs a second simulation (multi_fidelity, transferability), or the experiment cannot be run.
        RunError: no broker or no matching server.

    Examples:
        >>> experiment = swarmwright.Experiment.load("experiments/minisim.yaml")
        >>> genomes = np.zeros((2, experiment.genome_size), np.float32)
        >>> swarmwright.evaluate(experiment, genomes, servers="in-process")
        array([-6., -6.])

    See also: `evaluate_episodes`, for the fitness and metrics of each episode; `post_evaluate`, for a
    candidate of a run.
    """
    experiment = as_experiment(experiment)
    _check_ranking(experiment, generation)
    rows = _check_genomes(genomes)
    if is_here(experiment, broker, servers):
        prepared_evaluation = prepare_evaluation(experiment)
        if prepared_evaluation is not None:
            return prepared_evaluation.scores(rows, on_progress, generation)
    evaluated = _evaluate(experiment, rows, generation, (), broker, servers, on_progress)
    return evaluated.fitness


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeResults(ComparedByValue):
    """Results of genomes in each episode.

    Candidates are in the order of the genomes, episodes in that of `seeds`. Fitness and metrics are in the
    units of the simulation; higher fitness is better.
    """

    fitness: NDArray[np.float64]
    """(candidates,), the aggregate of the ranking over the episodes; NaN where an episode failed."""
    episodes: NDArray[np.float64]
    """(candidates, episodes), fitness of each episode; NaN where it failed."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics), in the order of `names`; NaN where the episode failed."""
    names: tuple[str, ...]
    """Names of the metrics: those that the experiment's fitness needs, then the others that were
    requested."""
    seeds: tuple[int, ...]
    """Simulation seed of each episode."""


@check_arguments
def evaluate_episodes(
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str],
    genomes: ArrayLike,
    *,
    metrics: Sequence[str] | Literal["all"] = (),
    generation: int = 0,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> EpisodeResults:
    """Return fitness and metrics of genomes in each episode, for optimizers that need more than `evaluate`.

    Quality-diversity methods take descriptors from the metrics, multi-objective methods the objectives:
    `evaluated.metrics.mean(axis=1)` has one row per genome.

    Args:
        experiment: as in `evaluate`.
        genomes: as in `evaluate`.
        metrics: names of metrics besides those that the fitness needs; "all" for every metric that the
            simulation announces.
        generation: as in `evaluate`.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Raises:
        InputError: as in `evaluate`, or a metric is unknown.
        RunError: no broker or no matching server.

    Examples:
        >>> experiment = swarmwright.Experiment.from_mapping(
        ...     {
        ...         "simulation": "arena",
        ...         "parameters": {"mission": "aggregation", "duration": 5},
        ...         "ranking": {"episodes": 3},
        ...         "servers": "in-process",
        ...     }
        ... )
        >>> genomes = np.zeros((2, experiment.genome_size))
        >>> evaluated = swarmwright.evaluate_episodes(experiment, genomes, metrics=["largest_group"])
        >>> evaluated.episodes.shape, evaluated.metrics[0, :, 0]
        ((2, 3), array([6., 4., 6.]))

    See also: `evaluate`, for the fitness alone.
    """
    experiment = as_experiment(experiment)
    _check_ranking(experiment, generation)
    names = select_metrics(experiment, metrics)
    return _evaluate(experiment, _check_genomes(genomes), generation, names, broker, servers, on_progress)


def _check_ranking(experiment: Experiment, generation: int) -> None:
    """Raise InputError for rankings with a second simulation and for negative generations."""
    if generation < 0:
        raise InputError(f"generation: must be at least 0, not {generation}")
    if isinstance(experiment.ranking, SlowOptions):
        kind: str = experiment.ranking.kind
        raise InputError(
            f"{place_of(experiment, 'ranking')}{kind} needs a second simulation and earlier generations, "
            "which only optimize() has; use another ranking: "
            "experiment.replace(ranking={'kind': 'absolute'})"
        )


def _evaluate(
    experiment: Experiment,
    rows: NDArray[np.float32],
    generation: int,
    metrics: Sequence[str],
    broker: str | None,
    servers: Servers | None,
    on_progress: Progress | None,
) -> EpisodeResults:
    check_finite(rows)
    with report_failures():
        _warn_of_edits(experiment)
        ranking = experiment.new_ranking()
        seeds = seeds_of(ranking, experiment.first_seed, generation)
        most = max(len(rows), 1) * len(seeds)
        with open_backend(experiment, broker=broker, servers=servers, most=most, metrics=metrics) as backend:
            representation = experiment.representation(backend.sensors, backend.actuators)
            check_size(rows, representation.genome_size)
            if len(rows):
                controllers = Controllers.from_genomes(representation, rows)
                results = backend.evaluate(controllers, seeds, on_progress or _ignore_progress)
            else:
                results = _empty_results(len(seeds), len(backend.metrics))
        log_failures(backend, results)
        return EpisodeResults(
            fitness=ranking.score(results.fitness) if len(rows) else np.empty(0),
            episodes=results.fitness + 0.0,
            metrics=results.metrics + 0.0,
            names=backend.metrics,
            seeds=tuple(seeds),
        )


def log_failures(backend: Backend, results: Results) -> None:
    """Log why episodes failed, each reason once."""
    if isinstance(backend, PythonBackend):  # logs by itself
        backend.log_held()
        return
    for reason in list(dict.fromkeys(results.journal.errors))[:_MAX_LOGGED_REASONS]:
        _log.warning("an episode failed: %s", escape_line(reason))


def _empty_results(episodes: int, metrics: int) -> Results:
    """Return the results of no candidates."""
    return Results(np.empty((0, episodes)), np.empty((0, episodes, metrics)), Journal())


@check_arguments
def simulate(
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str],
    controller: Controller | None = None,
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    visual: bool = False,
    seed: SupportsIndex | None = None,
    on_progress: Progress | None = None,
) -> float:
    """Run one episode and return its fitness.

    Args:
        experiment: or its file, or a mapping with its keys; simulation and parameters are used, the episode's
            seed is `parameters.seed` (default 0).
        controller: for all agents; by default a random one, the same as candidate 0 of an optimization.
        broker: as in `optimize`.
        servers: as in `optimize`, except that one server is enough.
        visual: ask the server to draw, through the protocol's `visual` flag. A server started by this call
            draws on standard output.
        seed: seed of the simulation, instead of `parameters.seed`.
        on_progress: as in `optimize`.

    Raises:
        InputError: the controller does not match the simulation, or the experiment cannot be run.
        SimulationError: the episode failed in the code of the simulation.
        RunError: no broker, no matching server, or the episode failed for another reason.

    Examples:
        >>> swarmwright.simulate("experiments/minisim.yaml", run.best.controller, servers="in-process")
        -...

    See also: `Run.replay`, to watch an episode; `Episodes`, to steer the agents by your own code.
    """
    experiment = as_experiment(experiment)
    if controller is not None:
        instance("controller", controller, Controller, "Controller.load(path)")
    with report_failures():
        return run_episode(
            experiment,
            controller,
            broker=broker,
            servers=servers,
            visual=visual,
            seed=None if seed is None else index(seed),
            on_progress=on_progress,
        ).fitness


@dataclass(frozen=True)
class Episode:
    """Results of one episode."""

    fitness: float
    metrics: dict[str, float]
    """The metrics that the experiment's fitness needs, by name."""
    parameters: dict[str, float | int | str]
    """Values of a parameter set, by name; {} for controllers of agents."""
    seed: int
    """The simulation seed."""


def run_episode(
    experiment: Experiment,
    controller: Controller | None,
    *,
    broker: str | None,
    servers: Servers | None = None,
    visual: bool = False,
    seed: int | None = None,
    on_progress: Progress | None = None,
) -> Episode:
    """Run one episode; arguments as in `simulate`."""
    seed = experiment.first_seed if seed is None else seed
    simulation_seed("seed", seed)
    _warn_of_edits(experiment)
    specification = None if controller is None else controller.specification
    if (
        servers is None
        and broker is None
        and experiment.broker is None
        and experiment.servers not in BROKERLESS
    ):
        in_process = has_python_modules(experiment) or (
            specification is not None and is_in_python(specification)
        )
        servers = "in-process" if in_process else 1
    with open_backend(
        experiment, broker=broker, servers=servers, visual=visual, most=1, controller=specification
    ) as backend:
        if isinstance(backend, PythonBackend):
            backend.log_failure = lambda *_: None  # the error below says why the episode failed
        if controller is None:
            representation = experiment.representation(backend.sensors, backend.actuators)
            genome = representation.initial(Stream(experiment.seed, "initial"))
            controllers = Controllers.from_genomes(representation, genome[np.newaxis])
            if not steers_agents(experiment):
                controller = Controller(representation.specification(genome))
        else:
            check_fit(controller, backend.sensors, backend.actuators, experiment.simulation)
            weights = np.array([controller.specification["weights"]], dtype=np.float32)
            controllers = Controllers(controller.specification, weights)
        results = backend.evaluate(controllers, [seed], on_progress or _ignore_progress)
    fitness = float(results.fitness[0, 0])
    if not np.isfinite(fitness):
        raise build_error(
            "the episode failed: ",
            results.journal.errors,
            backend.failure_of,
            unknown="its fitness is not a finite number",
        )
    metrics = dict(zip(backend.metrics, results.metrics[0, 0].tolist(), strict=True))
    return Episode(fitness + 0.0, metrics, {} if controller is None else controller.parameters, seed)


def _warn_of_edits(experiment: Experiment) -> None:
    """Warn if the code loaded in this process differs from that of a newly started server."""
    if is_python(experiment.simulation):
        part = read_simulation(experiment.simulation)
        warn_of_edits([] if part is None else [part])


def _check_genomes(genomes: ArrayLike) -> NDArray[np.float32]:
    rows = float32_of("genomes", genomes)
    if rows.ndim != 2:
        raise InputError(f"genomes: have the shape {rows.shape}; expected (candidates, genome_size)")
    return rows


def check_fit(
    controller: Controller, sensors: int, actuators: int, simulation: str, label: str = "controller"
) -> None:
    """Raise InputError unless a controller matches a simulation, whose agents have these sizes.

    label: name of the controller in messages.
    """
    if controller.parameters:
        if catalogue.has_description(simulation):
            for name, message in iter_unknown(simulation, controller.parameters):
                raise InputError(f"{label}: {name}: {message}")
        return
    if (controller.sensors, controller.actuators) != (sensors, actuators):
        raise InputError(
            f"{label}: has {controller.sensors} sensors and {controller.actuators} actuators; "
            f"{simulation} has {sensors} and {actuators}"
        )


def _ignore_progress(done: int, total: int, waiting_for: str) -> None:
    """Ignore progress."""
