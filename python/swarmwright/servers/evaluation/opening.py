"""Opening of an experiment's backend: in process, with workers, or with servers and a broker."""

import logging
import secrets
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from types import MappingProxyType
from typing import Any, cast

from swarmwright import _engine
from swarmwright.common.engine_types import Requirements
from swarmwright.common.errors import InputError, RunError, engine_errors
from swarmwright.common.html import is_notebook
from swarmwright.common.simulation_names import SIMULATORS, is_command, is_python, simulator_file
from swarmwright.common.warn_once import warn_once
from swarmwright.controllers.modules.grammar import ACTUATORS, SENSORS
from swarmwright.experiment.broker_address import broker_problem
from swarmwright.experiment.derived import fitness_expression, has_python_modules, place_of, with_environment
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.launcher_entries import Entries
from swarmwright.servers.broker.credentials import check_environment, prepare
from swarmwright.servers.broker.private import start_private
from swarmwright.servers.broker.waiting import connect_with_retries
from swarmwright.servers.evaluation.base import (
    BROKERLESS,
    Backend,
    ServerChoice,
    Servers,
    StartedServers,
    metrics_of,
    resolve_servers,
)
from swarmwright.servers.evaluation.launched import LaunchedServers, start
from swarmwright.servers.evaluation.module_code import is_in_python, names_of, with_digests
from swarmwright.servers.evaluation.through_broker import BrokerBackend
from swarmwright.servers.rows import ServerUses
from swarmwright.servers.supervision.local_servers import (
    LocalServers,
    automatic_count,
    count_processors,
    find_running,
)
from swarmwright.servers.supervision.process import Limits
from swarmwright.simulations import catalogue
from swarmwright.simulations.user_code.changes import list_files


def is_here(experiment: Experiment, broker: str | None, servers: Servers | None) -> bool:
    """Whether `open_backend` with these arguments uses no broker that others can see."""
    choice = resolve_servers(experiment, servers)
    if broker is not None or choice in BROKERLESS:
        return broker is None
    if choice != "auto" or experiment.broker is not None:
        return False
    return has_python_modules(experiment) or prefers_local(experiment)


def has_workers(simulation: str) -> bool:
    """Whether `servers: local` starts worker processes, as for Python code that they can import."""
    return is_python(simulation) and not simulation.startswith("__main__:")


def prefers_local(experiment: Experiment) -> bool:
    """Whether `servers: auto` means `local`: in a notebook, unless the experiment asks for servers.

    A notebook has no terminal for servers' output, and its cells are run repeatedly.
    """
    needs_servers = experiment.mode != "auto" or not catalogue.is_local(experiment.simulation)
    alone = is_notebook() or experiment.simulation.startswith("__main__:")
    return alone and not needs_servers


def needs_no_servers(experiment: Experiment) -> bool:
    """Whether a few episodes are best evaluated in this process: `servers: auto` and a built-in simulation.

    Servers take longer to start than the engine needs for such episodes on all processors.
    """
    named = experiment.broker is not None or experiment.servers != "auto" or experiment.mode != "auto"
    return not named and catalogue.is_local(experiment.simulation) and not is_python(experiment.simulation)


