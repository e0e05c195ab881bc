"""Names of simulations: titles, classes in Python, environments of other libraries, and commands.

`minisim` is a title, `path/to/file.py:Class` and `package.module:Class` name a class,
`library:environment?option=value&option=value` an environment, and `command:{..}`, `ros:{..}` or `fmu:{..}`
(a JSON object, in experiments a mapping) a command, robots of a ROS system or an FMU.
"""

import ast
import json
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Self

from swarmwright.common.errors import InputError

LIBRARIES = {"gymnasium": "Gymnasium", "pettingzoo": "PettingZoo", "vmas": "Vmas"}
"""Library, also the name of the adapter's module -> class of the adapter."""

MISSIONS = "arena-"
"""Prefix of the titles of the arena's missions in other simulators."""

SIMULATORS = {
    "arena-argos": "docs/how-to/simulators.md",
    "arena-enki": "docs/how-to/simulators.md",
    "arena-gazebo": "docs/how-to/simulators.md",
    "arena-gz": "docs/how-to/simulators.md",
    "arena-mujoco": "docs/how-to/simulators.md",
    "arena-stage": "docs/how-to/simulators.md",
    "argos": "docs/how-to/simulators.md",
    "stage": "docs/how-to/simulators.md",
}
"""Titles of servers of other simulators that come with Swarmwright -> page that describes them."""

_SIMULATOR_FILES = {
    ".argos": ("ARGoS", "simulators.md"),
    ".sdf": ("Gazebo", "simulators.md"),
    ".world": ("Gazebo or Stage", "simulators.md"),
    ".sumocfg": ("SUMO", "simulators.md"),
    ".net.xml": ("SUMO", "simulators.md"),
    ".rou.xml": ("SUMO", "simulators.md"),
    ".wbt": ("Webots", "simulators.md"),
    ".ttt": ("CoppeliaSim", "simulators.md"),
    ".urdf": ("robots in PyBullet, Gazebo and others", "simulators.md"),
    ".mjcf": ("MuJoCo", "simulators.md"),
    ".launch": ("ROS", "ros.md"),
}
"""Ending of a simulator's file -> the simulator, and the page on attaching it."""

_ENVIRONMENT = re.compile(rf"({'|'.join(LIBRARIES)}):([^\s?]*)(?:\?(\S*))?")
_DEFINED = re.compile(r"(command|fmu|ros):\{")
_CLASS = re.compile(r"(?:.*\.py|[^\W\d]\w*(?:\.[^\W\d]\w*)*):[^\W\d]\w*")


def simulator_file(name: str) -> str | None:
    """Return a message on a file of a simulator, with the page on attaching it; None for other files."""
    for ending, (simulator, page) in _SIMULATOR_FILES.items():
        if name.lower().endswith(ending):
            return f"is a file of {simulator}; docs/how-to/{page} shows how to attach the simulator"
    return None


