"""Simulations and simulation servers as FMUs for co-simulation: `swarmwright export-fmu`.

Their library is part of the wheel; in a checkout it is compiled on first use, since compiling it takes long
and few users need it.
"""

import json
import logging
import math
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from swarmwright import _engine
from swarmwright.common.errors import InputError, RunError, engine_errors
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.ranges import Range, ranges_of
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.source.text import MARK, check_prefix
from swarmwright.experiment.derived import place_of
from swarmwright.experiment.experiment import Experiment
from swarmwright.export._base import Files, render
from swarmwright.export.fmu import (
    add_range,
    add_units,
    format_xml,
    name_variables,
    start_description,
    token,
    unit_name,
    zip_files,
)
from swarmwright.simulations import catalogue
from swarmwright.simulations.physics import AnyHost

Kind = Literal["number", "integer", "flag", "text", "json"]
TIME, SEED, DONE, FITNESS = range(4)
_FIRST_PARAMETER = 100
_FIRST_METRIC = 10_000
_FIRST_AGENT = 100_000
_MOST_VARIABLES = 200_000
_LARGEST_INTEGER = 2**31 - 1
"""Largest value of FMI 2.0's type Integer."""
_UNITS = {"metres": "m", "seconds": "s", "radians": "rad", "metres per second": "m/s"}
"""Units of simulations -> their names in FMUs."""
_UNIT = re.compile(rf"\b({'|'.join(sorted(_UNITS, key=len, reverse=True))})\b")
_NUMBER = r"-?\d(?:[\d,.]*\d)?"
_LIMITS = re.compile(rf"(?<![\w.])({_NUMBER}) to ({_NUMBER})(?!\w)")
_AT_LEAST = re.compile(rf"\bat least ({_NUMBER})(?!\w)")
"""Patterns of limits, and of a lower limit, in descriptions of built-in simulations' parameters."""
_STEP_LIMITS = {"emergency_exit": "steps", "minisim": "maxSteps"}
"""Parameters with the number of steps of an episode."""
_TICK_S = 0.1
"""Duration of a tick of the arena."""

