"""Episodes of a command that is stepped over its standard input and output."""

import json
import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.simulations.command.failure import CommandFailure
from swarmwright.simulations.command.output import Printed
from swarmwright.simulations.command.process import Processes
from swarmwright.simulations.command.running import Limits
from swarmwright.simulations.command.stepwise import Dialogue, Start
from swarmwright.simulations.fitness import OWN


class SteppedEpisodes:
    """The episode under way, and the process that runs it.

    Args:
        start: called before a process is started.
        limits: of an episode.
        recycle: episodes of a process; 0 for any number.
        metrics: names that the last answer of an episode must have.
    """

    def __init__(
        self, start: Callable[[], Start], limits: Limits, recycle: int, metrics: Collection[str]
    ) -> None:
        self._start, self._limits, self._recycle, self._metrics = start, limits, recycle, metrics
        self._processes: Processes | None = None
        self._dialogue: Dialogue | None = None
        self.done = False
        """Whether the episode has ended."""
        self.acting: ArrayLike | None = None
        """The agents that act next; None for all."""
        self.measured: dict[str, float] = {}
        """Metrics of the episode that has ended, and its fitness where the command says it."""

    def reset(self, processes: Processes, parameters: Mapping[str, Any], seed: int) -> ArrayLike | None:
        """Begin an episode; return the sensors of all agents, (agents, sensors), or None when it has ended.

        processes: which start the command; others than before when those have ended.

        Raises CommandFailure for any failure, as `step`; the command is then ended.
        """
        if self._dialogue is None or processes is not self._processes:
            self._processes = processes
            self._dialogue = Dialogue(processes, self._start, self._limits, self._recycle)
        self.measured = {}
        return self._taken(self._dialogue.reset(parameters, seed))

    def step(self, actions: NDArray[np.float32]) -> ArrayLike | None:
        """Advance by one step; return the sensors as `reset`."""
        assert self._dialogue is not None
        return self._taken(self._dialogue.ask({"actuators": actions.tolist()}))

    def abandon(self) -> Printed:
        """End the command, whose state is unknown; return what it has printed."""
        if self._dialogue is None:
            return Printed(0)
        self._dialogue.abandon()
        return self._dialogue.printed

    def _taken(self, answer: Mapping[str, Any]) -> ArrayLike | None:
        """Take in an answer; return the sensors in it."""
        self.done = answer.get("done") is True
        self.acting = answer.get("acting")
        if self.done:
            self.measured = self._results(answer)
        elif "sensors" not in answer:
            raise CommandFailure(f"answered {json.dumps(answer)[:80]}, which has neither sensors nor done")
        return answer.get("sensors")

    def _results(self, answer: Mapping[str, Any]) -> dict[str, float]:
        """Return fitness and declared metrics, which may be NaN or infinite, of an episode's last answer."""
        reported = answer.get("metrics") or {}
        if not isinstance(reported, Mapping):
            raise CommandFailure(f"metrics is {json.dumps(reported)[:40]}, expected {{NAME: NUMBER, ..}}")
        found = {name: reported[name] for name in self._metrics if name in reported}
        if OWN in answer or OWN in reported:
            found[OWN] = answer.get(OWN, reported.get(OWN))
        for name in self._metrics:
            if name not in found:
                there = ", ".join(reported) or "none"
                raise CommandFailure(f"ended the episode without the metric {name!r}; available: {there}")
        for name, value in found.items():
            if not isinstance(value, bool | int | float) or (name == OWN and isinstance(value, bool)):
                raise CommandFailure(f"{name} is {json.dumps(value)[:40]}, expected a number")
        return {name: _float(value) for name, value in found.items()}


def _float(number: float) -> float:
    try:
        return float(number)
    except OverflowError:  # of a whole number
        return math.inf if number > 0 else -math.inf
