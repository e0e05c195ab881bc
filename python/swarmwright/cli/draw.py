"""`swarmwright draw`: a controller as a figure."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright import Run


@click.command(
    "draw",
    cls=Command,
    example="swarmwright draw runs/minisim-1\n"
    "swarmwright draw runs/minisim-1 --generation 0 --out beginning.svg\n"
    "swarmwright draw best.json --simulation minisim",
)
@click.argument("source", type=options.ExistingPath(folder=None), metavar="RUN|FILE")
@options.figure_option(
    "--out",
    "File to write: .png, .svg or .pdf. Default: controller.png in the run's folder, or FILE's name "
    "with .png.",
)
@options.candidate_options
@click.option(
    "--simulation",
    metavar="NAME",
    help="Built-in simulation or FILE.py:CLASS that names the sensors and actuators. Default: the run's.",
)
@options.json_option
def command(
    source: Path,
    file: Path | None,
    generation: int | None,
    candidate: int | None,
    simulation: str | None,
    output: Output,
) -> None:
    """Draw a controller: its network or its states.

    The controller is the one in FILE, or the best candidate of RUN. Networks are drawn with their weights,
    state machines with their states.
    """
    from swarmwright import Controller, Run
    from swarmwright.controllers.figures import figure
    from swarmwright.display.figures import style
    from swarmwright.runs.choice import choose

    if source.is_dir():
        target = file or source / "controller.png"
        style.check_figure_path(target)
        run = Run.open(source)
        chosen = choose(run, generation, candidate)
        specification = chosen.specification
        experiment = run.experiment
        drawn = figure(
            specification,
            title=f"{experiment.subject}: candidate {chosen.candidate} of generation {chosen.generation}, "
            f"fitness {chosen.fitness + 0.0:.4g}",
            simulation=_describe(simulation) if simulation else _describe_for_run(run, chosen.generation),
            options=experiment.controller.model_dump(),
        )
    else:
        if generation is not None or candidate is not None:
            raise click.UsageError(f"{source}: is one controller; --generation and --candidate are for runs.")
        target = file or source.with_suffix(".png")
        style.check_figure_path(target)
        specification = Controller.load(source).specification
        drawn = figure(specification, title=source.name, simulation=_describe(simulation))
    style.save(drawn, target)
    output.text(f"The controller is drawn in {target}")
    output.json({"picture": str(target), "kind": specification["kind"]})


def _describe(simulation: str | None, parameters: dict[str, Any] | None = None) -> dict[str, Any] | None:
    """Return the description of a simulation with parameters; None if it is not available here."""
    from swarmwright.simulations import catalogue

    if simulation is None or not catalogue.has_description(simulation):
        return None
    described = catalogue.description(simulation, parameters)
    groups = catalogue.groups(simulation, parameters or {})
    return {**described, "groups": [vars(group) for group in groups]}


def _describe_for_run(run: "Run", generation: int) -> dict[str, Any] | None:
    """Return the description of a run's simulation; None if its code cannot or may not be executed."""
    from swarmwright import InputError
    from swarmwright.common.warn_once import warn_once
    from swarmwright.runs.code import resolve_experiment

    try:
        experiment = resolve_experiment(run, generation)
        return _describe(experiment.simulation, experiment.parameters)
    except InputError as error:
        warn_once(f"sensors and actuators are numbered, since the simulation has no names here: {error}")
        return None
