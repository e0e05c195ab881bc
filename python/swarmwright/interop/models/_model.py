"""The parts of a model together, and whether they contradict each other."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from swarmwright.common.errors import InputError
from swarmwright.controllers.scxml import StateMachine
from swarmwright.interop.models._names import Known
from swarmwright.interop.models._parts import Member, Optimised, Part, Property


@dataclass(frozen=True)
class Model:
    """What all files of a model say."""

    parts: list[Part]

    @classmethod
    def of(cls, parts: list[Part]) -> Self:
        """Return the model. Raises InputError when there is none, or two files describe the same thing."""
        if not parts:
            raise InputError("name at least one file of a model")
        first: dict[str, Path] = {}
        problems = []
        for part in parts:
            for words in part.contents():
                if words in first:
                    problems.append(
                        f"{part.path}: describes {words}, as {first[words]} does; leave one of them out"
                    )
                first.setdefault(words, part.path)
        model = cls(parts)
        problems += model._differing()
        if problems:
            raise InputError("\n".join(problems))
        return model

    def _differing(self) -> list[str]:
        problems = []
        for what in ("sensors", "actuators"):
            counted = [(part, getattr(part, what)) for part in self.parts if getattr(part, what) is not None]
            for part, number in counted[1:]:
                before, expected = counted[0]
                if number != expected:
                    problems.append(f"{part.path}: has {number} {what}, but {before.path} has {expected}")
        return problems

    def _all(self, name: str) -> list[Any]:
        return [item for part in self.parts for item in getattr(part, name)]

    def _only(self, name: str) -> Any:  # noqa: ANN401 - of the field's type
        return next((value for part in self.parts if (value := getattr(part, name)) is not None), None)

    @property
    def titles(self) -> list[str]:
        """Names by which the simulation may be known."""
        return self._all("titles")

    @property
    def properties(self) -> list[Property]:
        """Parameters with one value."""
        return self._all("properties")

    @property
    def optimised(self) -> list[Optimised]:
        """Parameters that are optimised."""
        return self._all("optimised")

    @property
    def members(self) -> list[Member]:
        """Kinds of agents."""
        return self._all("members")

    @property
    def differ(self) -> bool:
        """Whether the kinds of agents have different sensors or actuators."""
        return any(part.differ for part in self.parts)

    @property
    def sensors(self) -> int | None:
        """Numbers that an agent senses."""
        number: int | None = self._only("sensors")
        return number

    @property
    def actuators(self) -> int | None:
        """Numbers that steer an agent."""
        number: int | None = self._only("actuators")
        return number

    @property
    def behaviour(self) -> StateMachine | None:
        """The state machine that agents follow."""
        machine: StateMachine | None = self._only("behaviour")
        return machine

    @property
    def sensor_names(self) -> list[str]:
        """Names of sensors, in their order; empty where no file has them."""
        return self._all("sensor_names")

    @property
    def actuator_names(self) -> list[str]:
        """Names of actuators, in their order; empty where no file has them."""
        return self._all("actuator_names")

    def file_of(self, words: str) -> Path:
        """Return the file that describes something, see `Part.contents`."""
        return next(part.path for part in self.parts if words in part.contents())

    def check_numbers(self, known: Known) -> None:
        """Raise InputError when the simulation has other numbers of sensors or actuators."""
        if known.description is None or known.description.get("varies"):
            return
        problems = []
        for part in self.parts:
            for what in ("sensors", "actuators"):
                number, expected = getattr(part, what), known.description.get(what)
                if number is not None and expected is not None and number != expected:
                    problems.append(
                        f"{part.path}: has {number} {what}, but {known.simulation} has {expected}"
                    )
        if problems:
            raise InputError("\n".join(problems))
