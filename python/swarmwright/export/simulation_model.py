"""Variables of FMUs of simulations, with the value references of `engine/bindings/fmi`."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from swarmwright import _engine
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.ranges import Range, ranges_of
from swarmwright.common.suggestions import did_you_mean
from swarmwright.export.fmu_parts import name_variables, unit_name
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
