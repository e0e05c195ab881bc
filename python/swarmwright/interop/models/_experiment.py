"""From the parts of a model to an experiment, with a comment on where each line comes from."""

import json
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.yaml import parse, without_places
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.importing import Imported
from swarmwright.experiment.start_from import entry_of
from swarmwright.experiment.validation import check
from swarmwright.interop.models._draft import Draft
from swarmwright.interop.models._files import files_of
from swarmwright.interop.models._files import load as load_part
from swarmwright.interop.models._model import Model
from swarmwright.interop.models._names import title_of
from swarmwright.methods import METHODS
from swarmwright.simulations.names import absolute


def load(
    paths: Iterable[str | PathLike[str]],
    *,
    target: str | PathLike[str] | None = None,
    simulation: str | None = None,
    method: str | None = None,
    controller: str | None = None,
) -> Imported:
    """Make an experiment of the files of a model.

    Args:
        paths: the files, or folders with them; each is recognised by what it holds.
        target: the experiment file that will be written; paths in it are relative to its folder.
        simulation: as an experiment names it; default: the one of the problem description.
        method: kind of the method, with its defaults; default: nnga.
        controller: kind of the controller, with its defaults; default: `parameter_set` where the model has
            optimised parameters and agents may steer themselves, else `mealy_fsm` where it has a behaviour,
            which evolution then starts from, else `layered`.

    Raises:
        InputError: a file is of no known kind, or wrong, or two contradict each other; the message names file
            and line of every problem.
    """
    METHODS.check("method", method)
    REPRESENTATIONS.check("controller", controller)
    model = Model.of(_parts(paths))
    folder = Path() if target is None else Path(target).parent
    draft = Draft(model, _simulation(model, simulation), folder, method or "nnga", controller)
    machine = None if draft.behaviour is None or target is None else f"{Path(target).stem}.controller.json"
    text = draft.text(machine)
    # The name says what paths are relative to; there is no such file.
    name = str(folder / "imported.yaml")
    try:
        source = parse(text, name)
        if draft.behaviour is not None:
            source.values["start_from"] = entry_of(draft.behaviour, machine or "behaviour")
        experiment = Experiment(**check(source))
    except InputError as error:
        files = ", ".join(str(part.path) for part in model.parts)
        verb = "does" if len(model.parts) == 1 else "do"
        problems = without_places(str(error), name)
        raise InputError(f"{files}: {verb} not make a valid experiment:\n{problems}") from error
    if draft.behaviour is not None and machine is None:
        raise InputError(
            f"{model.file_of('a behaviour')}: becomes a file beside the experiment; name the experiment: "
            "--output FILE.yaml"
        )
    files_beside = {} if machine is None else {machine: json.dumps(draft.behaviour, indent=2) + "\n"}
    return Imported(text, experiment, tuple(draft.notes), files_beside)


def _parts(paths: Iterable[str | PathLike[str]]) -> list[Any]:
    parts, problems = [], []
    for path in files_of(map(Path, paths)):
        try:
            parts.append(load_part(path))
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise InputError("\n".join(problems))
    return parts


def _simulation(model: Model, named: str | None) -> str:
    """Return the simulation, as experiments name it."""
    if named is not None:
        return absolute(named)
    if not model.titles:
        raise InputError(
            f"{', '.join(str(part.path) for part in model.parts)}: no file names the simulation; add the "
            "problem description (<icomponent>), or name one: --simulation minisim"
        )
    return title_of(model.titles) or model.titles[0]
