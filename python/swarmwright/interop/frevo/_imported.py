"""The conversion of a FREVO session to an experiment, with a comment on every entry."""

import json
import os
import re
from os import PathLike
from pathlib import Path
from typing import Any

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.yaml import parse, remove_locations
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.importing import Imported
from swarmwright.experiment.validation import check
from swarmwright.interop.frevo._document import SECTIONS, Section, Session, open_session
from swarmwright.interop.frevo._field import FieldFile, format_field
from swarmwright.interop.frevo._mapped import EMERGENCY_EXIT, Line, Mapped, to_single_line
from swarmwright.interop.frevo._mapping import Replacements, map_session
from swarmwright.methods import METHODS
from swarmwright.methods.rankings import RANKINGS
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import make_absolute, make_relative


@check_arguments
def load(
    path: str | PathLike[str],
    *,
    field: str | PathLike[str] | None = None,
    folder: str | PathLike[str] = ".",
    simulation: str | None = None,
    method: str | None = None,
    controller: str | None = None,
    ranking: str | None = None,
) -> Imported:
    """Convert a FREVO session file (.zse), or the session in a result file (.zre), to an experiment.

    Args:
        path: the file.
        field: the field of Emergency Exit as JSON or as FREVO's .ser; default: the file beside the session
            that the session names.
        folder: folder of the experiment file; the path of a field in the experiment is relative to it.
        simulation: replaces FREVO's problem; a title, a class (the path of its file is relative to the
            current folder) or an environment, as in an experiment.
        method: kind of the method that replaces FREVO's, with its defaults and FREVO's numbers of candidates
            and generations.
        controller: kind of the controller that replaces FREVO's representation, with its defaults.
        ranking: kind of the ranking that replaces FREVO's, with its defaults.

    Raises:
        InputError: the file is not a FREVO session, or contains components without counterpart in
            Swarmwright; the message lists the problems of all sections with file, line and component or
            entry, a line each.
    """
    session = open_session(Path(path))
    absolute_name = None if simulation is None else make_absolute(simulation)
    METHODS.check("method", method)
    REPRESENTATIONS.check("controller", controller)
    RANKINGS.check("ranking", ranking)
    sensors, parameters = _describe(absolute_name or EMERGENCY_EXIT)
    mapped = map_session(
        session,
        None if field is None else Path(field),
        Replacements(absolute_name, method, controller, ranking),
        sensors,
        parameters,
    )
    text = _format_experiment(session, mapped, Path(folder))
    # The path of the field is relative to the folder of this name; the file does not exist.
    name = str(Path(folder) / "imported.yaml")
    try:
        experiment = Experiment(**check(parse(text, name)))
    except InputError as error:
        problems = remove_locations(str(error), name)
        raise InputError(f"{path}: does not result in a valid experiment:\n{problems}") from error
    return Imported(text, experiment, tuple(mapped.notes))


def _describe(simulation: str) -> tuple[int | None, list[str]]:
    """Return the number of sensors of an agent and the names of parameters, as far as known.

    None and no names if the simulation is not on this computer.
    """
    if not catalogue.is_local(simulation):
        return None, []
    described = catalogue.description(simulation)
    return int(described["sensors"]), list(described["parameters"])


def _format_experiment(session: Session, mapped: Mapped, folder: Path) -> str:
    problem, method, representation, ranking = (getattr(session, name) for name in SECTIONS)
    simulation = _format_simulation(mapped.simulation, folder)
    lines = [
        f"# Converted from the FREVO session {to_single_line(session.path.name)} by `swarmwright import`.",
        "# The comment of a line is the name of its entry in FREVO.",
        "",
        f"simulation: {simulation}  # {to_single_line(problem.class_name)}",
        "",
        "parameters:",
        *_format_block(mapped.parameters),
    ]
    if mapped.field_file is not None:
        lines += _format_field_lines(mapped.field_file, folder)
    lines += _format_omissions(mapped.not_parameters)
    lines += ["", "controller:", *_format_kind(mapped.controller_kind, representation)]
    lines += [*_format_block(mapped.controller), *_format_omissions(mapped.not_controller)]
    lines += ["", "method:", *_format_kind(mapped.method_kind, method)]
    lines += [*_format_block(mapped.method), *_format_omissions(mapped.not_method)]
    lines += ["", "ranking:", *_format_kind(mapped.ranking_kind, ranking)]
    lines += [*_format_block(mapped.ranking), *_format_omissions(mapped.not_ranking)]
    lines += ["", *_format_block([mapped.seed], ""), *_format_omissions(mapped.not_config, "")]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _format_kind(kind: str, section: Section) -> list[str]:
    return _format_block([Line("kind", kind, to_single_line(section.class_name))])


def _format_simulation(simulation: str, folder: Path) -> str:
    """Return the name of a simulation in an experiment file in this folder."""
    simulation = make_relative(simulation, folder)
    plain = re.fullmatch(r"[A-Za-z_][\w.-]*(:\w[\w.-]*)?", simulation)
    return simulation if plain else json.dumps(simulation, ensure_ascii=False)


def _relative_path(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path.absolute().as_posix()


def _format_block(lines: list[Line], indent: str = "  ") -> list[str]:
    return [
        f"{indent}{line.key}: {_format_scalar(line.value)}".ljust(30) + f"  # {line.comment}"
        for line in lines
    ]


def _format_omissions(reasons: list[str], indent: str = "  ") -> list[str]:
    return [f"{indent}# not imported: {reason}" for reason in reasons]


def _format_field_lines(field: FieldFile, folder: Path) -> list[str]:
    if not field.is_json:
        return [
            f"  field:  # Filename, read from {to_single_line(field.path.name)}",
            *(f"    {x}" for x in format_field(field.value)),
        ]
    return [f"  field: {json.dumps(_relative_path(field.path, folder), ensure_ascii=False)}  # Filename"]


def _format_scalar(value: Any) -> str:  # noqa: ANN401 - int, float or word
    return repr(value) if isinstance(value, float) else str(value)
