"""OptimisedParameters: the parameters that a designer marked for optimization.

Modelio's CPSwarm module writes them as `{"parameters": [{"name", "meta", "min", "max", "scale"}]}`. FREVO
evolves a whole number from min to max, and the simulation gets that number times scale. The schema declares
`scale` as a string, the published samples have a number; both are supported.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmwright.common.problems import format_value
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.yaml import Source
from swarmwright.interop.models._parts import Location, OptimisedParameter, Part, Problems

WORDS = 'OptimisedParameters ({"parameters": [..]})'
_KEYS = ("name", "meta", "min", "max", "scale")
_VALUE = "value"
"""Key of the best value, which `swarmwright export --model` adds."""
_META = re.compile(r"command_line|file:\s*\S.*")


def recognises(values: object) -> bool:
    """Whether a JSON value is an OptimisedParameters file."""
    return isinstance(values, Mapping) and "parameters" in values


def load(path: Path, source: Source) -> Part:
    """Read the parameters of a file. Raises InputError with all problems, each with file and line."""
    problems = Problems()
    part = Part(path, WORDS)
    values = source.values
    for key in values:
        if key != "parameters":
            problems.lines.add(f"{source.locate((key,))}unknown key; expected parameters")
    entries = values["parameters"]
    if not isinstance(entries, list):
        problems.lines.add(f"{source.locate(('parameters',))}expected a list, not {format_value(entries)}")
        entries = []
    elif not entries:
        problems.lines.add(f"{source.locate(('parameters',))}the list is empty; add a parameter to optimise")
    first: dict[str, int] = {}
    for index, entry in enumerate(entries):
        parameter = _parameter(path, source, index, entry, problems)
        if parameter is None:
            continue
        if parameter.name in first:
            problems.add(
                parameter.location,
                f"duplicate name {parameter.name!r} (first in line {first[parameter.name]})",
            )
        first.setdefault(parameter.name, parameter.location.line)
        part.optimised.append(parameter)
    problems.stop()
    return part


def _parameter(
    path: Path, source: Source, index: int, entry: object, problems: Problems
) -> OptimisedParameter | None:
    at = ("parameters", index)
    location = Location(path, source.lines.get(at, 1), f"parameters[{index}]")
    if not isinstance(entry, Mapping):
        problems.add(location, f"expected an object with {', '.join(_KEYS)}, not {format_value(entry)}")
        return None
    problem_count = len(problems.lines)
    for key in entry:
        if key not in (*_KEYS, _VALUE):
            hint = did_you_mean(key, _KEYS) or f"; expected {', '.join(_KEYS)}"
            problems.lines.add(f"{source.locate((*at, key))}unknown key{hint}")
    missing = [key for key in _KEYS if key not in entry]
    if missing:
        problems.add(location, f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing")
    for key in ("name", "meta"):
        value = entry.get(key, "x")
        if not isinstance(value, str) or not value.strip():
            problems.lines.add(f"{source.locate((*at, key))}expected text, not {format_value(value)}")
    meta = entry.get("meta")
    if isinstance(meta, str) and meta.strip() and not _META.fullmatch(meta.strip()):
        problems.lines.add(
            f"{source.locate((*at, 'meta'))}{meta!r} found, expected command_line or file:PACKAGE"
        )
    bounds = [_bound(source, (*at, key), entry[key], problems) for key in ("min", "max") if key in entry]
    scale = _scale(source, (*at, "scale"), entry.get("scale", 1), problems)
    if len(bounds) == 2 and None not in bounds and not bounds[0] < bounds[1]:  # type: ignore[operator]
        problems.lines.add(
            f"{source.locate((*at, 'max'))}{bounds[1]} found, expected a number above min, {bounds[0]}"
        )
    if len(problems.lines) > problem_count:
        return None
    low, high = bounds
    assert low is not None
    assert high is not None
    assert scale is not None
    return OptimisedParameter(entry["name"].strip(), low, high, scale, entry["meta"].strip(), location)


def _bound(source: Source, at: tuple[str | int, ...], value: Any, problems: Problems) -> int | float | None:  # noqa: ANN401 - whatever the file says
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 2**24:
        problems.lines.add(
            f"{source.locate(at)}expected a number within +-{2**24}, not {format_value(value)}"
        )
        return None
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _scale(source: Source, at: tuple[str | int, ...], value: Any, problems: Problems) -> float | None:  # noqa: ANN401 - whatever the file says
    number = math.nan
    if isinstance(value, int | float) and not isinstance(value, bool):
        number = float(value)
    elif isinstance(value, str):
        try:
            number = float(value) if "_" not in value else math.nan
        except ValueError:
            number = math.nan
    if not math.isfinite(number) or number <= 0:
        problems.lines.add(
            f'{source.locate(at)}expected a number above 0, also as a string such as "0.1", '
            f"not {format_value(value)}"
        )
        return None
    return number