def require_here(experiment: Experiment) -> None:
    """Raise InputError unless the simulation can run in this process and meets the requirements."""
    simulation = experiment.simulation
    if not catalogue.is_local(simulation):
        field = place_of(experiment, "simulation")
        folder = None if experiment.path is None else experiment.path.parent
        if simulation.endswith(".py"):
            from swarmwright.simulations.near_names import describe_missing_class  # noqa: PLC0415 - only for this message

            raise InputError(f"{field}{describe_missing_class(simulation, folder)}")
        from swarmwright.simulations.near_names import describe_unknown_simulation  # noqa: PLC0415 - as above

        if simulator_file(simulation) is not None:
            raise InputError(f"{field}{describe_unknown_simulation(simulation, folder)}")
        hint = f"simulations such as {', '.join(SIMULATORS)} need a broker with a server that offers them"
        if simulation in SIMULATORS:
            hint = "set `broker` to a broker with a server that offers it"
        raise InputError(f"{field}{describe_unknown_simulation(simulation, folder)}; {hint}")
    if is_command(simulation):
        from swarmwright.experiment import commands  # noqa: PLC0415 - only where there is a command

        problem = commands.find_missing(simulation)
        if problem is not None:
            raise InputError(f"{place_of(experiment, 'simulation')}{problem}")
        warning = commands.find_warning(experiment)
        if warning is not None:
            warn_once(f"{place_of(experiment, 'simulation')}{warning}")
    notice = catalogue.get_notice(simulation, experiment.parameters)
    if notice is not None:
        warn_once(f"{place_of(experiment, 'parameters')}{notice}")
    announced, requirements = catalogue.description(simulation), experiment.requirements
    title, most = announced["title"], announced.get("max_agents")
    if requirements.dimensions != announced["dimensions"]:
        raise InputError(
            f"{place_of(experiment, 'requirements')}{title} has {announced['dimensions']} dimensions, not "
            f"{requirements.dimensions}; leave the key out"
        )
    if most is not None and (requirements.max_agents or 0) > most:
        raise InputError(
            f"{place_of(experiment, 'requirements')}{title} has at most {most} agents, not "
            f"{requirements.max_agents}"
        )


_SESSION = (
    "simulation: {} is defined only in this session, where servers cannot import it; move the class to a "
    "file or set servers: in-process"
)


@contextmanager
def open_backend(
    experiment: Experiment,
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    visual: bool = False,
    wait: float | None = None,
    most: int | None = None,
    metrics: Sequence[str] = (),
    controller: Mapping[str, Any] | None = None,
    earlier: ServerUses = MappingProxyType({}),
) -> Iterator[Backend]:
    """Start an experiment's servers and yield its backend; stop them afterwards.

    Args:
        experiment: names simulation, parameters, broker, servers.
        broker: use the servers on this broker, instead of the experiment's.
        servers: as the experiment's key. With a number and a broker, servers are started on that broker.
            "auto" in a notebook means "local".
        visual: ask the server to draw.
        wait: seconds to wait for a broker that does not answer, instead of the experiment's.
        most: number of evaluations, if known; limits the worker processes of `local`.
        metrics: names of metrics to return, besides those that the fitness needs.
        controller: specification of the controllers, if they are not the experiment's.
        earlier: use of launchers' servers in earlier sessions of the run, which counts for their budgets.

    Raises:
        InputError: the simulation is unknown, or both a broker and local servers are requested.
        RunError: no broker, no matching server, or a server that does not start.
    """
    _check(broker, servers)
    choice = resolve_servers(experiment, servers)
    if broker is None and servers not in BROKERLESS and choice not in BROKERLESS:
        broker = experiment.broker
    machines = _machines(experiment, controller)
    if machines is not None:
        _require_offloaded(experiment, visual=visual)
        if broker is None and choice in ("auto", *BROKERLESS):
            require_here(experiment)
            yield _make_in_process_backend(experiment, metrics, in_python=True)
            return
    if broker is None and choice == "auto" and not visual and prefers_local(experiment):
        choice = "local"
    if broker is None and choice in BROKERLESS and not visual:
        require_here(experiment)
        if choice == "in-process" or not has_workers(experiment.simulation):
            yield _make_in_process_backend(experiment, metrics)
            return
    experiment = with_environment(experiment)
    with ExitStack() as stack:
        local: StartedServers | None
        account: tuple[str, str, str] | None = None
        if isinstance(choice, tuple):
            local = launched = open_launched(
                stack, experiment, broker, choice, visual=visual, earlier=earlier, machines=machines
            )
            address, account = launched.access.address, launched.access.account
        else:
            address, local = open_servers(
                stack,
                experiment,
                broker,
                choice,
                started=servers,
                visual=visual,
                most=most,
                modules=[] if machines is None else names_of([machines]),
            )
        patience = experiment.timeouts.connect if wait is None else wait
        with engine_errors():
            pool = connect_with_retries(
                # A command draws by itself, without steps through the broker.
                lambda: _pool(
                    experiment,
                    address,
                    visual=visual and not is_command(experiment.simulation),
                    alone=broker is None,
                    metrics=metrics_of(fitness_expression(experiment), metrics),
                    machines=machines,
                    account=account,
                ),
                patience,
                logging.getLogger("swarmwright").warning,
            )
        stack.callback(pool.close)
        local = local or find_running(address)
        if local is not None:
            local.attach(pool)
            stack.callback(local.detach)
        servers_text = "servers" if local is None else f"{local.count} server{'s' if local.count > 1 else ''}"
        description = f"{servers_text} on {address}"
        if isinstance(local, LaunchedServers):
            description = f"servers on {address}: {local.description}"
        if choice == "local" and local is not None:
            description = f"{local.count} worker process{'es' if local.count > 1 else ''}"
        yield BrokerBackend(experiment, pool, local, description, metrics)


