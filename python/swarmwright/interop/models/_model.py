"""A model, combined from the parts of its files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from swarmwright.common.errors import InputError
from swarmwright.controllers.scxml import StateMachine
from swarmwright.interop.models._names import SimulationParameters
from swarmwright.interop.models._parts import Member, OptimisedParameter, Part, Property


@dataclass(frozen=True)
class Model:
    """The combined content of a model's files."""

    parts: list[Part]

    @classmethod
    def from_parts(cls, parts: list[Part]) -> Self:
        """Combine parts. Raises InputError without parts, or if files overlap or contradict each other."""
        if not parts:
            raise InputError("no files; name at least one file of a model")
        first: dict[str, Path] = {}
        problems = []
        for part in parts:
            for words in part.describe_contents():
                if words in first:
                    problems.append(
                        f"{part.path}: {words} is also described by {first[words]}; remove one of the files"
                    )
                first.setdefault(words, part.path)
        model = cls(parts)
        problems += model._find_contradictions()
        if problems:
            raise InputError("\n".join(problems))
        return model

    def _find_contradictions(self) -> list[str]:
        problems = []
        for name in ("sensors", "actuators"):
            counted = [(part, getattr(part, name)) for part in self.parts if getattr(part, name) is not None]
            for part, number in counted[1:]:
                before, expected = counted[0]
                if number != expected:
                    problems.append(f"{part.path}: has {number} {name}, but {before.path} has {expected}")
        return problems

    def _collect(self, name: str) -> list[Any]:
        return [item for part in self.parts for item in getattr(part, name)]

    def _first_value(self, name: str) -> Any:  # noqa: ANN401 - of the field's type
        return next((value for part in self.parts if (value := getattr(part, name)) is not None), None)

    @property
    def titles(self) -> list[str]:
        """Candidate names of the simulation."""
        return self._collect("titles")

    @property
    def properties(self) -> list[Property]:
        """Parameters with a fixed value."""
        return self._collect("properties")

    @property
    def optimised(self) -> list[OptimisedParameter]:
        """Parameters to optimise."""
        return self._collect("optimised")

    @property
    def members(self) -> list[Member]:
        """Kinds of agents."""
        return self._collect("members")

    @property
    def has_groups(self) -> bool:
        """Whether the kinds of agents differ in sensors or actuators."""
        return any(part.has_groups for part in self.parts)

    @property
    def sensors(self) -> int | None:
        """Number of sensor values of an agent."""
        number: int | None = self._first_value("sensors")
        return number

    @property
    def actuators(self) -> int | None:
        """Number of actuator values of an agent."""
        number: int | None = self._first_value("actuators")
        return number

    @property
    def behaviour(self) -> StateMachine | None:
        """The state machine of the agents."""
        machine: StateMachine | None = self._first_value("behaviour")
        return machine

    @property
    def sensor_names(self) -> list[str]:
        """Names of sensors, in order; empty if no file has them."""
        return self._collect("sensor_names")

    @property
    def actuator_names(self) -> list[str]:
        """Names of actuators, in order; empty if no file has them."""
        return self._collect("actuator_names")

    def file_of(self, words: str) -> Path:
        """Return the file with a content, see `Part.describe_contents`."""
        return next(part.path for part in self.parts if words in part.describe_contents())

    def check_numbers(self, simulation: SimulationParameters) -> None:
        """Raise InputError unless the simulation has the same numbers of sensors and actuators."""
        if simulation.description is None or simulation.description.get("varies"):
            return
        problems = []
        for part in self.parts:
            for name in ("sensors", "actuators"):
                number, expected = getattr(part, name), simulation.description.get(name)
                if number is not None and expected is not None and number != expected:
                    problems.append(
                        f"{part.path}: has {number} {name}, but {simulation.simulation} has {expected}"
                    )
        if problems:
            raise InputError("\n".join(problems))
