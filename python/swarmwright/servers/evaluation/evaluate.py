"""Evaluating genomes and controllers without optimization."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import index
from os import PathLike
from typing import Any, Literal, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.arguments import checked, instance, simulation_seed
from swarmwright.common.arrays import float32_of
from swarmwright.common.errors import InputError
from swarmwright.common.plug_in_code import reported
from swarmwright.common.random_numbers import Stream
from swarmwright.common.simulation_names import is_python
from swarmwright.common.untrusted import one_line
from swarmwright.common.values import ComparedByValue
from swarmwright.controllers.controller import Controller
from swarmwright.experiment.derived import has_python_modules, place_of, steers_agents
from swarmwright.experiment.evolved import unknown
from swarmwright.experiment.experiment import Experiment, experiment_of
from swarmwright.methods.rankings.slow_simulation import SlowOptions
from swarmwright.servers.evaluation.base import HERE, Backend, Controllers, Progress, Results, Servers
from swarmwright.servers.evaluation.code_failures import failed
from swarmwright.servers.evaluation.here import is_here
from swarmwright.servers.evaluation.in_process import PythonBackend
from swarmwright.servers.evaluation.metrics import asked_for
from swarmwright.servers.evaluation.module_code import is_in_python
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.evaluation.prepared import check_finite, check_size, prepared
from swarmwright.servers.evaluation.seeds import seeds_of
from swarmwright.servers.rows import Journal
from swarmwright.simulations import catalogue
from swarmwright.simulations.user_code.in_process import warn_of_edits
from swarmwright.simulations.user_code.parts import read_simulation

_log = logging.getLogger("swarmwright")
_MOST_TOLD = 10
"""Reasons why episodes failed that are told, at most."""


@checked
def evaluate(
    experiment: Experiment | Mapping[str, Any] | str | PathLike[str],
    genomes: ArrayLike,
    *,
    generation: int = 0,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> NDArray[np.float64]:
    """Return the fitness of genomes, as the experiment's ranking makes it of their episodes.

    For optimizers of other libraries, which ask for genomes and are told their fitness:

        for generation in range(200):
            genomes = optimizer.ask()
            optimizer.tell(genomes, evaluate(experiment, genomes, generation=generation))

    `ranking.reevaluate` has no effect: which genomes are evaluated again is up to the caller, since it is the
    method of a run that knows the members that stay.

    Args:
        experiment: or its file, or a mapping with the keys of one; simulation, controller and ranking count,
            the method does not.
        genomes: float32, (candidates, experiment.genome_size), finite.
        generation: whose seeds the episodes have, from 0 on. With `ranking.seeds: new` each generation has
            others, `parameters.seed + generation * episodes` and the following ones; with `same` all have
            those of generation 0.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Returns:
        float64, (candidates,), more is better, NaN where the evaluation failed; the logger `swarmwright`
        warns of the reason. It does not depend on where it was computed.

    Raises:
        InputError: the genomes have another shape or are not finite, there is no such generation, the ranking
            needs a second simulation (multi_fidelity, transferability), or the experiment cannot be run as
            it is.
        RunError: no broker or no fitting server.

    Examples:
        >>> experiment = swarmwright.Experiment.load("experiments/minisim.yaml")
        >>> genomes = np.zeros((2, experiment.genome_size), np.float32)
        >>> swarmwright.evaluate(experiment, genomes, servers="in-process")
        array([-6., -6.])

    See also: `evaluate_episodes`, for the fitness and metrics of each episode; `post_evaluate`, for a
    candidate of a run.
    """
    experiment = experiment_of(experiment)
    _check_ranking(experiment, generation)
    rows = _rows(genomes)
    if is_here(experiment, broker, servers):
        alone = prepared(experiment)
        if alone is not None:
            return alone.scores(rows, on_progress, generation)
    found = _evaluated(experiment, rows, generation, (), broker, servers, on_progress)
    return found.fitness


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeResults(ComparedByValue):
    """What came out of the episodes of some genomes.

    Candidates are in the order of the genomes, episodes in that of `seeds`. Fitness and metrics are in the
    units of the simulation; more fitness is better.
    """

    fitness: NDArray[np.float64]
    """(candidates,), the aggregate of the ranking over the episodes; NaN where an episode failed."""
    episodes: NDArray[np.float64]
    """(candidates, episodes), fitness of each episode; NaN where it failed."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics), in the order of `names`; NaN where the episode failed."""
    names: tuple[str, ...]
    """Names of the metrics: those that the experiment's fitness needs, then the others that were asked
    for."""
    seeds: tuple[int, ...]
    """Simulation seed of each episode."""