Limits = tuple[float | None, float | None]
"""Smallest and largest value; None: no limit."""


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU."""

    name: str
    reference: int
    kind: Literal["single", "double", "integer", "seed", "flag", "text"]
    causality: Literal["parameter", "input", "output"]
    description: str
    start: Any = None
    unit: str = ""
    range: Limits = (None, None)
    stands_for: Range | None = None
    """Values of -1 and 1; None if the variable is not scaled."""


@dataclass(frozen=True)
class Parameter:
    """A parameter that importers can set."""

    name: str
    kind: Kind
    start: float | int | bool | str
    description: str
    unit: str = ""
    range: Limits = (None, None)


class Start(NamedTuple):
    """Properties of an episode after its first step."""

    agents: int
    """Number of acting agents."""
    turns: int
    """Steps of an FMU per step: 1, or the number of agents if they act in turn."""
    period: float
    """Seconds of a step of the FMU."""


@dataclass(frozen=True)
class Model:
    """A simulation with parameters: built in, or behind a broker."""

    title: str
    description: Mapping[str, Any]
    """See `catalogue.description`."""
    base: Mapping[str, Any]
    """Values of parameters, without the seed."""
    seed: int
    agents: int
    period: float
    """Duration of a step in seconds."""
    duration: float | None = None
    """Duration of the longest episode with these parameters in seconds; None if unknown."""
    parameters: list[Parameter] = field(default_factory=list)
    dimensions: float | None = None
    """For a proxy: number of spatial dimensions required of servers."""
    groups: Sequence[DeclaredGroup] = ()
    """Groups of agents in the order of the agents, if they differ."""
    ranges: Mapping[str | None, Mapping[str, Any]] = field(default_factory=dict)
    """Ranges of sensors and actuators, see `catalogue.ranges`: by group, or None for all agents."""

    @classmethod
    def from_simulation(cls, title: str, parameters: Mapping[str, Any]) -> "Model":
        """Return the model of a built-in simulation.

        Raises InputError for another simulation, and for unknown or invalid parameters.
        """
        titles = catalogue.titles()
        if title not in titles:
            raise InputError(
                f"simulation {title}: FMUs are limited to the built-in simulations {', '.join(titles)}"
                f"{did_you_mean(title, list(titles)) or ''}"
            )
        base = {name: value for name, value in parameters.items() if name != "seed"}
        seed = int(parameters.get("seed", 0)) % 2**64
        description = catalogue.description(title, dict(parameters))
        for name in base:
            if name not in description["parameters"]:
                hint = did_you_mean(name, list(description["parameters"])) or ""
                raise InputError(f"parameters.{name}: unknown parameter of {title}{hint}")
        start = measure_start(
            catalogue.make_playable(title),
            base,
            seed,
            int(description["actuators"]),
            catalogue.step_seconds(title),
        )
        check_size(title, start.agents, description)
        return cls(
            title,
            description,
            base,
            seed,
            start.agents,
            start.period,
            duration=_duration(title, {**_defaults(description), **base}, start),
            parameters=_with_agents(collect_parameters(description, base, have_limits=True), start.agents),
            groups=catalogue.groups(title, dict(parameters)),
        )

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics."""
        return list(self.description["metrics"])

    def content(self, token: str) -> dict[str, Any]:
        """Return the content of `resources/model.json`, which the library reads."""
        return {
            "token": token,
            "title": self.title,
            "base": self.base,
            "parameters": [
                {"name": parameter.name, "kind": parameter.kind, "start": parameter.start}
                for parameter in self.parameters
            ],
            "seed": self.seed,
            "agents": self.agents,
            "sensors": self.description["sensors"],
            "actuators": self.description["actuators"],
            "metrics": self.metrics,
            "period": self.period,
            **({} if self.dimensions is None else {"dimensions": self.dimensions}),
        }

    def variables(self) -> Iterator[Variable]:
        """Yield all variables except the time."""
        yield Variable("seed", SEED, "seed", "parameter", "Seed of the episode, at least 0", start=self.seed)
        for index, parameter in enumerate(self.parameters):
            kind: Any = {"number": "double", "json": "text"}.get(parameter.kind, parameter.kind)
            reference = _FIRST_PARAMETER + index
            about = (parameter.description, parameter.start, parameter.unit, parameter.range)
            yield Variable(parameter.name, reference, kind, "parameter", *about)
        yield Variable("done", DONE, "flag", "output", "Whether the episode has ended")
        yield Variable(
            "fitness", FITNESS, "double", "output", "Fitness of the episode so far; larger is better"
        )
        for index, (name, about) in enumerate(self.description["metrics"].items()):
            text, unit = about["description"], unit_of(about["unit"])
            yield Variable(f"metrics.{name}", _FIRST_METRIC + index, "double", "output", text, unit=unit)
        yield from self._agent_variables()

    def _agent_variables(self) -> Iterator[Variable]:
        most = {noun: int(self.description[f"{noun}s"]) for noun in ("sensor", "actuator")}
        groups = [group for group in self.groups for _ in range(group.agents)]
        for agent in range(self.agents):
            group = groups[agent] if agent < len(groups) else None
            first = _FIRST_AGENT + agent * (1 + most["sensor"] + most["actuator"])
            yield Variable(
                f"agent[{agent + 1}].acts",
                first,
                "flag",
                "output",
                "Whether the actuators of the agent count in the next step",
            )
            for index, (name, text, unit, scale) in enumerate(self._channels("sensor", group)):
                full, about = f"agent[{agent + 1}].{name}", f"{text}{_words(scale)}"
                number = first + 1 + index
                yield Variable(full, number, "single", "output", about, unit=unit, stands_for=scale)
            for index, (name, text, unit, scale) in enumerate(self._channels("actuator", group)):
                full, number = f"agent[{agent + 1}].{name}", first + 1 + most["sensor"] + index
                about = f"{text}{_words(scale) or ', -1 to 1'}"
                yield Variable(full, number, "single", "input", about, 0.0, unit, (-1.0, 1.0), scale)

    def _channels(self, noun: str, group: DeclaredGroup | None) -> list[tuple[str, str, str, Range | None]]:
        """Return name, text, unit and range of an agent's sensors or actuators."""
        if group is None:
            count = self.description[f"{noun}s"]
            names, units = self.description[f"{noun}_names"], self.description[f"{noun}_units"]
        else:
            count, names, units = getattr(group, f"{noun}s"), getattr(group, f"{noun}_names"), ()
        texts = [str(name) for name in names]
        if len(texts) != count:
            texts = [f"{noun} {index + 1}" for index in range(count)]
        known_units = [unit_of(unit) for unit in units] if len(units) == count else [""] * count
        declared_ranges = self.ranges.get(None if group is None else group.name, {}).get(f"{noun}_ranges", ())
        ranges = ranges_of(declared_ranges, count) or (None,) * count
        units_and_ranges = [
            (unit, None) if limits is None else ("", limits._replace(unit=limits.unit or unit))
            for limits, unit in zip(ranges, known_units, strict=True)
        ]
        return [
            (name, text, *unit_and_range)
            for name, text, unit_and_range in zip(
                name_variables(f"{noun}s", texts), texts, units_and_ranges, strict=True
            )
        ]


