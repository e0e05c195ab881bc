"""Who evaluates.

Simulation servers on a broker, or this process. Started, used and closed in one `with` block.
"""

import json
import logging
import secrets
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.broker.address import broker_problem
from swarmwright.broker.credentials import prepare
from swarmwright.broker.waiting import patiently
from swarmwright.core.environment_names import LIBRARIES
from swarmwright.core.errors import InputError, RunError, engine_errors
from swarmwright.core.suggestions import did_you_mean, unknown
from swarmwright.evaluation import reports
from swarmwright.evaluation.local_servers import LocalServers, automatic_count, processors, running_on
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.fitness import FitnessExpression
from swarmwright.representations import Representation
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import is_own
from swarmwright.typing import Genomes
from swarmwright.user_code.changes import files_of

Servers = int | Literal["auto", "local", "in-process"]
OUTPUT = "servers.log"
"""File in a run's folder with what started servers printed."""

HERE = ("local", "in-process")
"""Values of `servers` with which no broker is used that others can see."""

Progress = Callable[[int, int, str], None]
"""Called about ten times a second with (episodes done, episodes in all, what is waited for)."""


@dataclass(frozen=True)
class Crews:
    """Controllers of one architecture; each steers all agents of its episodes."""

    architecture: str
    """A specification as JSON; its weights do not count."""
    weights: NDArray[np.float32]
    """(candidates, weights)"""

    @classmethod
    def of(cls, representation: Representation, genomes: Genomes) -> Self:
        """Return the controllers that genomes stand for."""
        architecture = json.dumps(representation.architecture(), allow_nan=False)
        return cls(architecture, np.ascontiguousarray(representation.weights(genomes), dtype=np.float32))


@dataclass(frozen=True)
class Results:
    """What came out of evaluations, in the order of candidates and episodes."""

    fitness: NDArray[np.float64]
    """(candidates, episodes), NaN where the evaluation failed."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics that the fitness needs), NaN where the simulation failed."""
    journal: list[dict[str, Any]]
    """An entry per attempt at one evaluation or at a block of them, and per warning."""


def _judged(expression: FitnessExpression | None, results: Results, numbers: Sequence[int]) -> Results:
    """Put the experiment's fitness in the place of the simulation's own.

    An episode for which it has no value has failed. numbers: of the candidates, for what is said of them.
    """
    if expression is None:
        return results
    measured = np.isfinite(results.fitness)
    values, faults = expression(results.fitness[measured], results.metrics[measured])
    fitness = np.full_like(results.fitness, np.nan)
    fitness[measured] = values
    places = np.argwhere(measured)
    failures = []
    for fault in faults:
        candidate, episode = places[fault.index]
        error = f"fitness: {fault.reason}"
        failures.append(
            {"warning": f"episode {episode}: {error}", "candidate": int(numbers[candidate]), "error": error}
        )
    return Results(fitness, results.metrics, results.journal + failures)


Feed = Callable[[Sequence[int], Results], NDArray[np.float32] | None]
"""Takes the numbers of candidates, from 0, that have been evaluated, and what came out; returns the weights
of further ones, (candidates, weights), maybe none, or None to stop."""


class Backend(Protocol):
    """Evaluates controllers."""

    sensors: int
    actuators: int
    metrics: tuple[str, ...]
    """Names of the metrics that the experiment's fitness needs."""
    description: str
    """Where the work is done, for people and the journal."""

    def evaluate(self, crews: Crews, seeds: Sequence[int], on_progress: Progress) -> Results:
        """Run every controller in an episode of every seed."""

    def stream(self, crews: Crews, seeds: Sequence[int], feed: Feed, on_progress: Progress) -> None:
        """Run controllers as they come: first `crews`, then those that `feed` returns."""

    def about(
        self,
        run: str,
        generation: int | None,
        generations: int,
        evaluations: tuple[int, int] | None = None,
    ) -> None:
        """Say what the evaluations that follow are for, to those who watch.

        evaluations: where several generations are under way, episodes done before and of the whole run.
        """

    def incidents(self) -> dict[str, int]:
        """How often something went wrong, or was done about it, so far: what did at all, by name."""

    def log_to(self, folder: Path) -> None:
        """Write what started servers print to a file in a run's folder."""

    def post_evaluates(self) -> None:
        """Say that what follows belongs to no generation: the best, on other seeds."""


