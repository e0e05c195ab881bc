"""Parameter files of irace: `parameters.txt`.

A line has a name, a quoted switch, a type (`r`, `i`, `c`, `o`; `r,log` and `i,log`), the domain in
parentheses, and optionally `|` and a condition. Sections `[forbidden]` and `[global]` (`digits = 4`) follow.
Switches are not used, as simulations receive parameters by name.

Source: Lopez-Ibanez et al., "The irace package: iterated racing for automatic algorithm configuration",
Operations Research Perspectives 3, 2016, and its user guide.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright.common.arrays import shortest
from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes, suggest_file
from swarmwright.common.problems import format_value

_LARGEST_BYTES = 1 << 20
_LONGEST_LINE = 20_000
_MOST_PROBLEMS = 20
_DIGITS = 4
"""Decimal places of real numbers without `digits`."""
_LINE = re.compile(r"(?P<name>[._A-Za-z0-9]+)\s+(?P<rest>\S.*)")
_SWITCH = re.compile(r"(?:\"[^\"]*\"|'[^']*')\s+(?P<rest>\S.*)")
_TYPE = re.compile(r"(?P<type>[a-z]+)(?P<log>,log)?(?=[\s(])\s*(?P<rest>\S.*)")
_DOMAIN = re.compile(r"\((?P<domain>(?:\"[^\"]*\"|'[^']*'|[^()\"'])*)\)\s*(?P<rest>.*)")
_ENTRY = re.compile(
    r"\s*(?:\"(?P<double>[^\"]*)\"|'(?P<single>[^']*)'|(?P<plain>[^,\"']*[^,\"'\s]))\s*(?:,|$)"
)
_NUMBER = re.compile(r"[-+]?(?:0|[1-9]\d{0,30})(?:\.\d{0,30})?(?:[eE][-+]?\d{1,3})?")
_GLOBAL = re.compile(r"digits\s*=\s*(?P<digits>\d{1,4})")
_LARGEST_INTEGER = 1 << 24


@dataclass
class ParameterFile:
    """The content of a parameter file."""

    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Options of each parameter, as in an experiment."""
    constants: dict[str, Any] = field(default_factory=dict)
    """Parameters with a single value."""
    forbidden: list[str] = field(default_factory=list)
    """Conditions of forbidden combinations."""
    lines: dict[tuple[str | int, ...], int] = field(default_factory=dict)
    """The line, from 1, of ("parameters", name), ("constants", name) and ("forbidden", index)."""


class _LineError(ValueError):
    """A line is not valid."""


def read(file: Path) -> ParameterFile:
    """Read a parameter file.

    Raises InputError with all problems, a line each: `parameters.txt:12: ..`.
    """
    try:
        text = read_bytes(file, _LARGEST_BYTES).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = "is not UTF-8 text" if isinstance(error, UnicodeDecodeError) else "cannot be read"
        raise InputError(f"{file}: {reason}{suggest_file(file)}") from None
    return parse(text, str(file))


def parse(text: str, name: str) -> ParameterFile:
    """Parse the text of a parameter file; name: of the file, for messages. Raises InputError as `read`."""
    result = ParameterFile()
    problems: list[str] = []
    section, digits = "", _DIGITS
    for number, line in enumerate(text.split("\n"), start=1):
        content = line.split("#", 1)[0].strip()
        if content in ("[forbidden]", "[global]"):
            section = content
        elif len(content) > _LONGEST_LINE:
            problems.append(f"{name}:{number}: is longer than {_LONGEST_LINE:,} characters")
        elif content:
            try:
                if section == "[global]":
                    digits = _parse_digits(content)
                elif section == "[forbidden]":
                    result.lines["forbidden", len(result.forbidden)] = number
                    result.forbidden.append(content)
                else:
                    _add_parameter(result, content, number)
            except _LineError as error:
                problems.append(f"{name}:{number}: {error}")
    if not problems and not result.parameters:
        problems.append(f"{name}: has no parameter with more than one value")
    if problems:
        more = len(problems) - _MOST_PROBLEMS
        rest = [f"{name}: .. and {more} more problems"] if more > 0 else []
        raise InputError("\n".join([*problems[:_MOST_PROBLEMS], *rest]))
    for options in result.parameters.values():
        if options["type"] == "real":
            options["digits"] = digits
    return result


