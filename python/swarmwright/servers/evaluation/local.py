"""Checks whether an experiment is evaluated in this process, and whether its simulation can run in it."""

from swarmwright.common.errors import InputError
from swarmwright.common.html import is_notebook
from swarmwright.common.simulation_names import SIMULATORS, is_command, is_python, simulator_file
from swarmwright.common.warn_once import warn_once
from swarmwright.experiment.derived import has_python_modules, place_of
from swarmwright.experiment.experiment import Experiment
from swarmwright.servers.evaluation.base import (
    BROKERLESS,
    Servers,
    resolve_servers,
)
from swarmwright.simulations import catalogue


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
