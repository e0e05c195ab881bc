"""Starting what an experiment is evaluated with: nothing, worker processes, or servers and a broker."""

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
from swarmwright.common.simulation_names import is_command, is_python
from swarmwright.controllers.modules.grammar import ACTUATORS, SENSORS
from swarmwright.experiment.broker_address import broker_problem
from swarmwright.experiment.derived import fitness_expression, has_python_modules, place_of, with_environment
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.launcher_entries import Entries
from swarmwright.servers.broker.credentials import check_environment, prepare
from swarmwright.servers.broker.private import start_private
from swarmwright.servers.broker.waiting import connect_with_retries
from swarmwright.servers.evaluation.base import (
    HERE,
    Backend,
    Chosen,
    Servers,
    StartedServers,
    chosen,
    metrics_of,
)
from swarmwright.servers.evaluation.here import has_workers, in_process_is_better, require_here
from swarmwright.servers.evaluation.launched import LaunchedServers, start
from swarmwright.servers.evaluation.module_code import is_in_python, names_of, with_digests
from swarmwright.servers.evaluation.through_broker import BrokerBackend
from swarmwright.servers.server_use import ServerUses
from swarmwright.servers.supervision.local_servers import (
    LocalServers,
    automatic_count,
    processors,
    running_on,
)
from swarmwright.servers.supervision.place import Limits
from swarmwright.simulations import catalogue
from swarmwright.simulations.user_code.changes import list_files