@checked
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

    Methods of quality diversity take descriptors from the metrics, those with several objectives the
    objectives; `found.metrics.mean(axis=1)` has a row for each genome.

    Args:
        experiment: as in `evaluate`.
        genomes: as in `evaluate`.
        metrics: names of metrics to be measured beside those that the fitness needs; "all": those that the
            simulation announces.
        generation: as in `evaluate`.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Raises:
        InputError: as in `evaluate`; or there is no such metric.
        RunError: no broker or no fitting server.

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
    experiment = experiment_of(experiment)
    _check_ranking(experiment, generation)
    asked = asked_for(experiment, metrics)
    return _evaluated(experiment, _rows(genomes), generation, asked, broker, servers, on_progress)


def _check_ranking(experiment: Experiment, generation: int) -> None:
    """Raise InputError where fitness is not made of episodes in one simulation, or for no generation."""
    if generation < 0:
        raise InputError(f"generation: must be at least 0, not {generation}")
    if isinstance(experiment.ranking, SlowOptions):
        kind: str = experiment.ranking.kind
        raise InputError(
            f"{place_of(experiment, 'ranking')}{kind} needs a second simulation, and earlier generations, "
            "which only optimize() has; take another ranking: "
            "experiment.replace(ranking={'kind': 'absolute'})"
        )


def _evaluated(
    experiment: Experiment,
    rows: NDArray[np.float32],
    generation: int,
    metrics: Sequence[str],
    broker: str | None,
    servers: Servers | None,
    on_progress: Progress | None,
) -> EpisodeResults:
    check_finite(rows)
    with reported():
        _warn_of_edits(experiment)
        ranking = experiment.new_ranking()
        seeds = seeds_of(ranking, experiment.first_seed, generation)
        most = max(len(rows), 1) * len(seeds)
        with open_backend(experiment, broker=broker, servers=servers, most=most, metrics=metrics) as backend:
            representation = experiment.representation(backend.sensors, backend.actuators)
            check_size(rows, representation.genome_size)
            if len(rows):
                controllers = Controllers.of(representation, rows)
                results = backend.evaluate(controllers, seeds, on_progress or _silent)
            else:
                results = _empty_results(len(seeds), len(backend.metrics))
        tell_failures(backend, results)
        return EpisodeResults(
            fitness=ranking.score(results.fitness) if len(rows) else np.empty(0),
            episodes=results.fitness + 0.0,
            metrics=results.metrics + 0.0,
            names=backend.metrics,
            seeds=tuple(seeds),
        )


def tell_failures(backend: Backend, results: Results) -> None:
    """Log why episodes failed, each reason once."""
    if isinstance(backend, PythonBackend):  # which tells by itself
        backend.tell_held()
        return
    for reason in list(dict.fromkeys(results.journal.errors))[:_MOST_TOLD]:
        _log.warning("an episode failed: %s", one_line(reason))


def _empty_results(episodes: int, metrics: int) -> Results:
    """Return the results of no candidates."""
    return Results(np.empty((0, episodes)), np.empty((0, episodes, metrics)), Journal())


