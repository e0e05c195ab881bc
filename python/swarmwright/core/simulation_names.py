"""Names of simulations: titles, classes in Python, and environments of other libraries.

`minisim` is a title, `path/to/file.py:Class` and `package.module:Class` name a class, and
`library:environment?option=value&option=value` an environment.
"""

import ast
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from swarmwright.core.errors import InputError

LIBRARIES = {"gymnasium": "Gymnasium", "pettingzoo": "PettingZoo", "vmas": "Vmas"}
"""Library, which is the adapter's module, too -> its class."""

_ENVIRONMENT = re.compile(rf"({'|'.join(LIBRARIES)}):([^\s?]+)(?:\?(\S*))?")
_CLASS = re.compile(r"(?:.*\.py|[^\W\d]\w*(?:\.[^\W\d]\w*)*):[^\W\d]\w*")


@dataclass(frozen=True)
class SimulationName:
    """The parts of a simulation's name."""

    text: str
    """The whole name."""
    library: str
    """Of an environment: gymnasium, pettingzoo or vmas; else empty."""
    place: str
    """Of a class: the path of its file, or its module. Of an environment: what its library calls it."""
    member: str
    """Of a class: what it is called in its file or module."""
    query: str
    """Of an environment: what follows the question mark."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Take a name apart; any text that is neither a class nor an environment is a title."""
        match = _ENVIRONMENT.fullmatch(text)
        if match is not None:
            return cls(text, match[1], match[2], "", match[3] or "")
        place, _, member = text.rpartition(":")
        return cls(text, "", place, member, "")

    @property
    def is_environment(self) -> bool:
        """Whether it is an environment of another library."""
        return bool(self.library)

    @property
    def is_python(self) -> bool:
        """Whether it is a class or an environment, not a title."""
        return self.is_environment or _CLASS.fullmatch(self.text) is not None

    @property
    def file(self) -> Path | None:
        """The file of a class that is named by its file; else None."""
        return Path(self.place) if self.place.endswith(".py") and not self.is_environment else None

    @property
    def module(self) -> str:
        """The module that is imported for a class or environment, as far as the name has one; else empty."""
        if self.library == "gymnasium":
            return self.place.rpartition(":")[0]
        return "" if self.file is not None else self.place

    @property
    def label(self) -> str:
        """What figures and folders call it: the title, the class, or the end of an environment's name."""
        return self.text.rpartition(":")[2] if self.is_python else self.text

    def in_file(self, file: str | Path) -> str:
        """Return the name of the same class in another file."""
        return f"{file}:{self.member}"

    def options(self) -> dict[str, Any]:
        """Return the options of an environment. Raises InputError for options that are not `name=value`."""
        options = {}
        for part in filter(None, self.query.split("&")):
            key, equals, value = part.partition("=")
            if not equals or not key.isidentifier():
                raise InputError(
                    f"{self.text}: {part!r} found after the question mark, expected option=value"
                )
            options[key] = _value(value)
        return options


def is_environment(name: str) -> bool:
    """Whether a simulation is named as an environment of another library."""
    return SimulationName.parse(name).is_environment


def is_python(name: str) -> bool:
    """Whether a simulation is named by its class, or as another library's environment, not by a title."""
    return SimulationName.parse(name).is_python


def _value(text: str) -> Any:  # noqa: ANN401 - any value that JSON has
    """Return a value written as in JSON or Python, else as text."""
    for read in (json.loads, ast.literal_eval):
        try:
            return read(text)
        except (ValueError, SyntaxError):
            continue
    return text
