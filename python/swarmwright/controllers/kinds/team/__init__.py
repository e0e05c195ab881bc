"""Teams: groups of agents with different controllers, all encoded in one genome.

A genome is the genomes of the groups, one after another, as in heterogeneous teams with one chromosome
(Bongard, "The legion system", EuroGP 2000; D6.1, section 8).
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, PrivateAttr, ValidationInfo, model_validator

from swarmwright.common.arrays import Genome, Genomes, Limits
from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.options import Options
from swarmwright.common.problems import FieldError
from swarmwright.common.random_numbers import Stream
from swarmwright.common.suggestions import did_you_mean, unknown_key
from swarmwright.common.yaml import Path_
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.controllers._base import Representation, RepresentationOptions
from swarmwright.controllers.kinds import describe_controller
from swarmwright.controllers.teams import TEAM

_DEFAULT_KIND = "layered"
_LARGEST_COUNT = 1_000_000
"""Largest number of agents, sensors or actuators of a group."""

_GROUPS: Path_ = ("controller", "groups")


class GroupOptions(Options):
    """Agents with the same controller: options of their representation, and their number and sizes."""

    model_config = ConfigDict(extra="allow")

    kind: str = _DEFAULT_KIND
    """The representation of the group's controllers; its options are further keys of the group."""
    agents: int | None = Field(default=None, ge=0, le=_LARGEST_COUNT)
    """Number of agents. Only for simulations that do not declare groups; without it, the last group has all
    other agents."""
    sensors: int | None = Field(default=None, ge=1, le=_LARGEST_COUNT)
    """Sensor values of an agent. Only for simulations that do not declare groups; default: the
    number that servers announce for all agents."""
    actuators: int | None = Field(default=None, ge=1, le=_LARGEST_COUNT)
    """Actuator values of an agent; like `sensors`."""
    _options: Any = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _check_options(self, info: ValidationInfo) -> "GroupOptions":
        if self.kind == Team.kind:
            raise ValueError("teams cannot be nested; put all groups into one team")
        try:
            component = REPRESENTATIONS.get(self.kind)
        except InputError as error:
            raise ValueError(str(error)) from None
        if not component.steers:
            raise ValueError(f"{self.kind} steers no agents; use a kind of controller such as layered")
        values = {"kind": self.kind, **(self.model_extra or {})}
        keys = [*type(self).model_fields, *component.options_model.model_fields]
        for key in self.model_extra or {}:
            if key not in keys:
                raise FieldError((key,), unknown_key(key, dict.fromkeys(keys)))
        options = component.options_model.model_validate(values, context=info.context)
        if getattr(options, "in_python", False):
            raise ValueError("teams do not support modules in Python; use built-in modules")
        self._options = options  # type: ignore[misc] # a private attribute
        self.__pydantic_extra__ = options.model_dump(exclude={"kind"}, exclude_none=True)
        return self

    @property
    def options(self) -> RepresentationOptions:
        """The options of the representation."""
        options: RepresentationOptions = self._options
        return options


class TeamOptions(RepresentationOptions):
    """Several kinds of agents, each with its own sensors, actuators and controller; one genome for all."""

    kind: Literal["team"] = "team"
    groups: dict[str, GroupOptions] = Field(min_length=1, max_length=256)
    """The controller of each group of agents by the group's name: {kind: layered, hidden: [8]}. Names and
    numbers of agents, sensors and actuators are those that the simulation declares; if it declares none,
    each group has agents, sensors and actuators beside its options, and takes agents in order from agent
    0.
    """


