"""From the parts of a model to an experiment, with a comment on where each line comes from."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmwright.core.errors import InputError
from swarmwright.core.registry import Registry
from swarmwright.core.untrusted import one_line
from swarmwright.core.yaml import dump, parse
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.validation import check
from swarmwright.methods import METHODS
from swarmwright.models._files import files_of
from swarmwright.models._files import load as load_part
from swarmwright.models._model import Model
from swarmwright.models._names import Known, title_of
from swarmwright.models._parameters import Parameters
from swarmwright.representations import REPRESENTATIONS
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import absolute, relative_name

_STEERING = ("steering", "rule")
"""The parameter of Minisim, and its value with which agents steer themselves."""


@dataclass(frozen=True)
class Imported:
    """An experiment made of a model.

    yaml: the commented experiment file. experiment: the same, loaded. notes: what could not be taken over as
    it was, a sentence each. files: what is written beside the experiment, text by name.
    """

    yaml: str
    experiment: Experiment
    notes: tuple[str, ...]
    files: dict[str, str] = field(default_factory=dict)


def load(
    paths: Iterable[str | Path],
    *,
    target: str | Path | None = None,
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
            optimised parameters that the simulation takes, else `layered`.

    Raises:
        InputError: a file is of no known kind, or wrong, or two contradict each other; the message names file
            and line of every problem.
    """
    for option, kind, registry in (("method", method, METHODS), ("controller", controller, REPRESENTATIONS)):
        _check_kind(option, kind, registry)
    model = Model.of(_parts(paths))
    folder = Path() if target is None else Path(target).parent
    named = _simulation(model, simulation)
    text, notes = _written(model, named, folder, method or "nnga", controller)
    try:
        experiment = Experiment(**check(parse(text, str(folder / "imported.yaml"))))
    except InputError as error:
        files = ", ".join(str(part.path) for part in model.parts)
        raise InputError(f"{files}: do not make a valid experiment:\n{error}") from error
    return Imported(text, experiment, tuple(notes))


def _parts(paths: Iterable[str | Path]) -> list[Any]:
    parts, problems = [], []
    for path in files_of(map(Path, paths)):
        try:
            parts.append(load_part(path))
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise InputError("\n".join(problems))
    return parts


def _check_kind(option: str, kind: str | None, registry: Registry[Any]) -> None:
    """Raise InputError when there is no such kind."""
    if kind is None:
        return
    try:
        registry.get(kind)
    except InputError as error:
        raise InputError(f"{option}: {error}") from None


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


def _written(
    model: Model, simulation: str, folder: Path, method: str, controller: str | None
) -> tuple[str, list[str]]:
    """Return the experiment file, and notes."""
    known = Known(simulation)
    notes = [note for part in model.parts for note in part.notes]
    model.check_numbers(known)
    evolves = bool(model.optimised) and controller in {None, "parameter_set"}
    if evolves and not _steers_itself(known):
        raise InputError(
            f"{model.file_of('optimised parameters')}: parameters are evolved where agents steer themselves, "
            f"but {simulation} is steered by a controller; name another one with --controller layered, or "
            "another simulation"
        )
    parameters = Parameters.of(model, known, evolved=evolves)
    notes += parameters.notes
    lines = [
        f"# Made by `swarmwright import` of {', '.join(one_line(part.path.name) for part in model.parts)}.",
        "",
        f"simulation: {_text(relative_name(simulation, folder))}",
    ]
    if known.description is None:
        notes.append(
            f"{simulation} is not built in: a simulation server has to offer it, or name another one with "
            "--simulation"
        )
        lines += _announced(model, parameters)
    if evolves and known.parameters is not None and _STEERING[0] in known.parameters:
        parameters.fixed.setdefault(_STEERING[0], (_STEERING[1], "agents steer themselves"))
    lines += ["", "parameters:" if parameters.fixed else "parameters: {}"]
    lines += [_line(name, value, where) for name, (value, where) in parameters.fixed.items()]
    lines += [f"  # not taken over: {reason}" for reason in parameters.left_out]
    lines += ["", "controller:"]
    if evolves:
        lines += ["  kind: parameter_set", "  parameters:"]
        lines += [_line(name, value, where, "    ") for name, (value, where) in parameters.evolved.items()]
    else:
        lines += [f"  kind: {controller or 'layered'}"]
    lines += ["", "method:", f"  kind: {method}", "", "ranking:", "  kind: absolute", "", "seed: 1"]
    return "\n".join(line.rstrip() for line in lines) + "\n", notes


def _steers_itself(known: Known) -> bool:
    """Whether agents of a simulation may do without a controller, as far as that is known."""
    return known.simulation not in catalogue.titles() or _STEERING[0] in (known.parameters or {})


def _announced(model: Model, parameters: Parameters) -> list[str]:
    """Return what servers of an unknown simulation are asked for."""
    lines = []
    if parameters.agents:
        lines.append(f"requirements: {{dimensions: 2, max_agents: {parameters.agents}}}")
    for key, number in (("sensors", model.sensors), ("actuators", model.actuators)):
        if number is not None:
            lines.append(f"{key}: {number}")
    return lines


def _text(value: Any) -> str:  # noqa: ANN401 - any plain value
    return dump({"x": [value]})[4:-2]


def _line(name: str, value: Any, where: str, indent: str = "  ") -> str:  # noqa: ANN401 - any plain value
    written = dump({name: [value]}).rstrip()
    key, _, rest = written.partition(": [")
    return f"{indent}{key}: {rest[:-1]}".ljust(40) + f"  # {one_line(where)}"
