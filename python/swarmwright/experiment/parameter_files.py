"""Parameters in separate JSON or YAML files, named in the experiment."""

import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from swarmwright.common import yaml
from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes, suggest_file
from swarmwright.common.simulation_names import is_python
from swarmwright.simulations import catalogue

_LARGEST_FILE_BYTES = 1 << 26  # bytes
_YAML = (".yaml", ".yml")
_FILES = (*_YAML, ".json")


def resolve(
    simulation: str,
    parameters: Mapping[str, Any],
    folder: Callable[[yaml.Path_], Path],
    report: Callable[[yaml.Path_, str], None],
    *,
    ask: bool = True,
) -> tuple[dict[str, Any], dict[yaml.Path_, yaml.Source]]:
    """Replace paths of files in parameters by their contents.

    Also returns the files by the path of the value that they replace, from the parameter's name on.
    Parameters with unreadable files are omitted.

    A text for a parameter of type object is a path. If the parameter may also be a name, and for robots in
    missions and in lists of kinds, only texts that end in .yaml, .yml or .json are paths; those of robots are
    relative to the file that contains them.

    Args:
        simulation: its name; objects are known only for built-in simulations and for missions.
        parameters: parameters of the experiment.
        folder: returns the base folder of paths at a key of the parameters.
        report: called with key and message for every unreadable file.
        ask: whether a Python class may be imported.
    """
    result = dict(parameters)
    files: dict[yaml.Path_, yaml.Source] = {}
    for name, may_be_name in _iter_objects(simulation, ask=ask):
        value = result.get(name)
        if not isinstance(value, str):
            continue
        path = Path(value)
        if may_be_name and path.suffix not in _FILES:
            continue
        try:
            files[(name,)] = _read(folder((name,)) / value)
            if name == "mission":
                _require_mission(files[(name,)])
            result[name] = dict(files[(name,)].values)
        except InputError as error:
            report((name,), str(error))
            del result[name]
    lists = ("mission", "robots") if _has_missions(simulation, ask=ask) else ()
    for name in lists:
        if name not in result:
            continue
        source = files.get((name,))
        result[name], problems = _resolve_robots(
            (name,), result[name], folder if source is None else partial(_get_folder, source), files
        )
        for path_of_value, message in problems:
            report(
                *(
                    (path_of_value, message)
                    if source is None
                    else ((name,), source.locate(path_of_value[1:]) + message)
                )
            )
        if problems:
            del result[name]
    return result, files


def _require_mission(source: yaml.Source) -> None:
    """Raise InputError for an experiment or a sweep instead of a mission."""
    if not is_mission(source.values) and {"simulation", "experiment"} & set(source.values):
        raise InputError(
            f"{source.name}: is an experiment, not a mission with walls, start, metrics and fitness; "
            "print an example with 'swarmwright new arena --mission foraging --mission-file'"
        )


def is_mission(values: Mapping[str, Any]) -> bool:
    """Whether a file has the keys of a mission of the arena rather than of an experiment."""
    return "walls" in values and not {"simulation", "experiment"} & set(values)


def _get_folder(source: yaml.Source, _path: yaml.Path_) -> Path:
    return Path(source.name).parent


def _resolve_robots(
    path: yaml.Path_,
    value: Any,  # noqa: ANN401 - any value of a file
    folder: Callable[[yaml.Path_], Path],
    files: dict[yaml.Path_, yaml.Source],
) -> tuple[Any, list[tuple[yaml.Path_, str]]]:
    """Replace files of robots in a mission, or in a list of kinds, by their contents.

    Also returns the problems by key. The files are added to `files`.
    """
    if isinstance(value, list):
        resolved = [_resolve_robots((*path, index), kind, folder, files) for index, kind in enumerate(value)]
        return [kind for kind, _ in resolved], [name for _, problems in resolved for name in problems]
    if not isinstance(value, Mapping):
        return value, []
    result, problems = dict(value), []
    robot, at = result.get("robot"), (*path, "robot")
    if isinstance(robot, str) and Path(robot).suffix in _FILES:
        try:
            files[at] = _read(folder(at) / robot)
            result["robot"] = dict(files[at].values)
        except InputError as error:
            problems.append((at, str(error)))
    if "robots" in result:
        result["robots"], inner_problems = _resolve_robots((*path, "robots"), result["robots"], folder, files)
        problems += inner_problems
    return result, problems


def _read(path: Path) -> yaml.Source:
    if "\0" in str(path):
        raise InputError(f"{str(path)!r}: a path must not contain NUL")
    return (_read_yaml if path.suffix in _YAML else _read_json)(path)


def read_object(path: Path) -> dict[str, Any]:
    """Read a JSON object from a file.

    Raises InputError, with file and line, if it cannot be read or has other content.
    """
    try:
        text = read_bytes(path, _LARGEST_FILE_BYTES).decode("utf-8-sig")
        value = json.loads(text, parse_constant=_refuse_constant)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file{suggest_file(path)}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}:{error.lineno}: is not valid JSON: {error.msg}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not valid JSON: it is not UTF-8 text") from None
    except ValueError as error:
        raise InputError(f"{path}: is not valid JSON: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply") from None
    if not isinstance(value, dict):
        raise InputError(f"{path}: holds {_describe_kind(value)}; expected an object, {{...}}")
    return value


def _read_json(path: Path) -> yaml.Source:
    return yaml.Source(str(path), values=read_object(path))


def _read_yaml(path: Path) -> yaml.Source:
    source = yaml.read(path)
    if source.problems:
        lines = (
            yaml.Source(source.name, lines={path_of_problem: line}).locate(path_of_problem) + message
            for path_of_problem, line, message in source.problems
        )
        raise InputError("\n".join(lines))
    if not isinstance(source.values, Mapping):
        raise InputError(f"{path}: holds {_describe_kind(source.values)}; expected keys and values")
    return source


def _has_missions(simulation: str, *, ask: bool) -> bool:
    return catalogue.find_built_in(simulation) == catalogue.ARENA or (
        ask and is_python(simulation) and catalogue.has_missions(simulation)
    )


def _iter_objects(simulation: str, *, ask: bool) -> Iterator[tuple[str, bool]]:
    """Yield the names of parameters of type object, and whether they may be names instead."""
    is_built_in = catalogue.find_built_in(simulation) is not None
    if is_built_in or (ask and is_python(simulation) and catalogue.has_missions(simulation)):
        for name, parameter in catalogue.description(simulation)["parameters"].items():
            if parameter["type"] in ("object", "name or object"):
                yield name, parameter["type"] != "object"


def _describe_kind(value: Any) -> str:  # noqa: ANN401 - any JSON value
    if value is None:
        return "nothing"
    return "a list" if isinstance(value, list) else "text" if isinstance(value, str) else "a single value"


def _refuse_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is not a finite number")
