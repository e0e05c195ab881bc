"""Parsing of launchers in experiments and on the command line."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value, problems_of
from swarmwright.common.suggestions import did_you_mean
from swarmwright.experiment.launchers import LAUNCHERS, LauncherOptions

Entries = tuple[LauncherOptions, ...]
Report = Callable[[tuple[str | int, ...], str], None]
"""Called with a problem: path within `servers`, message."""

_TEXT = re.compile(r"([^\W\d][\w-]*):(\d+)(?:\.\.(\d+))?")
WORDS = ("auto", "local", "in-process")


def names_launchers(value: Any) -> bool:  # noqa: ANN401 - whatever a file says
    """Whether a value of `servers` describes launchers: a mapping, a list, or a text such as slurm:200."""
    if isinstance(value, str):
        return value not in WORDS and (":" in value or value in LAUNCHERS.names())
    return isinstance(value, Mapping | list | tuple | LauncherOptions)


def entries_of(value: Any, folder: Path, report: Report) -> Entries | None:  # noqa: ANN401 - whatever a file says
    """Return the options of all entries; None after reporting problems.

    folder: base of relative paths.
    """
    if isinstance(value, str):
        try:
            value = parse_text(value, ())
        except InputError as error:
            report((), str(error))
            return None
    is_list = isinstance(value, list | tuple)
    parsed = [
        _parse_entry(entry, folder, (lambda path, message, at=at: report((*at, *path), message)))  # type: ignore[misc] # the default binds it
        for entry, at in (
            (entry, (index,) if is_list else ()) for index, entry in enumerate(value if is_list else [value])
        )
    ]
    entries = tuple(launcher for launcher in parsed if launcher is not None)
    if len(entries) < len(parsed):
        return None
    if not entries:
        report((), "must have a launcher, such as {launcher: slurm, count: 4}")
        return None
    problem = _explain_conflict(entries)
    if problem is not None:
        report((), problem)
        return None
    return entries


def _explain_conflict(entries: Entries) -> str | None:
    """Return why entries cannot be combined, or None."""
    if sum(entry.launcher == "process" for entry in entries) > 1:
        return "has two entries for process; combine them into one with the total count"
    return None


def _parse_entry(value: Any, folder: Path, report: Report) -> LauncherOptions | None:  # noqa: ANN401 - whatever a file says
    if isinstance(value, LauncherOptions):
        return value
    if isinstance(value, str):
        try:
            return parse_text(value, ())[0]
        except InputError as error:
            report((), str(error))
            return None
    if not isinstance(value, Mapping):
        report((), f"must be a launcher, such as {{launcher: slurm, count: 4}}, not {format_value(value)}")
        return None
    kind = value.get("launcher")
    if not isinstance(kind, str):
        report(("launcher",), f"is missing; available: {', '.join(LAUNCHERS.names())}")
        return None
    try:
        model = LAUNCHERS.get(kind).options_model
    except InputError as error:
        report(("launcher",), str(error))
        return None
    try:
        options = model.model_validate(dict(value))
    except ValidationError as error:
        for path, message in problems_of(error, model):
            report(path, message)
        return None
    return _with_paths(options, folder)


def _with_paths(options: LauncherOptions, folder: Path) -> LauncherOptions:
    """Make the paths of local files in options absolute."""
    changes = {}
    for name in options.paths:
        value = getattr(options, name)
        if isinstance(value, str):
            changes[name] = str((folder / Path(value).expanduser()).resolve())
    return options.model_copy(update=changes) if changes else options


def parse_text(text: str, defaults: Sequence[LauncherOptions]) -> Entries:
    """Parse a text such as `slurm:200` or `slurm:100,process:2` into entries.

    given: the experiment's entries, whose other options apply to launchers of the same name.

    Raises:
        InputError: the text is invalid, or a launcher needs options that only an experiment can set.
    """
    entries = []
    for part in text.split(","):
        match = _TEXT.fullmatch(part.strip())
        if match is None:
            # In `slurm:-3` only the number is wrong.
            is_launcher = part.partition(":")[0].strip() in LAUNCHERS.names()
            hint = "" if is_launcher else did_you_mean(part, [*LAUNCHERS.names(), *WORDS])
            if any(launcher.launcher == part.strip() for launcher in defaults):
                hint = "; leave it out to start those of the experiment"
            words = "" if is_launcher or part != text else f"{', '.join(WORDS)}, a number, or "
            raise InputError(
                f"must be {words}a launcher with a number of servers, such as slurm:4 or slurm:4..200, "
                f"not {part!r}{hint}"
            )
        kind = match[1]
        number = {"count": int(match[2])}
        if match[3] is not None:
            number = {"min": int(match[2]), "max": int(match[3])}
        model = LAUNCHERS.get(kind).options_model
        base = next((launcher for launcher in defaults if launcher.launcher == kind), None)
        values: dict[str, Any] = {"launcher": kind} if base is None else base.model_dump(exclude_unset=True)
        try:
            options = {key: value for key, value in values.items() if key not in {"count", "min", "max"}}
            entries.append(model.model_validate({**options, "launcher": kind, **number}))
        except ValidationError as error:
            path, message = problems_of(error, model)[0]
            key = ".".join(map(str, path))
            if not path:  # several options conflict
                raise InputError(f"{part}: {message}") from error
            hint = f"; set it in the experiment, servers: {{launcher: {kind}, {key}: ..}}"
            raise InputError(f"{part}: {key}: {message}{'' if key in number else hint}") from error
    problem = _explain_conflict(tuple(entries))
    if problem is not None:
        raise InputError(problem)
    return tuple(entries)


def files_of(entries: Entries) -> list[str]:
    """Return the patterns of files to copy with the simulation's code."""
    return list(dict.fromkeys(file for entry in entries if entry.code is None for file in entry.files))


def with_files(entries: Entries, experiment_entries: Entries) -> Entries:
    """Add the files of the experiment's entries, which the simulation needs, to other entries.

    given: the experiment's entries.
    """
    files = files_of(experiment_entries)
    return tuple(
        entry.model_copy(update={"files": files})
        if files and entry.code is None and "files" not in entry.model_fields_set
        else entry
        for entry in entries
    )


def to_file_value(entries: Entries) -> Any:  # noqa: ANN401 - a mapping or a list
    """Convert entries to the form of experiment files, with all defaults; a single entry as a mapping."""
    mappings = [entry.model_dump(exclude_none=True) for entry in entries]
    return mappings[0] if len(mappings) == 1 else mappings