def _words(stands_for: Range | None) -> str:
    return "" if stands_for is None else f", {stands_for.scaled_words}"


def unit_of(words: str) -> str:
    """Return the name of a unit in FMUs: m for metres."""
    return _UNITS.get(words, unit_name(words))


def check_size(title: str, agents: int, description: Mapping[str, Any]) -> None:
    """Raise InputError if the agents have too many variables for an FMU."""
    variables = agents * (1 + description["sensors"] + description["actuators"])
    if variables > _MOST_VARIABLES:
        raise InputError(
            f"simulation {title}: {agents:,} agents have {variables:,} variables, but the limit of an "
            f"FMU is {_MOST_VARIABLES:,}; use fewer agents"
        )


def collect_parameters(
    description: Mapping[str, Any], base: Mapping[str, Any], *, have_limits: bool
) -> list[Parameter]:
    """Return the parameters of a description, with the values of `base`.

    have_limits: whether descriptions contain unit and range, as in built-in simulations.
    """
    parameters = [
        _parameter(name, about, base)
        for name, about in sorted(description["parameters"].items())
        if name != "seed"
    ]
    return [_with_limits(parameter) for parameter in parameters] if have_limits else parameters


def measure_start(
    simulation: str | AnyHost,
    base: Mapping[str, Any],
    seed: int,
    actuators: int,
    step_seconds: float | None,
) -> Start:
    """Run the first step of an episode and return its properties.

    step_seconds: None without physical time; then the seconds for which a step is shown are used.
    """
    with engine_errors():
        episodes = _engine.Episodes(simulation, dict(base), [seed])
        agents = turns = 0
        while not episodes.done:
            acting = episodes.acting()[1]
            agents = max([agents, *(int(agent) + 1 for agent in acting)])
            episodes.step(np.zeros((len(acting), actuators), np.float32))
            turns += 1
            if not episodes.mid_step:
                break
        return Start(agents, turns, step_seconds or episodes.step_size or 1.0)


def _defaults(description: Mapping[str, Any]) -> dict[str, Any]:
    return {name: about["default"] for name, about in description["parameters"].items()}


