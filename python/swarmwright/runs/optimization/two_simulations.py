"""Evaluation in two simulations: the experiment's, and for some candidates the ranking's slow simulation."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

from swarmwright import _engine
from swarmwright.common.engine_types import AttemptFields, WarningFields
from swarmwright.common.errors import InputError, RunError, SimulationError, with_message
from swarmwright.experiment.competition import needed_metrics
from swarmwright.experiment.derived import fitness_expression, place_of, steers_agents, with_environment
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.targets import OtherSimulation, slow_of
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.rankings.slow_simulation import METRIC, SlowRanking
from swarmwright.methods.rankings.tournament import Tournament
from swarmwright.servers.evaluation.base import (
    BROKERLESS,
    AuditedEpisode,
    Backend,
    Controllers,
    Feed,
    OnResults,
    Progress,
    Results,
    Servers,
    metrics_of,
    resolve_servers,
)
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.servers.rows import Journal, ServerUses
from swarmwright.simulations import catalogue
from swarmwright.simulations.user_code.permission import require_named

_SLOW_PREFIX = "slow: "
"""Prefix of launcher names of the slow simulation."""


class TwoSimulations:
    """A backend for two simulations; evaluations without a ranking run in the fast one.

    Args:
        fast: backend of the experiment's simulation.
        slow: backend of the ranking's slow simulation.
        name: name of the slow simulation.
    """

    def __init__(self, fast: Backend, slow: Backend, name: str) -> None:
        self.fast, self.slow, self.name = fast, slow, name
        self.sensors, self.actuators = fast.sensors, fast.actuators
        self.is_foreign, self.hash_seed = fast.is_foreign, fast.hash_seed
        self.metrics = (*fast.metrics, METRIC)
        self.may_fail = fast.may_fail or slow.may_fail
        self.description = f"{fast.description}; {name}: {slow.description}"

    def evaluate(
        self,
        controllers: Controllers,
        seeds: Sequence[int],
        on_progress: Progress,
        meanwhile: Callable[[], None] | None = None,
        on_results: OnResults | None = None,
    ) -> Results:
        """Evaluate in the fast simulation."""
        return self.fast.evaluate(controllers, seeds, on_progress, meanwhile, on_results)

    def repeat(
        self, controllers: Controllers, evaluations: Sequence[AuditedEpisode], on_progress: Progress
    ) -> tuple[Results, list[int | None]]:
        """Repeat evaluations in the fast simulation."""
        return self.fast.repeat(controllers, evaluations, on_progress)

    def tolerance(self, servers: AbstractSet[int | None]) -> float | None:
        """Return how far results of the fast simulation may differ."""
        return self.fast.tolerance(servers)

    def evaluator(self, architecture: dict[str, Any]) -> _engine.Evaluator | None:
        """Return the evaluator of the fast simulation."""
        return self.fast.evaluator(architecture)

    def background_evaluator(self, architecture: dict[str, Any]) -> None:
        """Return None: every generation needs the ranking."""

    def release_background_evaluator(self) -> None:
        """Do nothing, as no evaluator is lent."""

    def check(self) -> None:
        """Raise RunError when either backend has ended for good."""
        self.fast.check()
        self.slow.check()

    def count_failed(self, results: Results) -> None:
        """Count failed episodes that the engine has evaluated by itself."""
        self.fast.count_failed(results)

    def build_journal(self, attempts: Iterable[AttemptFields], warnings: Iterable[WarningFields]) -> Journal:
        """Return the journal of evaluations that the engine has made by itself."""
        return self.fast.build_journal(attempts, warnings)

    def failure_of(self, reason: str, /) -> SimulationError | None:
        """Return the error of either simulation's code for a reason in a journal."""
        return self.fast.failure_of(reason) or self.slow.failure_of(reason)

    def stream(
        self, controllers: Controllers, seeds: Sequence[int], feed: Feed, on_progress: Progress
    ) -> None:
        """Evaluate a stream of controllers in the fast simulation."""
        self.fast.stream(controllers, seeds, feed, on_progress)

    def announce(
        self,
        run: str,
        generation: int | None,
        generations: int,
        evaluations: tuple[int, int] | None = None,
    ) -> None:
        """Publish the run and the generation of the following evaluations."""
        self.fast.announce(run, generation, generations, evaluations)
        self.slow.announce(run, generation, generations, evaluations)

    def usage(self) -> str:
        """Return the servers used by both."""
        return "; ".join(filter(None, (self.fast.usage(), self.slow.usage())))

    def server_use(self) -> ServerUses:
        """Return the use of the servers of each launcher, with those of the slow simulation separate."""
        slow = {f"{_SLOW_PREFIX}{name}": use for name, use in self.slow.server_use().items()}
        return {**self.fast.server_use(), **slow}

    def incidents(self) -> dict[str, int]:
        """Return the sums of both backends' counts."""
        counts = self.fast.incidents()
        for name, count in self.slow.incidents().items():
            counts[name] = counts.get(name, 0) + count
        return counts

    def log_to(self, folder: Path) -> None:
        """Write the output of started servers to files in a run's folder."""
        self.fast.log_to(folder)
        self.slow.log_to(folder)

    def announce_post_evaluation(self) -> None:
        """Publish that the following evaluations belong to no generation."""
        self.fast.announce_post_evaluation()
        self.slow.announce_post_evaluation()


