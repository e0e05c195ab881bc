"""From a FREVO session to an experiment, with a word about every entry."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmwright._errors import InputError
from swarmwright._experiment import Experiment
from swarmwright._validate import check
from swarmwright._yaml import parse
from swarmwright.frevo._document import SECTIONS, Session, open_session
from swarmwright.frevo._field import FieldFile, as_yaml
from swarmwright.frevo._mapping import Line, Mapped, map_session, one_line


@dataclass(frozen=True)
class Imported:
    """An experiment made of a FREVO session.

    yaml: the commented experiment file. experiment: the same, loaded. notes: what could not be taken over as
    it was, a sentence each.
    """

    yaml: str
    experiment: Experiment
    notes: tuple[str, ...]


def load(path: str | Path, *, field: str | Path | None = None, folder: str | Path = ".") -> Imported:
    """Make an experiment of a FREVO session file (.zse) or of the session in a result file (.zre).

    Args:
        path: the file.
        field: the field of Emergency Exit as JSON or as FREVO's .ser; default: the one that the session
            names, beside the session.
        folder: where the experiment file is going to be; the path of a field in it is relative to that.

    Raises:
        InputError: the file is no session of FREVO's, or holds what has no counterpart here; the message
            names file, line and entry.
    """
    session = open_session(Path(path))
    mapped = map_session(session, None if field is None else Path(field))
    text = _yaml(session, mapped, Path(folder))
    try:
        # The name stands for the folder that the field's path is relative to.
        experiment = Experiment(**check(parse(text, str(Path(folder) / "imported.yaml"))))
    except InputError as error:
        raise InputError(f"{path}: does not make a valid experiment:\n{error}") from error
    return Imported(text, experiment, tuple(mapped.notes))


def _yaml(session: Session, mapped: Mapped, folder: Path) -> str:
    problem, method, representation, ranking = (getattr(session, name) for name in SECTIONS)
    lines = [
        f"# Made of FREVO's session {one_line(session.path.name)} by `swarmwright import`.",
        "# Behind each line stands FREVO's name of the entry.",
        "",
        f"simulation: emergency_exit  # {problem.class_name}",
        "",
        "parameters:",
        *_block(mapped.parameters),
    ]
    if mapped.field_file is not None:
        lines += _field_lines(mapped.field_file, folder)
    lines += _left_out(mapped.not_parameters)
    lines += ["", "controller:", *_block([Line("kind", mapped.controller_kind, representation.class_name)])]
    lines += [*_block(mapped.controller), *_left_out(mapped.not_controller)]
    lines += ["", "method:", *_block([Line("kind", mapped.method_kind, method.class_name)])]
    lines += [*_block(mapped.method), *_left_out(mapped.not_method)]
    lines += ["", "ranking:", *_block([Line("kind", "absolute", ranking.class_name)])]
    lines += [*_block(mapped.ranking), *_left_out(mapped.not_ranking)]
    lines += ["", *_block([mapped.seed], ""), *_left_out(mapped.not_config, "")]
    return "\n".join(line.rstrip() for line in lines) + "\n"


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
    try:
        shown = os.path.relpath(field.path, folder)
    except ValueError:  # on another drive
        shown = str(field.path.absolute())
    return [f"  field: {json.dumps(Path(shown).as_posix(), ensure_ascii=False)}  # Filename"]


def _scalar(value: Any) -> str:  # noqa: ANN401 - int, float or word
    return repr(value) if isinstance(value, float) else str(value)