class Team(Representation):
    """A controller for each group of agents, all encoded in one genome.

    Genes: those of the groups, concatenated in the order of the simulation's groups; operators are those of
    the groups' representations, each on its part.

    Args:
        options: the groups, with sensors and actuators; see `with_groups`.
        sensors: largest number of sensor values of any agent.
        actuators: largest number of actuator values of any agent.

    Raises InputError if the largest group has other numbers.
    """

    kind: ClassVar[str] = "team"
    options_model = TeamOptions
    options: TeamOptions

    def __init__(self, options: RepresentationOptions, *, sensors: int, actuators: int) -> None:
        super().__init__(options, sensors=sensors, actuators=actuators)
        self.parts: dict[str, Representation] = {}
        """The representation of each group."""
        for name, group in self.options.groups.items():
            self.parts[name] = self._part(name, group)
        for noun in ("sensors", "actuators"):
            highest = max(getattr(part, noun) for part in self.parts.values())
            if highest != getattr(self, noun):
                raise FieldError(
                    _GROUPS,
                    f"groups have at most {highest} {noun}, but agents of the simulation have up to "
                    f"{getattr(self, noun)}",
                )
        self.continuous = all(part.continuous for part in self.parts.values())  # type: ignore[misc] # differs
        sizes = [part.genome_size for part in self.parts.values()]
        self._cuts = np.cumsum(sizes)[:-1].tolist()
        self._genes = sum(sizes)

    def _part(self, name: str, group: GroupOptions) -> Representation:
        component = REPRESENTATIONS.get(group.kind)
        sensors = self.sensors if group.sensors is None else group.sensors
        actuators = self.actuators if group.actuators is None else group.actuators
        try:
            return component(group.options, sensors=sensors, actuators=actuators)
        except FieldError as error:
            raise FieldError((*_GROUPS, name, *error.path[1:]), error.reason) from error
        except InputError as error:
            raise FieldError((*_GROUPS, name), str(error)) from error

    @property
    def genome_size(self) -> int:
        """Number of genes of all groups."""
        return self._genes

    @property
    def bounds(self) -> Limits:
        """Lowest and highest values of the groups' genes."""
        return self._limits([part.bounds for part in self.parts.values()])

    @property
    def initial_range(self) -> Limits:
        """Initial range of the groups' genes."""
        return self._limits([part.initial_range for part in self.parts.values()])

    def _limits(self, limits: list[Limits]) -> Limits:
        return np.concatenate([low for low, _ in limits]), np.concatenate([high for _, high in limits])

    def architecture(self) -> dict[str, Any]:
        """Return the specification of all controllers, without weights."""
        return {
            "version": 1,
            "kind": self.kind,
            "groups": [
                {
                    "name": name,
                    "agents": self.options.groups[name].agents,
                    "controller": part.architecture(),
                }
                for name, part in self.parts.items()
            ],
        }

    def weights(self, genomes: Genomes) -> NDArray[np.float32]:
        """Return the weights of the groups' controllers, one group after another."""
        pairs = zip(self.parts.values(), self._split(genomes), strict=True)
        parts = [part.weights(np.ascontiguousarray(rows)) for part, rows in pairs]
        return np.ascontiguousarray(np.concatenate(parts, axis=1), dtype=np.float32)

    def initial(self, stream: Stream) -> Genome:
        """Return random genomes of the groups."""
        return np.concatenate([part.initial(stream) for part in self.parts.values()])

    def mutate(self, genome: Genome, stream: Stream, *, severity: float, probability: float) -> Genome:
        """Return a copy in which each group's genes were mutated."""
        pairs = zip(self.parts.values(), self._split(genome), strict=True)
        return np.concatenate(
            [part.mutate(genes, stream, severity=severity, probability=probability) for part, genes in pairs]
        )

    def crossover(self, mother: Genome, father: Genome, stream: Stream) -> Genome:
        """Return a child in which each group's genes are crossed."""
        pairs = zip(self.parts.values(), self._split(mother), self._split(father), strict=True)
        return np.concatenate([part.crossover(first, second, stream) for part, first, second in pairs])

    def distance(self, genome: Genome, other: Genome) -> float:
        """Return the sum of the groups' distances."""
        pairs = zip(self.parts.values(), self._split(genome), self._split(other), strict=True)
        return sum(part.distance(first, second) for part, first, second in pairs)

    def likeness(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return features for comparing genomes, group after group."""
        pairs = zip(self.parts.values(), self._split(genomes), strict=True)
        return np.concatenate([part.likeness(np.ascontiguousarray(rows)) for part, rows in pairs], axis=1)

    def _split(self, genomes: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        return np.split(genomes, self._cuts, axis=-1)


def with_groups(options: TeamOptions, declared: Sequence[DeclaredGroup], simulation: str) -> TeamOptions:
    """Return the options with the agents, sensors and actuators that a simulation declares, in its order.

    A run stores all of them; its number of agents follows the parameters when these change.

    Args:
        options: as they are in the experiment.
        declared: the groups of the simulation.
        simulation: its title, for messages.

    Raises FieldError, `controller.groups[.NAME[.KEY]]: ...`, for unknown groups, missing groups, and keys
    that contradict the simulation.
    """
    names = [group.name for group in declared]
    for name in options.groups:
        if name not in names:
            hint = did_you_mean(name, names)
            listing = f"; the groups of {simulation} are {', '.join(names)}"
            raise FieldError((*_GROUPS, name), f"unknown group{hint or listing}")
    missing = [name for name in names if name not in options.groups]
    if missing:
        raise FieldError(
            _GROUPS,
            f"{', '.join(missing)} missing; add a controller for each group of {simulation}: "
            f"{', '.join(names)}",
        )
    groups: dict[str, GroupOptions] = {}
    for declaration in declared:
        options_of_group = options.groups[declaration.name]
        stored = None not in (options_of_group.agents, options_of_group.sensors, options_of_group.actuators)
        for key in ("sensors", "actuators") if stored else ("agents", "sensors", "actuators"):
            value, announced_value = getattr(options_of_group, key), getattr(declaration, key)
            if value is not None and value != announced_value:
                raise FieldError(
                    (*_GROUPS, declaration.name, key),
                    f"{simulation} has {announced_value}, not {value}; remove the key",
                )
        announced = {
            "agents": declaration.agents,
            "sensors": declaration.sensors,
            "actuators": declaration.actuators,
        }
        groups[declaration.name] = options_of_group.model_copy(update=announced)
    return options.model_copy(update={"groups": groups})


def check_counts(options: TeamOptions) -> None:
    """Check that every group but the last has `agents`, for simulations that do not declare groups.

    Raises FieldError, `controller.groups.NAME.agents: ...`.
    """
    for name in list(options.groups)[:-1]:
        if options.groups[name].agents is None:
            raise FieldError(
                (*_GROUPS, name, "agents"),
                "missing; the simulation does not declare groups, and only the last group can omit its "
                "number of agents",
            )


def largest_number(options: TeamOptions, noun: Literal["sensors", "actuators"]) -> int | None:
    """Return the largest number of sensors or actuators of a group; None if unknown."""
    values = [getattr(group, noun) for group in options.groups.values()]
    return None if None in values else max(values)


def describe(specification: Mapping[str, Any]) -> str:
    """Describe the controller of each group."""
    if not isinstance(specification.get("groups"), list):
        return TEAM
    groups = (
        f"{group['name']}: {describe_controller(group['controller'])}" for group in specification["groups"]
    )
    return f"{TEAM} of {'; '.join(groups)}"
