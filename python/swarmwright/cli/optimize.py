"""`swarmwright optimize`: evolve a controller."""

import shlex
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import (
    ExistingPath,
    ServerCount,
    Servers,
    broker_option,
    experiment_broker,
    json_option,
)
from swarmwright.cli._output import Output, show_warnings
from swarmwright.cli._progress import duration, progress
from swarmwright.cli._signals import INTERRUPTED, check

if TYPE_CHECKING:
    from swarmwright import Generation, Run
    from swarmwright.cli._progress import Progress

FILES = {
    "best.json": "the best controller",
    "fitness.png": "fitness over generations, a plot",
    "generations.csv": "fitness over generations, a table",
    "record.csv": "every evaluation",
    "journal.jsonl": "which server did what, when",
    "experiment.yaml": "the experiment with every default written out",
}


@click.command(
    "optimize", cls=Command, example="swarmwright optimize experiments/minisim.yaml --seed 7 --servers 2"
)
@click.argument("file", type=ExistingPath(), metavar="FILE")
@broker_option(default=None, text="Use the servers on this broker. Default: start a broker and servers here.")
@click.option("--seed", type=click.IntRange(min=0), metavar="S", help="Seed of the run. Default: the file's.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder for the results. Default: a new one in runs/.",
)
@click.option(
    "--servers",
    type=ServerCount(),
    metavar="K",
    help="Servers to start; 'local' evaluates in this process, without broker.",
)
@json_option
def command(
    file: Path,
    broker: str | None,
    seed: int | None,
    out: Path | None,
    servers: Servers | None,
    as_json: bool,
) -> int:
    """Evolve a controller as the experiment FILE says.

    Ctrl-C ends it early and keeps the results so far.
    """
    from swarmwright import Experiment, optimize

    output = Output(as_json=as_json)
    show_warnings()
    experiment = Experiment.load(file)
    wanted = servers if servers is not None else experiment.servers
    broker = experiment_broker(broker, experiment.broker, wanted)
    reader = Reader()
    with progress(output, experiment.method.generations) as shown:
        run = optimize(
            experiment,
            on_generation=lambda generation: reader.show(shown, generation),
            on_progress=shown.evaluating,
            broker=broker,
            servers=servers,
            seed=seed,
            out=out,
        )
    if not reader.gone:
        _conclude(output, run)
    return INTERRUPTED if run.interrupted or reader.gone else 0


class Reader:
    """Whoever reads the output; once gone (`| head`), the run ends with its results kept."""

    def __init__(self) -> None:
        self.gone = False

    def show(self, progress: "Progress", generation: "Generation") -> bool:
        """Show a generation; whether to go on."""
        check()
        try:
            progress.generation(generation)
        except BrokenPipeError:
            self.gone = True
        return not self.gone


def _conclude(output: Output, run: "Run") -> None:
    """Say what came out, where everything is, and what to do next."""
    from swarmwright import _engine

    if not run.generations:
        output.text(
            f"Interrupted before the first generation was evaluated; {run.path} holds the experiment."
        )
        return
    best = run.best
    output.json(
        {
            "best": {"fitness": best.fitness, "candidate": best.candidate, "generation": best.generation},
            "evaluations": run.evaluations,
            "generations": run.generations,
            "seconds": run.seconds,
            "run": str(run.path),
        }
    )
    if run.interrupted:
        output.text("Interrupted; the results so far are kept.")
    rate = run.evaluations / max(run.seconds, 1e-3)
    whose = f"generation {best.generation}, candidate {best.candidate}, both from 0"
    output.text(f"Best fitness {best.fitness + 0.0:.6g} ({whose}).")
    output.text(f"{run.evaluations} evaluations in {duration(run.seconds)} ({rate:.0f} a second).")
    output.text()
    output.text(f"Everything is in {run.path}:")
    for name, meaning in FILES.items():
        if (run.path / name).exists():
            output.text(f"  {name:<16} {meaning}")
    output.text()
    output.text("See the best controller at work:")
    program, folder = _program(), shlex.quote(str(run.path))
    if run.experiment.simulation in _engine.simulations():
        output.text(f"  {program} replay {folder}")
        output.text(f"  {program} replay {folder} --save best.gif")
    else:
        file = shlex.quote(str(run.path / "experiment.yaml"))
        output.text(f"  {program} simulate {file} --controller {folder} --visual")


def _program() -> str:
    """How this program is called from where the person is."""
    if shutil.which("swarmwright"):
        return "swarmwright"
    own = Path(sys.argv[0])
    if own.name != "swarmwright":
        return f"{shlex.quote(sys.executable)} -m swarmwright"
    return shlex.quote(str(own.relative_to(Path.cwd()) if own.is_relative_to(Path.cwd()) else own))