def _parse_digits(line: str) -> int:
    match = _GLOBAL.fullmatch(line)
    if match is None:
        raise _LineError(f"{format_value(line)} is not a global option; possible is digits = 4")
    digits = int(match["digits"])
    if not 1 <= digits <= 15:
        raise _LineError(f"digits must be from 1 to 15, not {digits}")
    return digits


def _add_parameter(result: ParameterFile, line: str, number: int) -> None:
    """Add the parameter of a line. Raises _LineError."""
    match = _match(_LINE, line, "a name of letters, digits, . and _, and a switch")
    name = match["name"]
    if name in result.parameters or name in result.constants:
        raise _LineError(f"there are two parameters with the name {name}")
    match = _match(_SWITCH, match["rest"], 'a switch in double quotes after the name, such as "--ants "')
    match = _match(_TYPE, match["rest"], "a type after the switch: r, i, c, o, r,log or i,log")
    kind, log = match["type"], match["log"] is not None
    if kind not in ("r", "i", "c", "o") or (log and kind in ("c", "o")):
        raise _LineError(f"the type must be r, i, c, o, r,log or i,log, not {kind}{',log' if log else ''}")
    match = _match(_DOMAIN, match["rest"], "values in parentheses after the type")
    condition = match["rest"]
    if condition and not condition.startswith("|"):
        raise _LineError(f"expected | and a condition after the values, not {format_value(condition)}")
    values = _split(match["domain"])
    options = _make_numbers(kind, values, log) if kind in ("r", "i") else _make_choices(kind, values)
    if condition:
        options["when"] = condition[1:].strip()
        if not options["when"]:
            raise _LineError("expected a condition after |")
    if kind in ("c", "o") and len(values) == 1:
        if condition:
            raise _LineError(f"{name} has a single value, so it cannot have a condition; remove one of them")
        result.constants[name] = options["choices"][0]
        result.lines["constants", name] = number
        return
    result.parameters[name] = options
    result.lines["parameters", name] = number


def _match(pattern: re.Pattern[str], text: str, expected: str) -> re.Match[str]:
    match = pattern.fullmatch(text)
    if match is None:
        raise _LineError(f"expected {expected}; found {format_value(text)}")
    return match


def _split(domain: str) -> list[str]:
    """Return the values of a domain."""
    values = []
    position = 0
    while position < len(domain):
        match = _ENTRY.match(domain, position)
        if match is None:
            raise _LineError(f"the values ({format_value(domain)}) must be separated by commas")
        values.append(next(text for text in match.groups() if text is not None))
        position = match.end()
    if not values or domain.rstrip().endswith(","):
        raise _LineError("a value is missing between parentheses")
    return values


def _make_numbers(kind: str, values: list[str], log: bool) -> dict[str, Any]:
    """Return the options of a number."""
    if len(values) != 2:
        raise _LineError(f"a number has two values, the lowest and the highest, not {len(values)}")
    for value in values:
        if not _NUMBER.fullmatch(value):
            raise _LineError(
                f"{format_value(value)} is not a number; limits cannot depend on other parameters"
            )
    limits: list[Any] = [float(value) for value in values]
    if kind == "i":
        if not all(limit.is_integer() for limit in limits):
            raise _LineError(f"the limits of an integer must be whole numbers, not {', '.join(values)}")
        limits = [int(limit) for limit in limits]
    options: dict[str, Any] = {"type": "real" if kind == "r" else "integer", "range": limits}
    return {**options, "scale": "log"} if log else options


def _make_choices(kind: str, values: list[str]) -> dict[str, Any]:
    """Return the options of a choice: numbers if all values are some."""
    numbers = [_number_of(value) for value in values]
    choices: list[Any] = list(values)
    if all(number is not None for number in numbers) and len(set(numbers)) == len(numbers):
        choices = numbers
    return {"type": "categorical" if kind == "c" else "ordinal", "choices": choices}


def _number_of(text: str) -> float | int | None:
    """Return a value as a number that is sent unchanged; None if it is another text."""
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    if not abs(value) <= _LARGEST_INTEGER or shortest(np.array([value], dtype=np.float32)) != [value]:
        return None
    return int(value) if re.fullmatch(r"-?\d+", text) else value