@contextmanager
def open_simulations(
    experiment: Experiment,
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    wait: float | None = None,
    earlier: ServerUses = MappingProxyType({}),
) -> Iterator[Backend]:
    """Open the backend of an experiment, together with that of its ranking's slow simulation if any.

    Arguments and errors as for `open_backend`. They apply to the slow simulation as well, unless its keys
    name servers or a broker.
    """
    target = slow_of(experiment)
    ranking = experiment.new_ranking()
    metrics = _list_extra_metrics(ranking, experiment)
    if target is None:
        with open_backend(
            experiment, broker=broker, servers=servers, wait=wait, metrics=metrics, earlier=earlier
        ) as backend:
            yield backend
        return
    assert isinstance(ranking, SlowRanking)
    code = target.find_code(experiment)
    if code is not None:
        require_named(code)  # before it is imported
    (slow_experiment,) = target.make_experiments(experiment, 1)
    slow_options: dict[str, Any] = {} if target.sets_servers else {"broker": broker, "servers": servers}
    if slow_experiment.broker is None and catalogue.is_local(slow_experiment.simulation):
        slow_options.pop("broker", None)
    brokers = [
        _find_broker(experiment, broker, servers),
        _find_broker(slow_experiment, slow_options.get("broker"), slow_options.get("servers")),
    ]
    _require_apart(experiment, slow_experiment, target, brokers)
    apart = {
        name.removeprefix(_SLOW_PREFIX): use for name, use in earlier.items() if name.startswith(_SLOW_PREFIX)
    }
    with ExitStack() as stack:
        fast = stack.enter_context(
            open_backend(
                experiment,
                broker=broker,
                servers=servers,
                wait=wait,
                metrics=metrics,
                earlier=earlier,
            )
        )
        try:
            slow = stack.enter_context(
                open_backend(slow_experiment, wait=wait, earlier=apart, **slow_options)
            )
        except (InputError, RunError) as error:
            location = f"{place_of(experiment, 'ranking')}slow: {target.name}"
            raise with_message(error, f"{location}: {error}") from error
        _require_fit(experiment, fast, slow, target)
        yield TwoSimulations(fast, slow, target.name)


def _require_fit(experiment: Experiment, fast: Backend, slow: Backend, target: OtherSimulation) -> None:
    sizes = [(backend.sensors, backend.actuators) for backend in (fast, slow)]
    if steers_agents(experiment) and sizes[0] != sizes[1]:
        fast_size, slow_size = (
            f"{sensors} sensors and {actuators} actuators" for sensors, actuators in sizes
        )
        raise InputError(
            f"{place_of(experiment, 'ranking')}slow: {target.name} has {slow_size}, but {experiment.label} "
            f"has {fast_size}"
        )


def _require_apart(
    experiment: Experiment, slow: Experiment, target: OtherSimulation, brokers: Sequence[str | None]
) -> None:
    """Raise InputError if both would need the same servers at the same time."""
    prefixes = {with_environment(side).prefix for side in (experiment, slow)}
    same = brokers[0] is not None and brokers[0] == brokers[1] and len(prefixes) == 1
    if same and experiment.simulation == slow.simulation:
        raise InputError(
            f"{place_of(experiment, 'ranking')}slow: {target.name} is the same simulation on the same "
            "broker, whose servers can work for only one of the two; give it another broker or prefix, or "
            "set servers: local"
        )


def _find_broker(experiment: Experiment, broker: str | None, servers: Servers | None) -> str | None:
    """Return the broker that `open_backend` uses with these arguments, None for an embedded broker."""
    servers = resolve_servers(experiment, servers)
    return experiment.broker if broker is None and servers not in BROKERLESS else broker


def find_descriptor_columns(ranking: Ranking, experiment: Experiment) -> list[int]:
    """Return the columns of the stored metrics that a ranking needs, in its order."""
    return _find_columns(ranking.descriptor if isinstance(ranking, SlowRanking) else (), ranking, experiment)


def find_needed_columns(ranking: Ranking, experiment: Experiment) -> list[int]:
    """Return the columns of the stored metrics that the method needs, in its order."""
    return _find_columns(experiment.method.needed_metrics, ranking, experiment)


def _list_extra_metrics(ranking: Ranking, experiment: Experiment) -> tuple[str, ...]:
    """Return the metrics evaluated for the ranking, the method and the constraints."""
    descriptor = ranking.descriptor if isinstance(ranking, SlowRanking) else ()
    sides = needed_metrics(ranking.options) if isinstance(ranking, Tournament) else ()
    return (*descriptor, *experiment.method.needed_metrics, *sides, *experiment.constraints)


def list_stored_metrics(ranking: Ranking, experiment: Experiment) -> tuple[str, ...]:
    """Return the names of the metrics in the results of a simulation, in order."""
    return metrics_of(fitness_expression(experiment), _list_extra_metrics(ranking, experiment))


def _find_columns(metrics: Sequence[str], ranking: Ranking, experiment: Experiment) -> list[int]:
    names = list_stored_metrics(ranking, experiment)
    return [names.index(name) for name in metrics]