def _duration(title: str, parameters: Mapping[str, Any], start: Start) -> float | None:
    """Return the duration of the longest episode of a built-in simulation in seconds; None if unknown."""
    if title in _STEP_LIMITS:
        steps = int(parameters[_STEP_LIMITS[title]])
    else:
        seconds = parameters["duration"] or _mission_seconds(parameters["mission"])
        if seconds is None:
            return None
        steps = math.floor(seconds / _TICK_S + 0.5)
    return float(f"{steps * start.turns * start.period:.12g}")


def _mission_seconds(mission: Any) -> float | None:  # noqa: ANN401 - a name or an object
    """Return the duration of a mission of the arena; None for an object without a duration."""
    if isinstance(mission, Mapping):
        return mission.get("duration")
    durations = {entry[key]: entry["duration"] for entry in _engine.missions() for key in ("name", "also")}
    return durations.get(mission)


def _with_limits(parameter: Parameter) -> Parameter:
    """Return a parameter with the unit and range of its description."""
    if parameter.kind not in ("integer", "number"):
        return parameter
    kind = int if parameter.kind == "integer" else float
    match = _LIMITS.search(parameter.description) or _AT_LEAST.search(parameter.description)
    numbers = [kind(number.replace(",", "")) for number in match.groups()] if match else []
    low, high = [*numbers, None, None][:2]
    # Only FMI's real types have a unit.
    unit = _UNIT.search(parameter.description) if parameter.kind == "number" else None
    return replace(parameter, unit=_UNITS[unit[1]] if unit else "", range=(low, high))


def _with_agents(parameters: Sequence[Parameter], agents: int) -> list[Parameter]:
    """Limit the numbers of agents to those with variables in the FMU.

    agents: their number; defenders follow the other agents if controllers steer them, too.
    """
    starts = {parameter.name: parameter.start for parameter in parameters}
    limits: dict[str, Limits] = {}
    if "numAgents" in starts:
        limits["numAgents"] = 1, int(starts["numAgents"])
        if agents > int(starts["numAgents"]):
            limits["numDefenders"] = 0, int(starts.get("numDefenders", 0))
    return [replace(parameter, range=limits.get(parameter.name, parameter.range)) for parameter in parameters]


def _parameter(name: str, about: Mapping[str, Any], base: Mapping[str, Any]) -> Parameter:
    value = base.get(name, about["default"])
    text = str(about["description"])
    simple = about["type"] in ("integer", "number", "string", "boolean") and value is not None
    if simple and isinstance(value, bool):
        return Parameter(name, "flag", value, text)
    if simple and about["type"] == "integer" and float(value).is_integer() and abs(value) <= _LARGEST_INTEGER:
        return Parameter(name, "integer", int(value), text)
    if simple and about["type"] in ("integer", "number"):
        return Parameter(name, "number", float(value), text)
    if simple:
        return Parameter(name, "text", str(value), text)
    start = value if isinstance(value, str) else "" if value is None else json.dumps(value)
    return Parameter(name, "json", start, f"{text} As JSON; empty for the default.")


CONNECTION = "connection."
"""Prefix of the parameters of the connection, as in `engine/bindings/fmi`."""
_ANNOUNCEMENT_WAIT_S = 1.0
_AGENTS = ("numAgents", "robots", "agents")
"""Parameters that may hold the number of agents."""


@dataclass(frozen=True)
class Address:
    """Default connection of a proxy to its server."""

    broker: str
    """URL, or the URLs of a cluster, separated by commas."""
    prefix: str = ""
    server: int | None = None
    """Id of the server to use; None for any."""
    discovery_s: float = 10.0
    """Seconds to search for a free server."""
    step_s: float = 60.0
    """Seconds that a server may take for a step."""


