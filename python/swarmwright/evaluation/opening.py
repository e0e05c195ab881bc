"""Starting what an experiment is evaluated with: nothing, worker processes, or servers and a broker."""

import logging
import secrets
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from types import MappingProxyType
from typing import Any, cast

from swarmwright import _engine
from swarmwright.broker.address import broker_problem
from swarmwright.broker.credentials import check_environment, prepare
from swarmwright.broker.waiting import connect_with_retries
from swarmwright.core.engine_types import Faults, Requirements, Timeouts
from swarmwright.core.errors import InputError, RunError, engine_errors
from swarmwright.core.modules import ACTUATORS, SENSORS
from swarmwright.core.notebook import in_notebook
from swarmwright.core.open_files import allow_more_open_files
from swarmwright.core.server_use import ServerUses
from swarmwright.core.simulation_names import LIBRARIES, is_command, is_python
from swarmwright.core.suggestions import did_you_mean, unknown
from swarmwright.core.warn_once import warn_once
from swarmwright.evaluation.base import (
    HERE,
    Backend,
    Chosen,
    Servers,
    StartedServers,
    chosen,
    metrics_of,
)
from swarmwright.evaluation.launched import LaunchedServers, start
from swarmwright.evaluation.module_code import is_in_python, names_of, with_digests
from swarmwright.evaluation.through_broker import BrokerBackend
from swarmwright.experiment.derived import fitness_expression, has_python_modules, place_of, with_environment
from swarmwright.experiment.experiment import Experiment
from swarmwright.launchers.entries import Entries
from swarmwright.simulations import catalogue
from swarmwright.supervision.local_servers import LocalServers, automatic_count, processors, running_on
from swarmwright.supervision.supervisor import START_S
from swarmwright.user_code.changes import files_of

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


def is_here(experiment: Experiment, broker: str | None, servers: Servers | None) -> bool:
    """Whether `open_backend` with these arguments uses no broker that is visible to others."""
    wanted = chosen(experiment, servers)
    if broker is not None or wanted in HERE:
        return broker is None
    if wanted != "auto" or experiment.broker is not None:
        return False
    return has_python_modules(experiment) or in_process_is_better(experiment)


def has_workers(simulation: str) -> bool:
    """Whether `servers: local` means processes of their own: for code in Python that others find, too."""
    return is_python(simulation) and not simulation.startswith("__main__:")


def in_process_is_better(experiment: Experiment) -> bool:
    """Whether `servers: auto` means `local`: in a notebook, unless the experiment asks for servers.

    A notebook has no terminal for servers' output, and its cells are run repeatedly.
    """
    asked = experiment.mode != "auto" or not catalogue.is_here(experiment.simulation)
    alone = in_notebook() or experiment.simulation.startswith("__main__:")
    return alone and not asked


def needs_no_servers(experiment: Experiment) -> bool:
    """Whether nothing is gained by servers for a few episodes: `servers: auto`, and the engine computes them.

    Servers take longer to start than such episodes take, which use all processors in this process as well.
    """
    named = experiment.broker is not None or experiment.servers != "auto" or experiment.mode != "auto"
    return not named and catalogue.is_here(experiment.simulation) and not is_python(experiment.simulation)


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
    if broker is None:
        allow_more_open_files()
        with engine_errors():
            embedded = _engine.Broker()
        stack.callback(embedded.stop)
        address, first = embedded.url, 1
    else:
        # Others may have servers on this broker; ids must differ.
        address, first = broker, 1 + secrets.randbelow(2**31 - 1 - count)
    files = files_of(experiment.simulation) if is_python(experiment.simulation) else {}
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
        episode_timeout=experiment.timeouts.episode,
        start_timeout=max(START_S, experiment.timeouts.discovery),
        environment=experiment.timeouts.variables(),
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
        timeouts=cast("Timeouts", experiment.timeouts.model_dump()),
        faults=cast("Faults", experiment.faults.model_dump()),
        alone=alone,
        controller=None if machines is None else with_digests(machines),
        account=account,
    )


def require_here(experiment: Experiment) -> None:
    """Raise InputError unless the simulation can run in this process, with the requirements."""
    simulation = experiment.simulation
    if not catalogue.is_here(simulation):
        where = place_of(experiment, "simulation")
        if simulation.endswith(".py"):
            from swarmwright.simulations.file_names import class_missing  # noqa: PLC0415 - only for this message

            folder = None if experiment.path is None else experiment.path.parent
            raise InputError(f"{where}{class_missing(simulation, folder)}")
        library, _, rest = simulation.partition(":")
        hint = "any other needs a broker on which a server offers it"
        if rest and did_you_mean(library, LIBRARIES):
            hint = f"environments of other libraries are named {', '.join(f'{one}:..' for one in LIBRARIES)}"
        raise InputError(f"{where}{unknown('simulation', simulation, catalogue.titles())}; {hint}")
    if is_command(simulation):
        from swarmwright.experiment import commands  # noqa: PLC0415 - only where there is a command

        problem = commands.missing(simulation)
        if problem is not None:
            raise InputError(f"{place_of(experiment, 'simulation')}{problem}")
        warning = commands.warning_of(experiment)
        if warning is not None:
            warn_once(f"{place_of(experiment, 'simulation')}{warning}")
    announced, wanted = catalogue.description(simulation), experiment.requirements
    title, most = announced["title"], announced.get("max_agents")
    if wanted.dimensions != announced["dimensions"]:
        raise InputError(
            f"{place_of(experiment, 'requirements')}{title} has {announced['dimensions']} dimensions, not "
            f"{wanted.dimensions}; leave the key out"
        )
    if most is not None and (wanted.max_agents or 0) > most:
        raise InputError(
            f"{place_of(experiment, 'requirements')}{title} has at most {most} agents, not "
            f"{wanted.max_agents}"
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
    machines = (_machines(one, None) for one in experiments)
    return names_of(one for one in machines if one is not None)


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
    from swarmwright.evaluation.in_process import InProcessBackend, PythonBackend  # noqa: PLC0415 - NumPy and hosts, not for servers

    if in_python:
        from swarmwright.evaluation.python_modules import ModulesBackend  # noqa: PLC0415 - as above

        return ModulesBackend(experiment, metrics)
    return (PythonBackend if is_python(experiment.simulation) else InProcessBackend)(experiment, metrics)