def _check(broker: str | None, servers: Servers | None) -> None:
    """Raise InputError or RunError for arguments that no experiment can use."""
    loading = sys.modules.get("swarmwright.simulations.loading")
    if loading is not None and loading.serving:
        raise RunError(
            "the file starts a run while a simulation server imports its class; move the start of the run "
            'under `if __name__ == "__main__":`'
        )
    if broker is not None:
        problem = broker_problem(broker)
        if problem is not None:
            raise InputError(f"broker: {problem}")
    if isinstance(servers, int) and servers < 1:
        raise InputError(f"servers: must be auto, local, in-process or a number of at least 1, not {servers}")
    if servers in BROKERLESS and broker is not None:
        raise InputError(f"broker: cannot be combined with servers: {servers}; leave one of them out")


@contextmanager
def open_once(
    experiment: Experiment, broker: str | None, servers: Servers | None, *, most: int
) -> Iterator[tuple[str | None, Servers | None]]:
    """Start servers once for experiments that differ only in parameters and run one after another.

    Args:
        experiment: one of them.
        broker: as in `open_backend`.
        servers: likewise.
        most: evaluations of each experiment.

    Yields:
        Broker and servers to pass to `open_backend`; unchanged if nothing was started.
    """
    choice = resolve_servers(experiment, servers)
    in_process = choice in BROKERLESS and (choice == "in-process" or not has_workers(experiment.simulation))
    outside = broker is not None or (experiment.broker is not None and choice not in BROKERLESS)
    if in_process or outside or isinstance(choice, tuple) or has_python_modules(experiment):
        yield broker, servers
        return
    if choice == "auto" and prefers_local(experiment):
        yield broker, "local"
        return
    with ExitStack() as stack:
        address, _ = open_servers(stack, experiment, None, choice, started=servers, most=most)
        yield address, None


def open_servers(
    stack: ExitStack,
    experiment: Experiment,
    broker: str | None,
    choice: ServerChoice,
    *,
    started: Servers | None,
    visual: bool = False,
    most: int | None = None,
    modules: Sequence[str] = (),
) -> tuple[str, LocalServers | None]:
    """Start the embedded broker and servers as far as they are needed; they end with the stack.

    Args:
        stack: ends the broker and servers.
        experiment: names the simulation.
        broker: address of an external broker; servers are started on it if `started` is a number.
        choice: the resolved number of servers.
        started: `servers` as the caller passed it.
        visual: let the servers draw.
        most: as in `open_backend`.
        modules: names of the Python behaviours and conditions that the servers offer.

    Returns:
        The broker's address, and the servers or None.
    """
    experiment = with_environment(experiment)
    if broker is None:
        check_environment()
    else:
        prepare(broker)
    if broker is not None and not isinstance(started, int):
        return broker, None
    require_here(experiment)
    if experiment.simulation.startswith("__main__:"):
        raise InputError(_SESSION.format(experiment.label))
    count = choice if isinstance(choice, int) else 1 if visual else automatic_count()
    if choice == "local" and not visual:
        count = min(count_processors(), most or count_processors())
    variables = experiment.timeouts.variables()
    if broker is None:
        address, account = start_private(stack)
        variables.update(account.variables)
        first = 1
    else:
        # Random ids, as other servers may be on this broker.
        address, first = broker, 1 + secrets.randbelow(2**31 - 1 - count)
    files = list_files(experiment.simulation) if is_python(experiment.simulation) else {}
    settings = [
        {
            "simulation": experiment.simulation,
            "files": files,
            "modules": list(modules),
            "broker": address,
            "id": first + index,
            "prefix": experiment.prefix,
            "step_timeout": experiment.timeouts.step,
            "alone": broker is None,
            "visual": visual,
        }
        for index in range(count)
    ]
    servers = LocalServers(
        settings,
        visual=visual,
        limits=Limits.from_timeouts(experiment.timeouts),
        environment=variables,
    )
    return address, stack.enter_context(servers)


