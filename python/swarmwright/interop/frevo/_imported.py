"""From a FREVO session to an experiment, with a comment on every entry."""

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
from swarmwright.interop.frevo._field import FieldFile, as_yaml
from swarmwright.interop.frevo._mapped import EMERGENCY_EXIT, Line, Mapped, one_line
from swarmwright.interop.frevo._mapping import Instead, map_session
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
    """Make an experiment of a FREVO session file (.zse) or of the session in a result file (.zre).

    Args:
        path: the file.
        field: the field of Emergency Exit as JSON or as FREVO's .ser; default: the one that the session
            names, beside the session.
        folder: where the experiment file is going to be; the path of a field in it is relative to that.
        simulation: what is taken in the place of FREVO's problem, as an experiment names it: a title, a class
            (the path of its file is relative to the current folder), an environment.
        method: kind that is taken in the place of FREVO's method, with its defaults, and FREVO's numbers of
            candidates and generations.
        controller: kind that is taken in the place of FREVO's representation, with its defaults.
        ranking: kind that is taken in the place of FREVO's ranking, with its defaults.

    Raises:
        InputError: the file is not a FREVO session, or holds components without counterpart here; the message
            names file, line and component or entry, of all sections, a line each.
    """
    session = open_session(Path(path))
    named = None if simulation is None else make_absolute(simulation)
    METHODS.check("method", method)
    REPRESENTATIONS.check("controller", controller)
    RANKINGS.check("ranking", ranking)
    mapped = map_session(
        session,
        None if field is None else Path(field),
        Instead(named, method, controller, ranking),
        _sensors(named or EMERGENCY_EXIT),
    )
    text = _yaml(session, mapped, Path(folder))
    # The name says what the field's path is relative to; there is no such file.
    name = str(Path(folder) / "imported.yaml")
    try:
        experiment = Experiment(**check(parse(text, name)))
    except InputError as error:
        problems = remove_locations(str(error), name)
        raise InputError(f"{path}: does not make a valid experiment:\n{problems}") from error
    return Imported(text, experiment, tuple(mapped.notes))


def _sensors(simulation: str) -> int | None:
    """Return what an agent of a simulation senses; None for one that is not here."""
    if not catalogue.is_local(simulation):
        return None
    return int(catalogue.description(simulation)["sensors"])


def _yaml(session: Session, mapped: Mapped, folder: Path) -> str:
    problem, method, representation, ranking = (getattr(session, name) for name in SECTIONS)
    lines = [
        f"# Made of FREVO's session {one_line(session.path.name)} by `swarmwright import`.",
        "# After each line, FREVO's name of the entry.",
        "",
        f"simulation: {_named(mapped.simulation, folder)}  # {one_line(problem.class_name)}",
        "",
        "parameters:",
        *_block(mapped.parameters),
    ]
    if mapped.field_file is not None:
        lines += _field_lines(mapped.field_file, folder)
    lines += _left_out(mapped.not_parameters)
    lines += ["", "controller:", *_kind(mapped.controller_kind, representation)]
    lines += [*_block(mapped.controller), *_left_out(mapped.not_controller)]
    lines += ["", "method:", *_kind(mapped.method_kind, method)]
    lines += [*_block(mapped.method), *_left_out(mapped.not_method)]
    lines += ["", "ranking:", *_kind(mapped.ranking_kind, ranking)]
    lines += [*_block(mapped.ranking), *_left_out(mapped.not_ranking)]
    lines += ["", *_block([mapped.seed], ""), *_left_out(mapped.not_config, "")]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _kind(kind: str, section: Section) -> list[str]:
    return _block([Line("kind", kind, one_line(section.class_name))])


def _named(simulation: str, folder: Path) -> str:
    """Return a simulation's name as it is written in an experiment file in this folder."""
    simulation = make_relative(simulation, folder)
    plain = re.fullmatch(r"[A-Za-z_][\w.-]*(:\w[\w.-]*)?", simulation)
    return simulation if plain else json.dumps(simulation, ensure_ascii=False)


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path.absolute().as_posix()


def _block(lines: list[Line], indent: str = "  ") -> list[str]:
    return [f"{indent}{line.key}: {_scalar(line.value)}".ljust(30) + f"  # {line.comment}" for line in lines]


def _left_out(reasons: list[str], indent: str = "  ") -> list[str]:
    return [f"{indent}# not taken over: {reason}" for reason in reasons]


def _field_lines(field: FieldFile, folder: Path) -> list[str]:
    if not field.is_json:
        return [
            f"  field:  # Filename, read from {one_line(field.path.name)}",
            *(f"    {x}" for x in as_yaml(field.value)),
        ]
    return [f"  field: {json.dumps(_relative(field.path, folder), ensure_ascii=False)}  # Filename"]


def _scalar(value: Any) -> str:  # noqa: ANN401 - int, float or word
    return repr(value) if isinstance(value, float) else str(value)
