"""What an FMU of a simulation holds: its variables, with the value references of `engine/bindings/fmi`."""

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
from swarmwright.export.fmu_parts import named, unit_name
from swarmwright.simulations import catalogue
from swarmwright.simulations.physics import AnyHost

Kind = Literal["number", "integer", "flag", "text", "json"]
TIME, SEED, DONE, FITNESS = range(4)
_FIRST_PARAMETER = 100
_FIRST_METRIC = 10_000
_FIRST_AGENT = 100_000
_MOST_VARIABLES = 200_000
_LARGEST_INTEGER = 2**31 - 1
"""Of FMI 2.0's type Integer."""
_UNITS = {"metres": "m", "seconds": "s", "radians": "rad", "metres per second": "m/s"}
"""Words of simulations, as FMUs name them."""
_UNIT = re.compile(rf"\b({'|'.join(sorted(_UNITS, key=len, reverse=True))})\b")
_NUMBER = r"-?\d(?:[\d,.]*\d)?"
_LIMITS = re.compile(rf"(?<![\w.])({_NUMBER}) to ({_NUMBER})(?!\w)")
_AT_LEAST = re.compile(rf"\bat least ({_NUMBER})(?!\w)")
"""How descriptions of the parameters of built-in simulations give limits, and a lower limit alone."""
_STEP_LIMITS = {"emergency_exit": "steps", "minisim": "maxSteps"}
"""Parameters that say after how many steps an episode ends."""
_TICK_S = 0.1
"""Of the arena."""

Limits = tuple[float | None, float | None]
"""Smallest and largest value, None where there is none."""


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
    """What -1 and 1 stand for; None where it is not scaled."""


@dataclass(frozen=True)
class Parameter:
    """A parameter that masters can set."""

    name: str
    kind: Kind
    start: float | int | bool | str
    description: str
    unit: str = ""
    range: Limits = (None, None)


class Start(NamedTuple):
    """What is known of an episode after its first step."""

    agents: int
    """How many act."""
    turns: int
    """How many steps of an FMU it takes: 1, or the number of agents where they act in turn."""
    period: float
    """Seconds of a step of the FMU."""


@dataclass(frozen=True)
class Model:
    """A simulation with parameters: built in, or behind a broker."""

    title: str
    description: Mapping[str, Any]
    """See `catalogue.description`."""
    base: Mapping[str, Any]
    """Parameters that are set, without the seed."""
    seed: int
    agents: int
    period: float
    """Seconds of a step."""
    duration: float | None = None
    """Seconds after which every episode with these parameters has ended; None where they are not known."""
    parameters: list[Parameter] = field(default_factory=list)
    dimensions: float | None = None
    """Of a proxy: number of spatial dimensions of the servers that are looked for."""
    groups: Sequence[DeclaredGroup] = ()
    """Kinds of agents in the order of the agents, where they differ."""
    ranges: Mapping[str | None, Mapping[str, Any]] = field(default_factory=dict)
    """What -1 and 1 of sensors and actuators stand for, see `catalogue.ranges`: by group, or all by None."""

    @classmethod
    def of(cls, title: str, parameters: Mapping[str, Any]) -> "Model":
        """Return the model of a built-in simulation.

        Raises InputError for another one, and for parameters that it does not have or refuses.
        """
        known = catalogue.titles()
        if title not in known:
            raise InputError(
                f"simulation {title}: an FMU holds a simulation that is built in, {', '.join(known)}"
                f"{did_you_mean(title, list(known)) or ''}"
            )
        base = {name: value for name, value in parameters.items() if name != "seed"}
        seed = int(parameters.get("seed", 0)) % 2**64
        description = catalogue.description(title, dict(parameters))
        for name in base:
            if name not in description["parameters"]:
                hint = did_you_mean(name, list(description["parameters"])) or ""
                raise InputError(f"parameters.{name}: {title} has no such parameter{hint}")
        start = started(
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
            parameters=_with_agents(parameters_of(description, base, have_limits=True), start.agents),
            groups=catalogue.groups(title, dict(parameters)),
        )

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics."""
        return list(self.description["metrics"])

    def content(self, token: str) -> dict[str, Any]:
        """Return what the library reads, `resources/model.json`."""
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
        """Give all variables, but for the time."""
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
        yield from self._of_agents()

    def _of_agents(self) -> Iterator[Variable]:
        most = {which: int(self.description[f"{which}s"]) for which in ("sensor", "actuator")}
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

    def _channels(self, which: str, group: DeclaredGroup | None) -> list[tuple[str, str, str, Range | None]]:
        """Return name, text and unit of an agent's sensors or actuators, and what -1 and 1 stand for."""
        if group is None:
            count = self.description[f"{which}s"]
            names, units = self.description[f"{which}_names"], self.description[f"{which}_units"]
        else:
            count, names, units = getattr(group, f"{which}s"), getattr(group, f"{which}_names"), ()
        texts = [str(name) for name in names]
        if len(texts) != count:
            texts = [f"{which} {index + 1}" for index in range(count)]
        known = [unit_of(unit) for unit in units] if len(units) == count else [""] * count
        given = self.ranges.get(None if group is None else group.name, {}).get(f"{which}_ranges", ())
        ranges = ranges_of(given, count) or (None,) * count
        about = [
            (unit, None) if limits is None else ("", limits._replace(unit=limits.unit or unit))
            for limits, unit in zip(ranges, known, strict=True)
        ]
        return [
            (name, text, *rest)
            for name, text, rest in zip(named(f"{which}s", texts), texts, about, strict=True)
        ]