def proxy_model(experiment: Experiment, address: Address, agents: int | None = None) -> Model:
    """Return the model of a simulation offered by servers.

    Its variables are known if the simulation is available on this machine, or from a server that announces it
    on the broker; otherwise from the experiment.

    Args:
        experiment: its simulation, parameters, sensors, actuators and requirements.
        address: address of the servers.
        agents: number of agents with variables; default: derived.

    Raises:
        InputError: sensors, actuators or agents are unknown, or parameters are invalid.

    """
    simulation, parameters = experiment.simulation, experiment.parameters
    base = {name: value for name, value in parameters.items() if name != "seed"}
    seed = int(parameters.get("seed", 0)) % 2**64
    period = 1.0
    groups: Sequence[DeclaredGroup] = ()
    ranges: dict[str | None, Mapping[str, Any]] = {}
    if catalogue.has_description(simulation):
        groups = catalogue.groups(simulation, dict(parameters))
        description: Mapping[str, Any] = catalogue.description(simulation, dict(parameters))
        limited = catalogue.find_built_in(simulation) is not None
        simulation_parameters = collect_parameters(description, base, have_limits=limited)
        names: list[str | None] = [group.name for group in groups]
        ranges.update(catalogue.ranges_by_group(simulation, dict(parameters), names or [None]))
    else:
        description = _find_description(experiment, address)
        declared = {"parameters": {name: _declaration_of_value(value) for name, value in base.items()}}
        simulation_parameters = collect_parameters(declared, base, have_limits=False)
    if catalogue.is_local(simulation) and description["actuators"]:
        agent_count, _, period = measure_start(
            catalogue.make_playable(simulation),
            base,
            seed,
            int(description["actuators"]),
            catalogue.step_seconds(simulation),
        )
        agents = agent_count if agents is None else agents
    if agents is None:
        agents = _agents(experiment, description)
    check_size(simulation, agents, description)
    return Model(
        catalogue.title(simulation),
        description,
        base,
        seed,
        agents,
        period,
        parameters=[*_connection(catalogue.title(simulation), address), *simulation_parameters],
        dimensions=experiment.requirements.dimensions,
        groups=groups,
        ranges=ranges,
    )


def _find_description(experiment: Experiment, address: Address) -> dict[str, Any]:
    """Return a description from the experiment and, if it is incomplete, from a server."""
    title, announced = experiment.simulation, {}
    if experiment.sensors is None or experiment.actuators is None:
        try:
            with engine_errors():
                servers = _engine.servers(address.broker, prefix=address.prefix, wait=_ANNOUNCEMENT_WAIT_S)
        except _engine.NoBrokerError as error:
            raise InputError(f"{_unknown(experiment)}, and servers cannot be reached: {error}") from None
        for server in servers:
            if title in server["simulations"] and address.server in (None, server["server"]):
                announced = server["capabilities"].get("swarmwright", {})
                break
    numbers = {
        name: announced.get(name) if number is None else number
        for name, number in (("sensors", experiment.sensors), ("actuators", experiment.actuators))
    }
    for name, number in numbers.items():
        if number is None:
            raise InputError(
                f"{_unknown(experiment, name)}, and no server on {address.broker} announces them; set "
                "'sensors' and 'actuators' in an experiment file, or with --set sensors=N --set actuators=N"
            )
    metrics = {name: {"unit": "", "description": ""} for name in announced.get("metrics", [])}
    return {**numbers, "sensor_names": [], "actuator_names": [], "sensor_units": [], "actuator_units": [],
            "metrics": metrics, "max_agents": None}  # fmt: skip


def _unknown(experiment: Experiment, name: str = "sensors") -> str:
    return (
        f"{place_of(experiment, 'simulation')}the number of {name} is unknown, because "
        f"{experiment.simulation!r} is not built in"
    )


def _declaration_of_value(value: Any) -> dict[str, Any]:  # noqa: ANN401 - any value of a file
    """Return the declaration of a parameter whose value is known."""
    kinds = {bool: "boolean", int: "integer", float: "number", str: "string"}
    return {"type": kinds.get(type(value), "object"), "default": value, "description": "Of the simulation."}