def open_launched(
    stack: ExitStack,
    experiment: Experiment,
    broker: str | None,
    entries: Entries,
    *,
    visual: bool = False,
    earlier: ServerUses = MappingProxyType({}),
    machines: Mapping[str, Any] | None = None,
) -> LaunchedServers:
    """Start the servers of launchers, and the embedded broker without another; they end with the stack.

    Raises InputError and RunError, see `launched.start`.
    """
    require_here(experiment)
    if visual:
        raise InputError("visual: servers of launchers cannot draw; leave it out or set servers: 1")
    if experiment.simulation.startswith("__main__:"):
        raise InputError(_SESSION.format(experiment.label))
    return start(stack, experiment, entries, broker, earlier, machines)


def _pool(
    experiment: Experiment,
    address: str,
    *,
    visual: bool,
    alone: bool,
    metrics: tuple[str, ...],
    machines: Mapping[str, Any] | None,
    account: tuple[str, str, str] | None,
) -> _engine.Pool:
    return _engine.Pool(
        address,
        simulation=catalogue.title(experiment.simulation),
        parameters=experiment.parameters,
        requirements=cast("Requirements", experiment.requirements.model_dump(exclude_none=True)),
        sensors=experiment.sensors,
        actuators=experiment.actuators,
        prefix=experiment.prefix,
        tool="swarmwright",  # the engine adds host and process
        mode=experiment.mode,
        metrics=metrics,
        visual=visual,
        timeouts=experiment.timeouts.model_dump(),
        faults=experiment.faults.to_engine_values(),
        alone=alone,
        controller=None if machines is None else with_digests(machines),
        account=account,
    )


def _machines(experiment: Experiment, controller: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
    """Return the specification of machines with Python modules; None for other controllers."""
    if controller is not None and is_in_python(controller):
        return controller
    if not has_python_modules(experiment):
        return None
    return experiment.representation(SENSORS, ACTUATORS).architecture()


def modules_of(experiments: Iterable[Experiment]) -> list[str]:
    """Return the names of all Python behaviours and conditions that experiments use."""
    machines = (_machines(experiment, None) for experiment in experiments)
    return names_of(machine for machine in machines if machine is not None)


def _require_offloaded(experiment: Experiment, *, visual: bool) -> None:
    """Raise InputError if machines with Python modules would be stepped through the broker."""
    reason = "behaviours and conditions in Python run in this process or on a server that has their code"
    if visual:
        raise InputError(f"visual: {reason}, without drawing; watch a run with `swarmwright replay`")
    if experiment.mode not in {"auto", "offloaded"}:
        raise InputError(
            f"{place_of(experiment, 'mode')}{experiment.mode} is not possible: {reason}; use auto or "
            "offloaded"
        )


def _make_in_process_backend(
    experiment: Experiment, metrics: Sequence[str], *, in_python: bool = False
) -> Backend:
    from swarmwright.servers.evaluation.in_process import InProcessBackend, PythonBackend  # noqa: PLC0415 - NumPy and hosts, not for servers

    if in_python:
        from swarmwright.servers.evaluation.python_modules import ModulesBackend  # noqa: PLC0415 - as above

        return ModulesBackend(experiment, metrics)
    return (PythonBackend if is_python(experiment.simulation) else InProcessBackend)(experiment, metrics)