@contextmanager
def open_backend(
    experiment: Experiment,
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    visual: bool = False,
    wait: float | None = None,
    most: int | None = None,
) -> Iterator[Backend]:
    """Start what an experiment needs and yield the backend; end all of it afterwards.

    Args:
        experiment: names simulation, parameters, broker, servers.
        broker: use the servers on this broker, whatever the experiment says.
        servers: as the experiment's key. A number given here together with a broker is started on that
            broker. "auto" in a notebook means "local".
        visual: ask the server to draw.
        wait: seconds to wait for a broker that does not answer, instead of the experiment's.
        most: evaluations that there are, if that is known: no more worker processes are started for `local`.

    Raises:
        InputError: the simulation is unknown, or broker and local servers are both asked for.
        RunError: no broker, no fitting server, a server that does not start.
    """
    loading = sys.modules.get("swarmwright.simulations.loading")
    if loading is not None and loading.serving:
        raise RunError(
            "this is a simulation server, which imports the file only for its class; put what starts a run "
            'under `if __name__ == "__main__":`'
        )
    if broker is not None:
        problem = broker_problem(broker)
        if problem is not None:
            raise InputError(f"broker: {problem}")
    if isinstance(servers, int) and servers < 1:
        raise InputError(f"servers: must be auto, local, in-process or a number from 1 on, not {servers}")
    if servers in HERE and broker is not None:
        raise InputError(f"broker: servers are '{servers}', so no broker is used; leave one of the two out")
    wanted: Servers = experiment.servers if servers is None else servers
    if broker is None and servers not in HERE and wanted not in HERE:
        broker = experiment.broker
    if broker is None and wanted == "auto" and not visual and in_process_is_better(experiment):
        wanted = "local"
    if broker is None and wanted in HERE and not visual:
        _require_here(experiment)
        if wanted == "in-process" or not has_workers(experiment.simulation):
            yield _local_backend(experiment)
            return
    with ExitStack() as stack:
        address, local = open_servers(
            stack, experiment, broker, wanted, started=servers, visual=visual, most=most
        )
        patience = experiment.timeouts.connect if wait is None else wait
        with engine_errors():
            pool = patiently(
                lambda: _pool(experiment, address, visual=visual, alone=broker is None),
                patience,
                logging.getLogger("swarmwright").warning,
            )
        stack.callback(pool.close)
        local = local or running_on(address)
        if local is not None:
            local.attach(pool)
            stack.callback(local.detach)
        where = f"servers on {address}" if local is None else f"{local.count} servers on {address}"
        if wanted == "local" and local is not None:
            where = f"{local.count} worker processes"
        yield BrokerBackend(experiment, pool, local, where)


def has_workers(simulation: str) -> bool:
    """Whether `servers: local` means processes of their own: for code in Python that others find, too."""
    return is_own(simulation) and not simulation.startswith("__main__:")


def in_process_is_better(experiment: Experiment) -> bool:
    """Whether `servers: auto` means `local`: in a notebook, unless the experiment asks for servers.

    A notebook has no terminal for servers' last words, and people run its cells again and again.
    """
    asked = experiment.mode != "auto" or not catalogue.is_here(experiment.simulation)
    alone = "ipykernel" in sys.modules or experiment.simulation.startswith("__main__:")
    return alone and not asked


def open_servers(
    stack: ExitStack,
    experiment: Experiment,
    broker: str | None,
    wanted: Servers,
    *,
    started: Servers | None,
    visual: bool = False,
    most: int | None = None,
) -> tuple[str, LocalServers | None]:
    """Start the embedded broker and servers as far as they are needed; they end with the stack.

    Args:
        stack: ends what is started.
        experiment: whose simulation the servers offer.
        broker: of somebody else; servers are started on it when `started` is a number.
        wanted: how many servers.
        started: what the caller asked for, instead of the experiment.
        visual: let the servers draw.
        most: as in `open_backend`.

    Returns:
        The broker's address, and the servers; None when none were started.
    """
    if broker is not None:
        prepare(broker)
    if broker is not None and not isinstance(started, int):
        return broker, None
    _require_here(experiment)
    if experiment.simulation.startswith("__main__:"):
        raise InputError(
            f"simulation: {experiment.label} is defined in this session alone, where no server finds it; "
            "write the class to a file, or evaluate with servers: in-process"
        )
    count = wanted if isinstance(wanted, int) else 1 if visual else automatic_count()
    if wanted == "local" and not visual:
        count = min(processors(), most or processors())
    if broker is None:
        with engine_errors():
            embedded = _engine.Broker()
        stack.callback(embedded.stop)
        address, first = embedded.url, 1
    else:
        # Others may have servers on this broker; ids must differ.
        address, first = broker, 1 + secrets.randbelow(2**31 - 1 - count)
    files = files_of(experiment.simulation) if is_own(experiment.simulation) else {}
    settings = [
        {
            "simulation": experiment.simulation,
            "files": files,
            "broker": address,
            "id": first + index,
            "prefix": experiment.prefix,
            "step_timeout": experiment.timeouts.step,
            "alone": broker is None,
        }
        for index in range(count)
    ]
    servers = LocalServers(settings, visual=visual, episode_timeout=experiment.timeouts.episode)
    return address, stack.enter_context(servers)