def _words(stands_for: Range | None) -> str:
    return "" if stands_for is None else f", {stands_for.scaled_words}"


def unit_of(words: str) -> str:
    """Return a unit as FMUs name it: m for metres."""
    return _UNITS.get(words, unit_name(words))


def check_size(title: str, agents: int, description: Mapping[str, Any]) -> None:
    """Raise InputError where agents have more variables than an FMU may have."""
    variables = agents * (1 + description["sensors"] + description["actuators"])
    if variables > _MOST_VARIABLES:
        raise InputError(
            f"simulation {title}: {agents:,} agents make {variables:,} variables; an FMU has at most "
            f"{_MOST_VARIABLES:,}: take fewer agents"
        )


def parameters_of(
    description: Mapping[str, Any], base: Mapping[str, Any], *, have_limits: bool
) -> list[Parameter]:
    """Return the parameters of a description, with the values of `base`.

    have_limits: whether their descriptions say unit and range, as those of built-in simulations do.
    """
    parameters = [
        _parameter(name, about, base)
        for name, about in sorted(description["parameters"].items())
        if name != "seed"
    ]
    return [_with_limits(parameter) for parameter in parameters] if have_limits else parameters


def started(
    simulation: str | AnyHost,
    base: Mapping[str, Any],
    seed: int,
    actuators: int,
    step_seconds: float | None,
) -> Start:
    """Return what is known after the first step of an episode.

    step_seconds: None where the simulation has no physical time: then they are those for which it is shown.
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
    """Return the seconds after which any episode of a built-in simulation has ended; None where not known."""
    if title in _STEP_LIMITS:
        steps = int(parameters[_STEP_LIMITS[title]])
    else:
        seconds = parameters["duration"] or _mission_seconds(parameters["mission"])
        if seconds is None:
            return None
        steps = math.floor(seconds / _TICK_S + 0.5)
    return float(f"{steps * start.turns * start.period:.12g}")


def _mission_seconds(mission: Any) -> float | None:  # noqa: ANN401 - a name or an object
    """Return the duration of a mission of the arena; None for an object that does not say it."""
    if isinstance(mission, Mapping):
        return mission.get("duration")
    known = {entry[key]: entry["duration"] for entry in _engine.missions() for key in ("name", "also")}
    return known.get(mission)


def _with_limits(parameter: Parameter) -> Parameter:
    """Return a number with the unit and the range that its description says."""
    if parameter.kind not in ("integer", "number"):
        return parameter
    kind = int if parameter.kind == "integer" else float
    found = _LIMITS.search(parameter.description) or _AT_LEAST.search(parameter.description)
    numbers = [kind(number.replace(",", "")) for number in found.groups()] if found else []
    low, high = [*numbers, None, None][:2]
    # Of FMI's types only the real ones have a unit.
    unit = _UNIT.search(parameter.description) if parameter.kind == "number" else None
    return replace(parameter, unit=_UNITS[unit[1]] if unit else "", range=(low, high))


def _with_agents(parameters: Sequence[Parameter], agents: int) -> list[Parameter]:
    """Limit the numbers of agents to those that the FMU has variables for.

    agents: how many it has: defenders come after the others where controllers steer them, too.
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
