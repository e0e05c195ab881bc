"""What callbacks have in common."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self

from swarmwright.common.arguments import function
from swarmwright.runs.optimization.generation import should_continue

if TYPE_CHECKING:
    from swarmwright.runs.optimization.generation import Generation
    from swarmwright.runs.run import Run


class Callback(ABC):
    """Called after each generation; a context manager that writes what is left when it ends."""

    @abstractmethod
    def __call__(self, generation: "Generation") -> None:
        """Take the figures of a generation."""

    @abstractmethod
    def conclude(self, run: "Run") -> None:
        """Take the finished run, if it finishes. Callers may omit it."""

    @abstractmethod
    def close(self) -> None:
        """Write what is left. May be called again."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def together(
    *callbacks: "Callable[[Generation], bool | None]",
) -> "Callable[[Generation], bool | None]":
    """Return a callback that calls all of these, in order; it ends the run when any of them does."""
    for callback in callbacks:
        function("callbacks", callback, ("generation",))

    def call(generation: "Generation") -> bool:
        returned = [callback(generation) for callback in callbacks]
        return all(map(should_continue, returned))

    return call


def figures(generation: "Generation") -> dict[str, float]:
    """Return the numbers of a generation that make a curve."""
    return {
        "fitness/best_so_far": generation.best_so_far,
        "fitness/best": generation.best,
        "fitness/mean": generation.mean,
        "evaluations/total": float(generation.evaluations),
        "evaluations/failed": float(generation.failed),
        "evaluations/failed_total": float(generation.failed_so_far),
        "evaluations/per_second": generation.evaluations_per_second,
    }


def held_out(run: "Run") -> dict[str, float]:
    """Return the fitness of a run's best on held-out seeds, its 95 % interval, and how many episodes failed.

    Empty without any.
    """
    found = run.unseen
    if found is None:
        return {}
    fitness = found.fitness
    values = {"": fitness.mean, "_low": fitness.low, "_high": fitness.high, "_failed": float(found.failed)}
    return {
        f"fitness/held_out{name}": value
        for name, value in values.items()
        if value is not None and math.isfinite(value)
    }