_SESSION = (
    "simulation: {} is defined in this session alone, where no server finds it; write the class to a file, "
    "or evaluate with servers: in-process"
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
    """Start what an experiment needs and yield the backend; end all of it afterwards.

    Args:
        experiment: names simulation, parameters, broker, servers.
        broker: use the servers on this broker, whatever the experiment says.
        servers: as the experiment's key. A number given here together with a broker is started on that
            broker. "auto" in a notebook means "local".
        visual: ask the server to draw.
        wait: seconds to wait for a broker that does not answer, instead of the experiment's.
        most: evaluations that there are, if that is known: no more worker processes are started for `local`.
        metrics: asked for beside those that the fitness needs.
        controller: specification of the controllers, where they are not the experiment's.
        earlier: use of launchers' servers in earlier sessions of the run, which counts for their budgets.

    Raises:
        InputError: the simulation is unknown, or broker and local servers are both asked for.
        RunError: no broker, no fitting server, a server that does not start.
    """
    _check(broker, servers)
    wanted = chosen(experiment, servers)
    if broker is None and servers not in HERE and wanted not in HERE:
        broker = experiment.broker
    machines = _machines(experiment, controller)
    if machines is not None:
        _require_offloaded(experiment, visual=visual)
        if broker is None and wanted in ("auto", *HERE):
            require_here(experiment)
            yield _in_process(experiment, metrics, in_python=True)
            return
    if broker is None and wanted == "auto" and not visual and in_process_is_better(experiment):
        wanted = "local"
    if broker is None and wanted in HERE and not visual:
        require_here(experiment)
        if wanted == "in-process" or not has_workers(experiment.simulation):
            yield _in_process(experiment, metrics)
            return
    experiment = with_environment(experiment)
    with ExitStack() as stack:
        local: StartedServers | None
        account: tuple[str, str, str] | None = None
        if isinstance(wanted, tuple):
            local = launched = open_launched(
                stack, experiment, broker, wanted, visual=visual, earlier=earlier, machines=machines
            )
            address, account = launched.access.address, launched.access.account
        else:
            address, local = open_servers(
                stack,
                experiment,
                broker,
                wanted,
                started=servers,
                visual=visual,
                most=most,
                modules=[] if machines is None else names_of([machines]),
            )
        patience = experiment.timeouts.connect if wait is None else wait
        with engine_errors():
            pool = connect_with_retries(
                # A command shows itself, in one piece: no step of it crosses the broker.
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
        local = local or running_on(address)
        if local is not None:
            local.attach(pool)
            stack.callback(local.detach)
        many = "servers" if local is None else f"{local.count} server{'s' if local.count > 1 else ''}"
        where = f"{many} on {address}"
        if isinstance(local, LaunchedServers):
            where = f"servers on {address}: {local.where}"
        if wanted == "local" and local is not None:
            where = f"{local.count} worker process{'es' if local.count > 1 else ''}"
        yield BrokerBackend(experiment, pool, local, where, metrics)


def _check(broker: str | None, servers: Servers | None) -> None:
    """Raise where nothing can be opened, whatever the experiment."""
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


@contextmanager
def open_once(
    experiment: Experiment, broker: str | None, servers: Servers | None, *, most: int
) -> Iterator[tuple[str | None, Servers | None]]:
    """Start the servers for experiments that differ in parameters alone and are evaluated one after another.

    Args:
        experiment: one of them.
        broker: as in `open_backend`.
        servers: likewise.
        most: evaluations that each of them has.

    Yields:
        Broker and servers to call `open_backend` with; those that were given where nothing was started:
        none are needed, or they are those of another broker or of a launcher.
    """
    wanted = chosen(experiment, servers)
    here = wanted in HERE and (wanted == "in-process" or not has_workers(experiment.simulation))
    outside = broker is not None or (experiment.broker is not None and wanted not in HERE)
    if here or outside or isinstance(wanted, tuple) or has_python_modules(experiment):
        yield broker, servers
        return
    if wanted == "auto" and in_process_is_better(experiment):
        yield broker, "local"
        return
    with ExitStack() as stack:
        address, _ = open_servers(stack, experiment, None, wanted, started=servers, most=most)
        yield address, None


def open_servers(
    stack: ExitStack,
    experiment: Experiment,
    broker: str | None,
    wanted: Chosen,
    *,
    started: Servers | None,
    visual: bool = False,
    most: int | None = None,
    modules: Sequence[str] = (),
) -> tuple[str, LocalServers | None]:
    """Start the embedded broker and servers as far as they are needed; they end with the stack.

    Args:
        stack: ends what is started.
        experiment: whose simulation the servers offer.
        broker: an external one; servers are started on it when `started` is a number.
        wanted: how many servers.
        started: what the caller asked for, instead of the experiment.
        visual: let the servers draw.
        most: as in `open_backend`.
        modules: names of the behaviours and conditions in Python that the servers have.

    Returns:
        The broker's address, and the servers; None when none were started.
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
    count = wanted if isinstance(wanted, int) else 1 if visual else automatic_count()
    if wanted == "local" and not visual:
        count = min(processors(), most or processors())
    variables = experiment.timeouts.variables()
    if broker is None:
        address, account = start_private(stack)
        variables.update(account.variables)
        first = 1
    else:
        # Others may have servers on this broker; ids must differ.
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
        limits=Limits.of(experiment.timeouts),
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
    """Start the servers of launchers, and the embedded broker if there is no other; they end with the stack.

    Raises InputError and RunError, see `launched.start`.
    """
    require_here(experiment)
    if visual:
        raise InputError("visual: servers of launchers draw nowhere; leave it out, or take servers: 1")
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
        tool="swarmwright",  # host and process are added
        mode=experiment.mode,
        metrics=metrics,
        visual=visual,
        timeouts=experiment.timeouts.model_dump(),
        faults=experiment.faults.for_engine(),
        alone=alone,
        controller=None if machines is None else with_digests(machines),
        account=account,
    )


def _machines(experiment: Experiment, controller: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
    """Return the specification of machines with modules in Python; None for other controllers."""
    if controller is not None and is_in_python(controller):
        return controller
    if not has_python_modules(experiment):
        return None
    return experiment.representation(SENSORS, ACTUATORS).architecture()


def modules_of(experiments: Iterable[Experiment]) -> list[str]:
    """Return the names of all behaviours and conditions in Python that servers need for experiments."""
    machines = (_machines(experiment, None) for experiment in experiments)
    return names_of(machine for machine in machines if machine is not None)


def _require_offloaded(experiment: Experiment, *, visual: bool) -> None:
    """Raise InputError where machines with modules in Python would have to be stepped through the broker."""
    reason = (
        "behaviours and conditions in Python are evaluated where their code is, in this process or on a "
        "server that has it"
    )
    if visual:
        raise InputError(f"visual: {reason}, and not shown there; `swarmwright replay` shows a run's")
    if experiment.mode not in {"auto", "offloaded"}:
        raise InputError(
            f"{place_of(experiment, 'mode')}{experiment.mode}: {reason}: leave it out, or take offloaded"
        )


def _in_process(experiment: Experiment, metrics: Sequence[str], *, in_python: bool = False) -> Backend:
    from swarmwright.servers.evaluation.in_process import InProcessBackend, PythonBackend  # noqa: PLC0415 - NumPy and hosts, not for servers

    if in_python:
        from swarmwright.servers.evaluation.python_modules import ModulesBackend  # noqa: PLC0415 - as above

        return ModulesBackend(experiment, metrics)
    return (PythonBackend if is_python(experiment.simulation) else InProcessBackend)(experiment, metrics)
