"""`swarmwright export-fmu`: a simulation as a Functional Mock-up Unit."""

import re
from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import json_option, set_option
from swarmwright.cli._output import Output, show_warnings


@click.command(
    "export-fmu",
    cls=Command,
    example="swarmwright export-fmu minisim --fmi 3 --output minisim.fmu\n"
    "swarmwright export-fmu arena --set parameters.mission=aac --set parameters.robots=5 --output arena.fmu",
)
@click.argument("simulation", metavar="SIMULATION")
@click.option(
    "--fmi",
    type=click.Choice(["2", "3"]),
    default="2",
    show_default=True,
    help="Version of the Functional Mock-up Interface: 2.0 or 3.0.",
)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The file to write. Default: SIMULATION.fmu, here.",
)
@set_option("Set a parameter of the simulation: parameters.numAgents=3.")
@click.option("--force", is_flag=True, help="Write over a file that Swarmwright did not export.")
@json_option
def command(
    simulation: str, fmi: str, output: Path | None, settings: tuple[str, ...], force: bool, as_json: bool
) -> None:
    """Export SIMULATION as an FMU for co-simulation, with the engine inside.

    SIMULATION is a built-in simulation (minisim, emergency_exit, arena) or an experiment file, whose
    simulation and parameters are taken. Parameters are parameters of the FMU, actuators inputs, sensors,
    fitness and metrics outputs. How many agents there are is decided by the parameters at the export.
    """
    from swarmwright import Experiment
    from swarmwright.core.errors import InputError
    from swarmwright.export.simulation_fmu import simulation_fmu
    from swarmwright.export.writing import write
    from swarmwright.simulations.catalogue import parameter_names, titles

    said = Output(as_json=as_json)
    show_warnings()
    if simulation in titles():
        for setting in settings:
            if setting.partition("=")[0].partition(".")[0] in parameter_names(simulation):
                raise InputError(
                    f"--set {setting}: is a parameter of {simulation}; write --set parameters.{setting}"
                )
        experiment = Experiment.from_mapping({"simulation": simulation}).with_settings(settings)
    elif Path(simulation).is_file():
        experiment = Experiment.load(simulation, settings)
    else:
        known = ", ".join(titles())
        raise InputError(
            f"{simulation}: is no built-in simulation ({known}), and there is no experiment file of this name"
        )
    file = output or Path(f"{Path(simulation).stem}.fmu")
    if file.is_dir():
        raise InputError(f"{file}: is a folder; name a file with --output")
    name = re.sub(r"\W", "_", file.stem, flags=re.ASCII)
    name = name if name[:1].isalpha() else f"model_{name}"
    data = simulation_fmu(experiment.simulation, experiment.parameters, fmi=f"{fmi}.0", name=name)
    write({file.name: data}, file.parent, force=force)
    said.text(f"{file}: {experiment.simulation}, FMI {fmi}.0")
    said.json({"file": str(file), "simulation": experiment.simulation, "fmi": f"{fmi}.0"})