def _agents(experiment: Experiment, description: Mapping[str, Any]) -> int:
    for name in _AGENTS:
        value = experiment.parameters.get(name)
        if isinstance(value, int) and not isinstance(value, bool) and value > 0:
            return value
    most = experiment.requirements.max_agents or description.get("max_agents")
    if most is None:
        raise InputError(
            f"the number of agents of {experiment.simulation!r} is unknown; set it with --agents"
        )
    return int(most)


def _connection(title: str, address: Address) -> list[Parameter]:
    """Return the parameters of the connection."""
    texts = {
        "broker": (address.broker, ("URL of the broker: mqtt://, mqtts://, ws:// or wss://HOST:PORT, or "
                   "unix:///PATH; several of a cluster, separated by commas.")),
        "prefix": (address.prefix, "Prefix of all topics; empty for none."),
        "username": ("", "Account at the broker; empty: SWARMWRIGHT_USERNAME of the environment."),
        "passwordFile": ("", ("File whose first line is the password; empty: SWARMWRIGHT_PASSWORD or "
                         "SWARMWRIGHT_PASSWORD_FILE of the environment.")),
        "caFile": ("", ("Certificate authority, PEM, for mqtts and wss; empty: SWARMWRIGHT_CA_FILE of the "
                   "environment, or the system's. A client certificate is taken from the environment alone: "
                   "SWARMWRIGHT_CERTIFICATE_FILE and SWARMWRIGHT_KEY_FILE.")),
        "simulation": (title, "Title of the simulation, by which servers are found."),
    }  # fmt: skip
    seconds = {
        "discoveryTimeout": (address.discovery_s, "Seconds for which a free server is looked for."),
        "stepTimeout": (address.step_s, "Seconds that a server may take for a step."),
        "gatherTime": (0.1, ("Seconds for which further agents of a step are waited for, where the server "
                       "implements D6.1 alone and not all agents of the last step have answered.")),
    }  # fmt: skip
    server = -1 if address.server is None else address.server
    return [
        *(Parameter(f"{CONNECTION}{name}", "text", *about) for name, about in texts.items()),
        Parameter(f"{CONNECTION}server", "integer", server, "Id of the only server to be used; -1 for any."),
        *(Parameter(f"{CONNECTION}{name}", "number", *about, unit="s") for name, about in seconds.items()),
    ]


FILE = Path(__file__).parents[1] / "simulations" / "fmu" / "libswarmwright_fmi.so"
"""The library; its source is the crate engine/bindings/fmi."""
_CHECKOUT = Path(__file__).parents[3]
_LINES = 5
"""Lines of the output of a failed build in messages; the last lines name the cause."""
_progress = logging.getLogger("swarmwright.progress")


def read_library() -> bytes:
    """Read the library; compile it first if necessary.

    Raises InputError if it is missing and there is no source, and RunError if the compilation fails.
    """
    try:
        return FILE.read_bytes()
    except FileNotFoundError:
        _build_library()
    return FILE.read_bytes()


def _build_library() -> None:
    """Compile the library as `make` does. Raises InputError and RunError."""
    if not (_CHECKOUT / "engine" / "bindings" / "fmi" / "Cargo.toml").is_file():
        raise InputError(f"{FILE}: the library of FMUs of simulations is missing; reinstall Swarmwright")
    _progress.info("compiling the library of FMUs of simulations, once; this may take a minute")
    # Variables of a `make` that started this process.
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    try:
        done = subprocess.run(
            ["make", "--no-print-directory", "fmi"],
            cwd=_CHECKOUT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            check=False,
        )
    except FileNotFoundError as error:
        raise RunError(
            f"{FILE}: cannot be compiled: `make` not found; install it, or install Swarmwright from a wheel"
        ) from error
    if done.returncode or not FILE.exists():
        output = "; ".join(escape_line(line) for line in done.stdout.splitlines()[-_LINES:] if line.strip())
        raise RunError(f"{FILE}: cannot be compiled: `make fmi` failed: {output or 'it printed nothing'}")


