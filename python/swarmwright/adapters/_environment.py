"""What adapters of libraries of environments have in common."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright._errors import InputError
from swarmwright._own._base import Simulation


class Environment(Simulation):
    """An environment of another library as a simulation.

    Its parameters are what the environment's constructor takes; in an experiment they are set as any others,
    as long as they leave alone what agents sense and how they act. Those that do not belong to the name:
    `pettingzoo:mpe2.simple_spread_v3?N=5`.
    """

    environment: ClassVar[str] = ""
    """The environment, as its library names it."""
    options: ClassVar[Mapping[str, Any]] = {}
    """What its constructor gets; parameters of an experiment are added."""
    adapted: ClassVar[str] = ""
    """The name from which the class was made; empty for one that somebody wrote."""
    most_steps: ClassVar[int] = 10_000
    """An episode that the environment does not end is ended after so many."""

    def __init__(self) -> None:
        self.env: Any = None
        self._given: dict[str, Any] | None = None
        self._renew({})
        self.sensors, self.actuators = self._sizes()

    @abstractmethod
    def make(self, options: dict[str, Any]) -> Any:  # noqa: ANN401 - libraries' own types
        """Return a new environment. Raises any exception when there is none with these options."""

    @abstractmethod
    def _sizes(self) -> tuple[int, int]:
        """Read the spaces of the environment; return how many sensors and actuators an agent has."""

    def _renew(self, parameters: dict[str, Any]) -> bool:
        """Make the environment anew where parameters are others than before. Returns whether it was."""
        if parameters == self._given:
            return False
        label = f"{type(self).__name__} {self.environment}"
        try:
            made = self.make({**self.options, **parameters})
        except InputError:
            raise
        except Exception as error:  # libraries complain in their own ways
            where = f"{', '.join(parameters)}: {label}" if parameters else label
            raise InputError(f"{where}: {type(error).__name__}: {error}") from error
        if self.env is not None:
            self.env.close()
        self.env, self._given = made, dict(parameters)
        return True

    def _start(self, parameters: dict[str, Any]) -> None:
        """Be ready for an episode with these parameters. Raises InputError where they do not fit."""
        if not self._renew(parameters):
            return
        sizes = self._sizes()
        if sizes != (self.sensors, self.actuators):
            name, found = ", ".join(parameters), f"{sizes[0]} sensors and {sizes[1]} actuators"
            self._given = None
            raise InputError(
                f"{name}: with it agents have {found} instead of {self.sensors} and {self.actuators}; put it "
                f"into the simulation's name, as {self.environment}?{next(iter(parameters))}=.."
            )


def environment_seed(seed: int) -> int:
    """Return 32 bits of a seed, as many as all environments take; smaller ones stay as they are."""
    return (seed ^ seed >> 32) & 0xFFFF_FFFF


def total(rewards: NDArray[np.float64]) -> float:
    """Return the mean of rewards, in a fixed order."""
    return float(sum(rewards.tolist()) / len(rewards))
