"""Evaluating genomes and controllers without optimization."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.core.arguments import checked, instance
from swarmwright.core.arrays import float32_of
from swarmwright.core.errors import InputError, RunError
from swarmwright.core.plug_in_code import reported
from swarmwright.core.random_numbers import Stream
from swarmwright.core.simulation_names import is_python
from swarmwright.core.untrusted import one_line
from swarmwright.evaluation.base import HERE, Controllers, Progress, Servers
from swarmwright.evaluation.in_process import PythonBackend
from swarmwright.evaluation.opening import is_here, open_backend
from swarmwright.evaluation.prepared import check_finite, check_size, prepared
from swarmwright.experiment.evolved import unknown
from swarmwright.experiment.experiment import Experiment
from swarmwright.representations.controller import Controller
from swarmwright.simulations import catalogue
from swarmwright.store import Journal
from swarmwright.user_code.loaded import warn_of_edits
from swarmwright.user_code.parts import of_simulation

_log = logging.getLogger("swarmwright")
_MOST_TOLD = 10
"""Reasons why episodes failed that are told, at most."""


@checked
def evaluate(
    experiment: Experiment,
    genomes: ArrayLike,
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> NDArray[np.float64]:
    """Return the fitness of genomes, as the experiment's ranking makes it of their episodes.

    Args:
        experiment: simulation, controller and ranking count; the method does not.
        genomes: float32, (candidates, experiment.genome_size), finite.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.

    Returns:
        float64, (candidates,), more is better, NaN where the evaluation failed; the logger `swarmwright`
        warns of the reason. It does not depend on where it was computed.

    Raises:
        InputError: the genomes have another shape or are not finite, or the experiment cannot be run as it
            is.
        RunError: no broker or no fitting server.
    """
    instance("experiment", experiment, Experiment, "Experiment.load(file)")
    rows = _rows(genomes)
    if is_here(experiment, broker, servers):
        alone = prepared(experiment)
        if alone is not None:
            return alone.scores(rows, on_progress)
    with reported():
        return _evaluated(experiment, rows, broker, servers, on_progress)


def _evaluated(
    experiment: Experiment,
    rows: NDArray[np.float32],
    broker: str | None,
    servers: Servers | None,
    on_progress: Progress | None,
) -> NDArray[np.float64]:
    check_finite(rows)
    _warn_of_edits(experiment)
    ranking = experiment.new_ranking()
    seeds = ranking.seeds(experiment.first_seed)
    most = max(len(rows), 1) * len(seeds)
    with open_backend(experiment, broker=broker, servers=servers, most=most) as backend:
        representation = experiment.representation(backend.sensors, backend.actuators)
        check_size(rows, representation.genome_size)
        if not len(rows):
            return np.empty(0)
        results = backend.evaluate(Controllers.of(representation, rows), seeds, on_progress or _silent)
    if not isinstance(backend, PythonBackend):  # which has told
        for reason in list(dict.fromkeys(results.journal.errors))[:_MOST_TOLD]:
            _log.warning("an episode failed: %s", one_line(reason))
    return ranking.score(results.fitness)


@checked
def simulate(
    experiment: Experiment,
    controller: Controller | None = None,
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    visual: bool = False,
    seed: int | None = None,
    on_progress: Progress | None = None,
) -> float:
    """Run one episode and return its fitness.

    Args:
        experiment: simulation and parameters count; the episode's seed is `parameters.seed` (default 0).
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
        RunError: no broker, no fitting server, or the episode failed.
    """
    instance("experiment", experiment, Experiment, "Experiment.load(file)")
    if controller is not None:
        instance("controller", controller, Controller, "Controller.load(path)")
    with reported():
        return episode(
            experiment,
            controller,
            broker=broker,
            servers=servers,
            visual=visual,
            seed=seed,
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
    if not 0 <= seed < 2**63:
        raise InputError(f"seed: must be from 0 to 2**63 - 1, not {seed}")
    _warn_of_edits(experiment)
    specification = None if controller is None else controller.specification
    if servers is None and broker is None and experiment.broker is None and experiment.servers not in HERE:
        in_python = experiment.in_python or (controller is not None and controller.in_python)
        servers = "in-process" if in_python else 1
    with open_backend(
        experiment, broker=broker, servers=servers, visual=visual, most=1, controller=specification
    ) as backend:
        if isinstance(backend, PythonBackend):
            backend.tell = lambda *_: None  # the error below says why the episode failed
        if controller is None:
            representation = experiment.representation(backend.sensors, backend.actuators)
            genome = representation.initial(Stream(experiment.seed, "initial"))
            controllers = Controllers.of(representation, genome[np.newaxis])
            if not experiment.steers:
                controller = Controller(representation.specification(genome))
        else:
            _check_fit(controller, backend.sensors, backend.actuators, experiment.simulation)
            weights = np.array([controller.specification["weights"]], dtype=np.float32)
            controllers = Controllers(controller.specification, weights)
        results = backend.evaluate(controllers, [seed], on_progress or _silent)
    fitness = float(results.fitness[0, 0])
    if not np.isfinite(fitness):
        raise RunError(_reason(results.journal))
    metrics = dict(zip(backend.metrics, results.metrics[0, 0].tolist(), strict=True))
    return Episode(fitness + 0.0, metrics, {} if controller is None else controller.parameters, seed)


def _warn_of_edits(experiment: Experiment) -> None:
    """Warn where this process would execute other code than a server that is started now."""
    if is_python(experiment.simulation):
        part = of_simulation(experiment.simulation)
        warn_of_edits([] if part is None else [part])


def _rows(genomes: ArrayLike) -> NDArray[np.float32]:
    rows = float32_of("genomes", genomes)
    if rows.ndim != 2:
        raise InputError(f"genomes: have the shape {rows.shape}; expected (candidates, genome_size)")
    return rows


def _check_fit(controller: Controller, sensors: int, actuators: int, simulation: str) -> None:
    if controller.parameters:
        if catalogue.is_described(simulation):
            for name, message in unknown(simulation, controller.parameters):
                raise InputError(f"controller: {name}: {message}")
        return
    if (controller.sensors, controller.actuators) != (sensors, actuators):
        raise InputError(
            f"controller: has {controller.sensors} sensors and {controller.actuators} actuators; "
            f"{simulation} has {sensors} and {actuators}"
        )


def _reason(journal: Journal) -> str:
    reasons = journal.errors
    return f"the episode failed: {one_line(reasons[-1]) if reasons else 'its fitness is not a finite number'}"


def _silent(done: int, total: int, waiting_for: str) -> None:
    """Show nothing."""