LIBRARY = FILE
"""The library of FMUs of simulations."""
LICENSES = Path(__file__).parents[1] / "third-party-licenses.txt"
"""Licences of the crates of the library."""
VERSIONS = ("2.0", "3.0")
_MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_FMI2_TYPES = {
    "single": "Real",
    "double": "Real",
    "integer": "Integer",
    "seed": "Integer",
    "flag": "Boolean",
    "text": "String",
}
_FMI3_TYPES = {
    "single": "Float32",
    "double": "Float64",
    "integer": "Int64",
    "seed": "UInt64",
    "flag": "Boolean",
    "text": "String",
}
_STATES = {
    True: "To set a state repeats the steps of the episode up to it.",
    False: "The server is looked for when initialization ends, and is free again after a reset, at the end "
    "and when the instance is freed. States cannot be kept. Fitness and metrics are known when the episode "
    "has ended, and NaN before.",
}
"""Notes on states, by whether the FMU contains the simulation."""


def build_simulation_fmu(title: str, parameters: Mapping[str, Any], *, fmi: str, name: str) -> bytes:
    """Return an FMU of a built-in simulation, the same bytes for the same simulation and library.

    Args:
        title: title of the simulation.
        parameters: values of parameters; others have their defaults.
        fmi: 2.0 or 3.0.
        name: name of the model and its library, a letter, then letters, digits and _.

    Raises InputError for an unknown simulation, invalid parameters, and a missing library.
    """
    return build_model_fmu(Model.from_simulation(title, parameters), fmi=fmi, name=name)


def build_model_fmu(model: Model, *, fmi: str, name: str) -> bytes:
    """Return an FMU of a model, see `build_simulation_fmu`. Raises InputError if the library is missing."""
    check_prefix(name)
    binary = read_library()
    content = json.dumps(model.content(""), sort_keys=True)
    identifier = token(fmi, name, content, binary)
    archive_files: Files = {
        "modelDescription.xml": _description(model, fmi, name, identifier),
        "documentation/index.html": _documentation(model, fmi, name),
        "documentation/licenses/license.txt": _licenses(),
        "resources/model.json": json.dumps(model.content(identifier), indent=1, sort_keys=True),
        _library_path(fmi, name): binary,
    }
    return zip_files(archive_files)


def _licenses() -> bytes:
    """Return the licences of the library in the FMU. Raises InputError if they are missing."""
    try:
        return LICENSES.read_bytes()
    except OSError:
        raise InputError(
            f"{LICENSES}: the licences of the library in the FMU are missing; run `make .venv/.engine`"
        ) from None


def _library_path(fmi: str, name: str) -> str:
    """Return the path of the library in the archive. Raises InputError on other systems than Linux."""
    machine = _MACHINES.get(platform.machine().lower())
    if machine is None or not sys.platform.startswith("linux"):
        raise InputError(
            f"{platform.system()} on {platform.machine()}: FMUs are supported on Linux on x86_64 and aarch64 "
            "only"
        )
    if fmi == "3.0":
        return f"binaries/{machine}-linux/{name}.so"
    # FMI 2.0 names 32 and 64 bits only.
    return f"binaries/linux64/{name}.so"


def _description(model: Model, fmi: str, name: str, identifier: str) -> str:
    """Return modelDescription.xml."""
    from swarmwright import __version__  # noqa: PLC0415 - asks the engine

    three = fmi == "3.0"
    variables = list(model.variables())
    keeps_state = model.dimensions is None
    root, _ = start_description(fmi, name, identifier, _describe_model(model), keeps_state=keeps_state)
    scales = [
        unit_name(variable.stands_for.unit) for variable in variables if variable.stands_for is not None
    ]
    add_units(root, sorted({"s", *filter(None, (*scales, *(variable.unit for variable in variables)))}))
    categories = ET.SubElement(root, "LogCategories")
    for category in ("logStatusDiscard", "logStatusError"):
        ET.SubElement(categories, "Category", name=category)
    times = {"startTime": "0", "stepSize": repr(model.period)}
    if model.duration is not None:
        times["stopTime"] = repr(model.duration)
    ET.SubElement(root, "DefaultExperiment", times)
    listed = ET.SubElement(root, "ModelVariables")
    if three:
        entry = {"name": "time", "valueReference": "0", "causality": "independent"}
        ET.SubElement(listed, "Float64", {**entry, "variability": "continuous", "unit": "s"})
    for variable in variables:
        (_add_fmi3_variable if three else _add_fmi2_variable)(listed, variable)
    _add_structure(ET.SubElement(root, "ModelStructure"), variables, three=three)
    return format_xml(root, comment=f"{MARK} {__version__}; changes here are lost.")


