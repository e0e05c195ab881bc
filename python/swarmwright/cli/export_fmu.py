"""`swarmwright export-fmu`: a simulation as a Functional Mock-up Unit."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._output import Output
from swarmwright.experiment.broker_address import DEFAULT_BROKER, PREFIX_VARIABLE

if TYPE_CHECKING:
    from swarmwright import Experiment


@click.command(
    "export-fmu",
    cls=Command,
    example="swarmwright export-fmu minisim --fmi 3 --output minisim.fmu\n"
    "swarmwright export-fmu arena --set parameters.mission=aac --set parameters.robots=5 --output arena.fmu\n"
    "swarmwright export-fmu minisim --proxy --broker mqtt://localhost --output server.fmu",
)
@click.argument("simulation")
@click.option(
    "--fmi",
    type=click.Choice(["2", "3"]),
    default="2",
    show_default=True,
    help="Version of the Functional Mock-up Interface: 2.0 or 3.0.",
)
@options.target_option("FILE", "File to write. Default: SIMULATION.fmu.")
@click.option(
    "--proxy",
    is_flag=True,
    help="Export an FMU that steps the simulation of a server, found through the broker.",
)
@options.broker_option(
    default=None,
    text="With --proxy: the broker, which masters can change. Default: the experiment's, SWARMWRIGHT_BROKER, "
    f"or {DEFAULT_BROKER}.",
)
@click.option(
    "--prefix",
    type=options.topic_prefix,
    metavar="P",
    help=f"With --proxy: topic prefix. Default: the experiment's, {PREFIX_VARIABLE}, or none.",
)
@click.option(
    "--server",
    type=options.WholeNumber(min=0, max=2**31 - 1),
    metavar="ID",
    help="With --proxy: use only this server. Default: any free server with the simulation.",
)
@click.option(
    "--agents",
    type=options.WholeNumber(min=1),
    help="With --proxy: number of agents that have variables. Default: the simulation's.",
)
@options.set_option("Set a parameter of the simulation: parameters.numAgents=3.")
@options.force_option
@options.json_option
def command(
    simulation: str,
    fmi: str,
    target: Path | None,
    proxy: bool,
    broker: str | None,
    prefix: str | None,
    server: int | None,
    agents: int | None,
    settings: tuple[str, ...],
    force: bool,
    output: Output,
) -> None:
    """Export a simulation as an FMU for co-simulation.

    SIMULATION is a built-in simulation (minisim, emergency_exit, arena) or an experiment file; with --proxy
    also a class, FILE.py:CLASS, or the title of a simulation on a server. The FMU contains the engine; with
    --proxy it uses a server. Actuators are its inputs, sensors, fitness and metrics its outputs, and the
    simulation's parameters its parameters. The number of agents is fixed at export.
    """
    from swarmwright.common.errors import InputError
    from swarmwright.experiment.derived import with_environment
    from swarmwright.export.exporting import write
    from swarmwright.export.simulation_fmu import Address, Model, build_model_fmu, proxy_model
    from swarmwright.simulations.catalogue import title

    for option in ("--broker", "--prefix", "--server", "--agents"):
        options.need(option, "--proxy")
    experiment = _experiment(simulation, settings, proxy=proxy)
    label = title(experiment.simulation)
    file = target or Path(f"{_stem(simulation)}.fmu")
    if file.is_dir():
        raise InputError(f"{file}: is a folder; name a file with --output")
    name = re.sub(r"\W", "_", file.stem, flags=re.ASCII)
    name = name if name[:1].isalpha() else f"model_{name}"
    if proxy:
        address = Address(
            broker or experiment.broker or options.environment_broker() or DEFAULT_BROKER,
            with_environment(experiment).prefix if prefix is None else prefix,
            server,
            experiment.timeouts.discovery,
            experiment.timeouts.step,
        )
        model = proxy_model(experiment, address, agents)
    else:
        model = Model.from_simulation(experiment.simulation, experiment.parameters)
    write({file.name: build_model_fmu(model, fmi=f"{fmi}.0", name=name)}, file.parent, force=force)
    origin = f", by servers on {address.broker}" if proxy else ""
    output.text(f"{file}: {label}, FMI {fmi}.0{origin}")
    about: dict[str, object] = {"file": str(file), "simulation": label, "fmi": f"{fmi}.0"}
    output.json({**about, "broker": address.broker} if proxy else about)


def _experiment(simulation: str, settings: tuple[str, ...], *, proxy: bool) -> "Experiment":
    """Return the experiment of the argument. Raises InputError."""
    from swarmwright import Experiment
    from swarmwright.common.errors import InputError
    from swarmwright.simulations.catalogue import has_description, parameter_names, titles

    if simulation in titles():
        for setting in settings:
            if setting.partition("=")[0].partition(".")[0] in parameter_names(simulation):
                raise InputError(
                    f"--set {setting}: is a parameter of {simulation}; write --set parameters.{setting}"
                )
    elif Path(simulation).is_file():
        return Experiment.load(simulation, settings)
    else:
        builtin = ", ".join(titles())
        is_file = Path(simulation).suffix in (".yaml", ".yml", ".fmu", ".ssp", ".py")
        if is_file or not proxy:
            hint = "; a class is named FILE.py:CLASS" if proxy else ""
            raise InputError(
                f"{simulation}: is neither a built-in simulation ({builtin}) nor an experiment file{hint}"
            )
        if not has_description(simulation) and not any(
            assignment.startswith("requirements") for assignment in settings
        ):
            # Offers of other servers are unknown.
            settings = ("requirements.dimensions=2", *settings)
    return Experiment.from_mapping({"simulation": simulation}, settings)


def _stem(simulation: str) -> str:
    """Return the name of the file for a simulation, an experiment file or FILE.py:CLASS."""
    return re.sub(r"\W", "_", simulation.rpartition(":")[2]) if ":" in simulation else Path(simulation).stem
