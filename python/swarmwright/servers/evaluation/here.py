"""Whether an experiment is evaluated in this process, and whether its simulation can run here."""

from swarmwright.common.errors import InputError
from swarmwright.common.html import in_notebook
from swarmwright.common.simulation_names import SIMULATORS, is_command, is_python, simulator_file
from swarmwright.common.warn_once import warn_once
from swarmwright.experiment.derived import has_python_modules, place_of
from swarmwright.experiment.experiment import Experiment
from swarmwright.servers.evaluation.base import (
    HERE,
    Servers,
    chosen,
)
from swarmwright.simulations import catalogue


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
    asked = experiment.mode != "auto" or not catalogue.is_local(experiment.simulation)
    alone = in_notebook() or experiment.simulation.startswith("__main__:")
    return alone and not asked


def needs_no_servers(experiment: Experiment) -> bool:
    """Whether nothing is gained by servers for a few episodes: `servers: auto`, and the engine computes them.

    Servers take longer to start than such episodes take, which use all processors in this process as well.
    """
    named = experiment.broker is not None or experiment.servers != "auto" or experiment.mode != "auto"
    return not named and catalogue.is_local(experiment.simulation) and not is_python(experiment.simulation)


def require_here(experiment: Experiment) -> None:
    """Raise InputError unless the simulation can run in this process, with the requirements."""
    simulation = experiment.simulation
    if not catalogue.is_local(simulation):
        where = place_of(experiment, "simulation")
        folder = None if experiment.path is None else experiment.path.parent
        if simulation.endswith(".py"):
            from swarmwright.simulations.near_names import describe_missing_class  # noqa: PLC0415 - only for this message

            raise InputError(f"{where}{describe_missing_class(simulation, folder)}")
        from swarmwright.simulations.near_names import describe_unknown_simulation  # noqa: PLC0415 - as above

        if simulator_file(simulation) is not None:
            raise InputError(f"{where}{describe_unknown_simulation(simulation, folder)}")
        hint = f"any other needs a broker on which a server offers it, as {', '.join(SIMULATORS)}"
        if simulation in SIMULATORS:
            hint = "name the broker on which one does"
        raise InputError(f"{where}{describe_unknown_simulation(simulation, folder)}; {hint}")
    if is_command(simulation):
        from swarmwright.experiment import commands  # noqa: PLC0415 - only where there is a command

        problem = commands.missing(simulation)
        if problem is not None:
            raise InputError(f"{place_of(experiment, 'simulation')}{problem}")
        warning = commands.warning_of(experiment)
        if warning is not None:
            warn_once(f"{place_of(experiment, 'simulation')}{warning}")
    notice = catalogue.get_notice(simulation, experiment.parameters)
    if notice is not None:
        warn_once(f"{place_of(experiment, 'parameters')}{notice}")
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