def _describe_model(model: Model) -> str:
    if model.dimensions is None:
        return f"The simulation {model.title} of Swarmwright"
    return f"The simulation {model.title} on a simulation server, reached through an MQTT broker"


def _variable_attributes(variable: Variable) -> dict[str, str]:
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "causality": variable.causality,
    }
    attributes |= {"variability": "fixed" if variable.causality == "parameter" else "discrete"}
    if variable.causality == "output":
        attributes["initial"] = "calculated"
    return {**attributes, "description": variable.description}


def _limits(variable: Variable) -> dict[str, str]:
    attributes = {"unit": variable.unit} if variable.unit else {}
    limits = zip(("min", "max"), variable.range, strict=True)
    return attributes | {name: repr(value) for name, value in limits if value is not None}


def _start(value: float | bool | str) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _add_fmi2_variable(listed: ET.Element, variable: Variable) -> None:
    element = ET.SubElement(listed, "ScalarVariable", _variable_attributes(variable))
    start = {} if variable.start is None else {"start": _start(variable.start)}
    ET.SubElement(element, _FMI2_TYPES[variable.kind], {**_limits(variable), **start})
    if variable.stands_for is not None:
        add_range(element, variable.stands_for, "2.0")


def _add_fmi3_variable(listed: ET.Element, variable: Variable) -> None:
    kind = _FMI3_TYPES[variable.kind]
    if kind == "String":
        element = ET.SubElement(listed, kind, _variable_attributes(variable))
        ET.SubElement(element, "Start", value=str(variable.start))
        return
    start = {} if variable.start is None else {"start": _start(variable.start)}
    element = ET.SubElement(listed, kind, {**_variable_attributes(variable), **_limits(variable), **start})
    if variable.stands_for is not None:
        add_range(element, variable.stands_for, "3.0")


def _add_structure(structure: ET.Element, variables: list[Variable], *, three: bool) -> None:
    """Add outputs, all of which are also initial unknowns."""
    outputs = [
        (index, variable) for index, variable in enumerate(variables) if variable.causality == "output"
    ]
    for group, element in (("Outputs", "Output"), ("InitialUnknowns", "InitialUnknown")):
        parent = structure if three else ET.SubElement(structure, group)
        for index, output in outputs:
            if three:
                ET.SubElement(parent, element, valueReference=str(output.reference))
            else:  # index of the variable, from 1
                ET.SubElement(parent, "Unknown", index=str(index + 1))


def _documentation(model: Model, fmi: str, name: str) -> str:
    rows = "\n".join(
        f"<tr><td>{escape(variable.name)}</td><td>{variable.causality}</td><td>{escape(variable.unit)}</td>"
        f"<td>{escape(variable.description)}</td></tr>"
        for variable in model.variables()
        if not variable.name.startswith("agent[") or variable.name.startswith("agent[1]")
    )
    values = {
        "p": escape(name), "fmi": fmi, "title": escape(model.title), "rows": rows,
        "agents": str(model.agents), "period": repr(model.period),
        "about": _describe_model(model), "states": _STATES[model.dimensions is None],
    }  # fmt: skip
    return render("fmu_simulation.txt", values)
