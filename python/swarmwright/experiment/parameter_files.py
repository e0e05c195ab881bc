"""Parameters that are too large for an experiment file: the path of a JSON or YAML file stands for them."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn

from swarmwright.core import yaml
from swarmwright.core.errors import InputError
from swarmwright.core.files import read_bytes
from swarmwright.core.simulation_names import is_python
from swarmwright.simulations import catalogue

_LARGEST = 1 << 26  # bytes
_YAML = (".yaml", ".yml")


def resolve(
    simulation: str,
    parameters: Mapping[str, Any],
    folder: Callable[[str], Path],
    report: Callable[[str, str], None],
    *,
    ask: bool = True,
) -> tuple[dict[str, Any], dict[str, yaml.Source]]:
    """Return the parameters with files read: text in the place of an object is the path of a file with it.

    Also returns the files by the parameter that they stand for.

    Where a parameter may be a name, too, only text that ends in .yaml, .yml or .json is a path.

    Args:
        simulation: its name; only of built-in simulations, and of missions in others, it is known what is an
            object.
        parameters: as they stand in the experiment.
        folder: of a parameter's name: what its path is relative to.
        report: called with name and message for every file that cannot be read.
        ask: whether a class in Python may be imported.
    """
    result, files = dict(parameters), {}
    for name, named in _objects(simulation, ask=ask):
        value = result.get(name)
        if not isinstance(value, str):
            continue
        path = Path(value)
        if named and path.suffix not in (*_YAML, ".json"):
            continue
        try:
            files[name] = (_read_yaml if path.suffix in _YAML else _read_json)(folder(name) / value)
            result[name] = dict(files[name].values)
        except InputError as error:
            report(name, str(error))
            del result[name]
    return result, files


def read_object(path: Path) -> dict[str, Any]:
    """Return the JSON object that a file holds.

    Raises InputError, with file and line, when it cannot be read or holds something else.
    """
    try:
        text = read_bytes(path, _LARGEST).decode("utf-8-sig")
        value = json.loads(text, parse_constant=_no_number)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
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
        raise InputError(f"{path}: holds {_kind(value)}; expected an object, {{...}}")
    return value


def _read_json(path: Path) -> yaml.Source:
    return yaml.Source(str(path), values=read_object(path))


def _read_yaml(path: Path) -> yaml.Source:
    source = yaml.read(path)
    if source.problems:
        told = (
            yaml.Source(source.name, lines={place: line}).place(place) + message
            for place, line, message in source.problems
        )
        raise InputError("\n".join(told))
    if not isinstance(source.values, Mapping):
        raise InputError(f"{path}: holds {_kind(source.values)}; expected keys and values")
    return source


def _objects(simulation: str, *, ask: bool) -> Iterator[tuple[str, bool]]:
    """Yield the names of parameters that are objects, each with whether it may be a name instead."""
    known = catalogue.built_in(simulation) is not None
    if known or (ask and is_python(simulation) and catalogue.has_missions(simulation)):
        for name, parameter in catalogue.description(simulation)["parameters"].items():
            if parameter["type"] in ("object", "name or object"):
                yield name, parameter["type"] != "object"


def _kind(value: Any) -> str:  # noqa: ANN401 - any JSON value
    if value is None:
        return "nothing"
    return "a list" if isinstance(value, list) else "text" if isinstance(value, str) else "a single value"


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"{word} is not a finite number")