@checked
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
        experiment: or its file, or a mapping with the keys of one; simulation and parameters count, the
            episode's seed is `parameters.seed` (default 0).
        controller: for all agents; default: a random one of the experiment's representation and seed, the
            same as candidate 0 of an optimization.
        broker: as in `optimize`.
        servers: as in `optimize`, except that one server is enough.
        visual: ask the server to draw, through the protocol's `visual` flag. A server started here draws on
            this process's standard output.
        seed: of the simulation, instead of `parameters.seed`.
        on_progress: as in `optimize`.

    Raises:
        InputError: the controller does not fit the simulation, or the experiment cannot be run as it is.
        SimulationError: the episode failed in the code of the simulation.
        RunError: no broker, no fitting server, or the episode failed for another reason.

    Examples:
        >>> swarmwright.simulate("experiments/minisim.yaml", run.best.controller, servers="in-process")
        -...

    See also: `Run.replay`, to watch an episode; `Episodes`, to steer the agents by your own code.
    """
    experiment = experiment_of(experiment)
    if controller is not None:
        instance("controller", controller, Controller, "Controller.load(path)")
    with reported():
        return episode(
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
    """One episode that was run."""

    fitness: float
    metrics: dict[str, float]
    """Those that the experiment's fitness needs, by name."""
    parameters: dict[str, float | int | str]
    """Values of a parameter set, by name; {} for what steers agents."""
    seed: int
    """Of the simulation."""


def episode(
    experiment: Experiment,
    controller: Controller | None,
    *,
    broker: str | None,
    servers: Servers | None = None,
    visual: bool = False,
    seed: int | None = None,
    on_progress: Progress | None = None,
) -> Episode:
    """Run one episode; all as in `simulate`."""
    seed = experiment.first_seed if seed is None else seed
    simulation_seed("seed", seed)
    _warn_of_edits(experiment)
    specification = None if controller is None else controller.specification
    if servers is None and broker is None and experiment.broker is None and experiment.servers not in HERE:
        here = has_python_modules(experiment) or (specification is not None and is_in_python(specification))
        servers = "in-process" if here else 1
    with open_backend(
        experiment, broker=broker, servers=servers, visual=visual, most=1, controller=specification
    ) as backend:
        if isinstance(backend, PythonBackend):
            backend.tell = lambda *_: None  # the error below says why the episode failed
        if controller is None:
            representation = experiment.representation(backend.sensors, backend.actuators)
            genome = representation.initial(Stream(experiment.seed, "initial"))
            controllers = Controllers.of(representation, genome[np.newaxis])
            if not steers_agents(experiment):
                controller = Controller(representation.specification(genome))
        else:
            check_fit(controller, backend.sensors, backend.actuators, experiment.simulation)
            weights = np.array([controller.specification["weights"]], dtype=np.float32)
            controllers = Controllers(controller.specification, weights)
        results = backend.evaluate(controllers, [seed], on_progress or _silent)
    fitness = float(results.fitness[0, 0])
    if not np.isfinite(fitness):
        raise failed(
            "the episode failed: ",
            results.journal.errors,
            backend.failure_of,
            unknown="its fitness is not a finite number",
        )
    metrics = dict(zip(backend.metrics, results.metrics[0, 0].tolist(), strict=True))
    return Episode(fitness + 0.0, metrics, {} if controller is None else controller.parameters, seed)


def _warn_of_edits(experiment: Experiment) -> None:
    """Warn where this process would execute other code than a server that is started now."""
    if is_python(experiment.simulation):
        part = read_simulation(experiment.simulation)
        warn_of_edits([] if part is None else [part])


def _rows(genomes: ArrayLike) -> NDArray[np.float32]:
    rows = float32_of("genomes", genomes)
    if rows.ndim != 2:
        raise InputError(f"genomes: have the shape {rows.shape}; expected (candidates, genome_size)")
    return rows


def check_fit(
    controller: Controller, sensors: int, actuators: int, simulation: str, place: str = "controller"
) -> None:
    """Raise InputError unless a controller fits a simulation, whose agents have these sizes.

    place: what the message calls the controller.
    """
    if controller.parameters:
        if catalogue.has_description(simulation):
            for name, message in unknown(simulation, controller.parameters):
                raise InputError(f"{place}: {name}: {message}")
        return
    if (controller.sensors, controller.actuators) != (sensors, actuators):
        raise InputError(
            f"{place}: has {controller.sensors} sensors and {controller.actuators} actuators; "
            f"{simulation} has {sensors} and {actuators}"
        )


def _silent(done: int, total: int, waiting_for: str) -> None:
    """Show nothing."""