def _pool(experiment: Experiment, address: str, *, visual: bool, alone: bool) -> _engine.Pool:
    return _engine.Pool(
        address,
        simulation=catalogue.title(experiment.simulation),
        parameters=json.dumps(experiment.parameters, allow_nan=False),
        requirements=experiment.requirements.model_dump_json(exclude_none=True),
        sensors=experiment.sensors,
        actuators=experiment.actuators,
        prefix=experiment.prefix,
        tool="swarmwright",  # host and process are added
        mode=experiment.mode,
        metrics=_metrics(experiment.fitness_expression),
        visual=visual,
        discovery_timeout=experiment.timeouts.discovery,
        step_timeout=experiment.timeouts.step,
        episode_timeout=experiment.timeouts.episode,
        least_timeout=experiment.timeouts.least,
        attempts=experiment.faults.attempts,
        quarantine=experiment.faults.quarantine,
        backup=experiment.faults.backup,
        audit=experiment.faults.audit,
        alone=alone,
    )


def _metrics(expression: FitnessExpression | None) -> tuple[str, ...]:
    return () if expression is None else expression.metrics


def _require_here(experiment: Experiment) -> None:
    simulation = experiment.simulation
    if not catalogue.is_here(simulation):
        library, _, rest = simulation.partition(":")
        hint = "any other needs a broker on which a server offers it"
        if simulation.endswith(".py"):
            hint = f"one in Python is named by its class, {simulation}:Class"
        elif rest and did_you_mean(library, LIBRARIES):
            hint = f"environments of other libraries are named {', '.join(f'{one}:..' for one in LIBRARIES)}"
        where = experiment.place("simulation")
        raise InputError(f"{where}{unknown('simulation', simulation, catalogue.titles())}; {hint}")
    announced, wanted = catalogue.description(simulation), experiment.requirements
    title, most = announced["title"], announced.get("max_agents")
    if wanted.dimensions != announced["dimensions"]:
        raise InputError(
            f"{experiment.place('requirements')}{title} has {announced['dimensions']} dimensions, not "
            f"{wanted.dimensions}; leave the key out"
        )
    if most is not None and (wanted.max_agents or 0) > most:
        raise InputError(
            f"{experiment.place('requirements')}{title} has at most {most} agents, not {wanted.max_agents}"
        )


def _local_backend(experiment: Experiment) -> Backend:
    if is_own(experiment.simulation):
        from swarmwright.evaluation.in_process import OwnBackend

        return OwnBackend(experiment)
    return LocalBackend(experiment)


class LocalBackend:
    """Evaluates built-in simulations in this process, without broker and servers."""

    def __init__(self, experiment: Experiment) -> None:
        announced = catalogue.description(experiment.simulation)
        self.sensors: int = announced["sensors"]
        self.actuators: int = announced["actuators"]
        self.description = "in this process"
        self._simulation = experiment.simulation
        self.parameters = json.dumps(experiment.parameters, allow_nan=False)
        self._expression = experiment.fitness_expression
        self.metrics = _metrics(self._expression)
        self._failed = 0

    def evaluate(self, crews: Crews, seeds: Sequence[int], on_progress: Progress) -> Results:
        """Return the results; an episode fails where the fitness expression or the simulation's code does."""
        return self._evaluate(crews, seeds, on_progress, range(len(crews.weights)))

    def _evaluate(
        self, crews: Crews, seeds: Sequence[int], on_progress: Progress, numbers: Sequence[int]
    ) -> Results:
        with engine_errors():
            results = self.compute(crews, seeds, on_progress)
        for entry in results.journal:
            entry["candidate"] = numbers[entry["candidate"]]
        results = _judged(self._expression, results, numbers)
        self._failed += int(np.isnan(results.fitness).sum())
        return results

    def compute(self, crews: Crews, seeds: Sequence[int], on_progress: Progress) -> Results:
        """Return the results with the simulation's own fitness. Raises the engine's errors."""
        fitness, metrics = _engine.evaluate(
            self._simulation,
            self.parameters,
            crews.architecture,
            crews.weights,
            list(seeds),
            on_progress,
            metrics=self.metrics,
        )
        return Results(fitness, metrics, [])

    def about(
        self,
        run: str,
        generation: int | None,
        generations: int,
        evaluations: tuple[int, int] | None = None,
    ) -> None:
        """Nobody watches: there is no broker."""

    def incidents(self) -> dict[str, int]:
        """Return how many evaluations failed; no more can go wrong here that is not an error."""
        return {"failed": self._failed} if self._failed else {}

    def log_to(self, folder: Path) -> None:
        """Nothing is printed that is not seen."""

    def post_evaluates(self) -> None:
        """Nobody is told."""

    def stream(self, crews: Crews, seeds: Sequence[int], feed: Feed, on_progress: Progress) -> None:
        """Evaluate all that are in flight as one block, again and again: nobody is slower here."""
        first, weights = 0, crews.weights
        while len(weights):
            numbers = range(first, first + len(weights))
            results = self._evaluate(Crews(crews.architecture, weights), seeds, on_progress, numbers)
            first += len(weights)
            more = feed(numbers, results)
            if more is None:
                return
            weights = more