@dataclass(frozen=True)
class SimulationName:
    """The parts of a simulation's name."""

    COMMAND: ClassVar[str] = "command:"
    """Prefix of a command's name."""
    ROS: ClassVar[str] = "ros:"
    """Prefix of the name of robots of a ROS system."""
    FMU: ClassVar[str] = "fmu:"
    """Prefix of an FMU's name."""
    DEFINITION: ClassVar[str] = "swarmwright-command.json"
    """The file of a command's definition, which exists only in copies."""

    text: str
    """The whole name."""
    library: str
    """For an environment: gymnasium, pettingzoo or vmas; else empty."""
    location: str
    """For a class: the path of its file, or its module. For an environment: its name in the library."""
    member: str
    """For a class: its name in the file or module."""
    query: str
    """For an environment: the part after the question mark."""

    @classmethod
    @lru_cache
    def parse(cls, text: str) -> Self:
        """Parse a name; text that names neither a class, an environment nor a command is a title.

        Raises InputError for a command with invalid JSON.
        """
        if is_definition(text):
            folder = definition_in(text).get("folder", ".")
            if not isinstance(folder, str):
                raise InputError(f"{text[:60]}: the folder must be text, not {folder!r}")
            return cls(text, "", str(Path(folder) / cls.DEFINITION), "", "")
        match = _ENVIRONMENT.fullmatch(text)
        if match is not None:
            return cls(text, match[1], match[2], "", match[3] or "")
        location, _, member = text.rpartition(":")
        return cls(text, "", location, member, "")

    @property
    def is_environment(self) -> bool:
        """Whether the simulation is an environment of another library."""
        return bool(self.library)

    @property
    def is_command(self) -> bool:
        """Whether a program runs the simulation: a command, a ROS system or an FMU."""
        return is_definition(self.text)

    @property
    def prefix(self) -> str:
        """The prefix of its kind, up to the colon."""
        return f"{self.text.partition(':')[0]}:"

    @property
    def definition(self) -> dict[str, Any]:
        """The definition of a command in an experiment, without defaults."""
        return definition_in(self.text)

    @property
    def is_python(self) -> bool:
        """Whether Python runs it: a class, an environment or a command, not a title."""
        return self.is_environment or self.is_command or _CLASS.fullmatch(self.text) is not None

    @property
    def file(self) -> Path | None:
        """The file of a class, or the location of a command's definition; else None."""
        if self.is_command:
            return Path(self.location)
        return Path(self.location) if self.location.endswith(".py") and not self.is_environment else None

    @property
    def module(self) -> str:
        """The module to import for a class or environment, if the name has one; else empty."""
        if self.is_command:
            return ""
        if self.library == "gymnasium":
            return self.location.rpartition(":")[0]
        return "" if self.file is not None else self.location

    @property
    def label(self) -> str:
        """Short name for figures and folders: title, class, program, or the end of an environment's name."""
        if self.is_command:
            return _program(self.definition)
        return self.text.rpartition(":")[2] if self.is_python else self.text

    def with_file(self, file: str | Path) -> str:
        """Return the name of the same class in another file, or of the same command in that folder."""
        if self.is_command:
            values = {**self.definition, "folder": Path(file).parent.as_posix()}
            return f"{self.prefix}{json.dumps(values, sort_keys=True, separators=(',', ':'))}"
        return f"{file}:{self.member}"

    def options(self) -> dict[str, Any]:
        """Return the options of an environment.

        Raises InputError for options that are not `name=value` or occur twice.
        """
        options = {}
        for part in filter(None, self.query.split("&")):
            key, equals, value = part.partition("=")
            if not equals or not key.isidentifier():
                raise InputError(
                    f"{self.text}: {part!r} found after the question mark, expected option=value"
                )
            if key in options:
                raise InputError(f"{self.text}: the option {key} is given twice; leave one")
            options[key] = _value(value)
        return options


def is_definition(name: str) -> bool:
    """Return whether a name is that of a command, with its definition."""
    return _DEFINED.match(name) is not None


def definition_in(name: str) -> dict[str, Any]:
    """Return the mapping after the prefix in a command's name. Raises InputError for other text."""
    try:
        values: dict[str, Any] = json.loads(name.partition(":")[2])  # it begins with a brace
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{name[:60]}: is not the JSON text of a command ({error}); an experiment has a mapping there, "
            "such as simulation: {command: ..}"
        ) from error
    return values


def is_environment(name: str) -> bool:
    """Return whether a name is that of an environment of another library."""
    return SimulationName.parse(name).is_environment


def is_python(name: str) -> bool:
    """Return whether Python runs a simulation: a class, an environment or a command, not a title."""
    return SimulationName.parse(name).is_python


def is_command(name: str) -> bool:
    """Return whether a program runs a simulation."""
    return SimulationName.parse(name).is_command


def label_of(name: str) -> str:
    """Return the short name of a plug-in: for `path/to/file.py:Class`, the class."""
    return SimulationName.parse(name).member if is_in_file(name) else name


def is_in_file(name: str) -> bool:
    """Return whether an experiment names a plug-in by its file: `path/to/file.py:Class`."""
    return SimulationName.parse(name).file is not None


def _program(definition: dict[str, Any]) -> str:
    """Return the short name of a command: its title, or the script or program that it starts."""
    if "title" in definition:
        return str(definition["title"])
    if "fmu" in definition:
        return re.sub(r"[^\w.-]", "_", Path(definition["fmu"]).stem) or "fmu"
    if "ros" in definition:
        return f"ros{definition['ros']}"
    words = [Path(word) for word in definition["command"] if not word.startswith("-")]
    scripts = [
        word for word in words if word.suffix in {".py", ".sh", ".jl", ".m", ".js", ".rb", ".R", ".lua"}
    ]
    name = (scripts or words)[0].stem
    return re.sub(r"[^\w.-]", "_", name) or "command"


def _value(text: str) -> Any:  # noqa: ANN401 - any value that JSON has
    """Return a value written as in JSON or Python, else as text."""
    for read in (json.loads, ast.literal_eval):
        try:
            return read(text)
        except (ValueError, SyntaxError):
            continue
    return text