class BrokerBackend:
    """Evaluates on simulation servers through a broker."""

    def __init__(
        self, experiment: Experiment, pool: _engine.Pool, servers: LocalServers | None, where: str
    ) -> None:
        self._pool = pool
        self._servers = servers
        self._restarts = 0 if servers is None else servers.restarts
        self._without_value = 0
        self._run: str | None = None
        if reports.wanted():
            pool.listen(lambda text: reports.tell(json.loads(text)), warnings_only=reports.only_warnings())
        self._expression = experiment.fitness_expression
        self.metrics = _metrics(self._expression)
        self.description = where

        try:
            with engine_errors():
                self.sensors, self.actuators = pool.wait_for_server(sizes=experiment.steers)
        except RunError as error:
            self._check_servers()
            known = catalogue.titles()
            title = experiment.simulation
            hint = "" if catalogue.is_here(title) else did_you_mean(title, known)
            raise RunError(f"{error}{self._metrics_hint() or hint}") from error

    def about(
        self,
        run: str,
        generation: int | None,
        generations: int,
        evaluations: tuple[int, int] | None = None,
    ) -> None:
        """Tell those who watch the broker."""
        self._run = run
        self._pool.about(run, generation, generations, evaluations)

    def incidents(self) -> dict[str, int]:
        """Return what the pool counted."""
        counts: dict[str, int] = json.loads(self._pool.counts())
        if self._servers is not None:
            counts["restarts"] = self._servers.restarts - self._restarts
        counts["failed"] = counts.get("failed", 0) + self._without_value
        return {name: count for name, count in counts.items() if count}

    def log_to(self, folder: Path) -> None:
        """Write what started servers print to a file in a run's folder."""
        if self._servers is not None:
            self._servers.log_to(folder / OUTPUT)

    def post_evaluates(self) -> None:
        """Say that what follows belongs to no generation, in servers.log and to those who watch."""
        self._pool.about(self._run)
        if self._servers is not None:
            self._servers.work_for("post-evaluation")

    def _valued(self, results: Results, numbers: Sequence[int]) -> Results:
        """Apply the experiment's fitness, and count the episodes for which it has no value."""
        judged = _judged(self._expression, results, numbers)
        self._without_value += len(judged.journal) - len(results.journal)
        return judged

    def _metrics_hint(self) -> str:
        """A name that servers announce, near one that none of them does."""
        announced = self._pool.announced_metrics()
        missing = [name for name in self.metrics if name not in announced]
        return next((hint for name in missing if (hint := did_you_mean(name, announced))), "")

    def evaluate(self, crews: Crews, seeds: Sequence[int], on_progress: Progress) -> Results:
        """Return the results, NaN where it failed, and what the pool did for them."""

        def progress(done: int, total: int, waiting_for: str) -> None:
            self._check_servers()
            on_progress(done, total, waiting_for)

        with engine_errors():
            fitness, metrics, journal = self._pool.evaluate(
                crews.architecture, crews.weights, list(seeds), progress
            )
        self._check_servers()
        results = Results(fitness, metrics, _entries(journal))
        return self._valued(results, range(len(fitness)))

    def stream(self, crews: Crews, seeds: Sequence[int], feed: Feed, on_progress: Progress) -> None:
        """Evaluate on the servers that there are; each gets another candidate as soon as it has done one."""

        def take(
            candidates: list[int], fitness: NDArray[np.float64], metrics: NDArray[np.float64], journal: str
        ) -> NDArray[np.float32] | None:
            self._check_servers()
            results = Results(fitness, metrics, _entries(journal))
            return feed(candidates, self._valued(results, candidates))

        def progress(done: int, total: int, waiting_for: str) -> None:
            self._check_servers()
            on_progress(done, total, waiting_for)

        with engine_errors():
            self._pool.stream(crews.architecture, crews.weights, list(seeds), take, progress)

    def _check_servers(self) -> None:
        if self._servers is not None:
            self._servers.check()


def _entries(journal: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in journal.split("\n") if line]  # texts may hold other line ends
