"""The base class of callbacks, and the figures that they report."""

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
    """Called after each generation; a context manager that writes the remaining figures when it ends."""

    @abstractmethod
    def __call__(self, generation: "Generation") -> None:
        """Report the figures of a generation."""

    @abstractmethod
    def conclude(self, run: "Run") -> None:
        """Report the finished run. Callers may omit it."""

    @abstractmethod
    def close(self) -> None:
        """Write the remaining figures. May be called again."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def together(
    *callbacks: "Callable[[Generation], bool | None]",
) -> "Callable[[Generation], bool | None]":
    """Combine callbacks into one that calls them in order, and ends the run if any of them does."""
    for callback in callbacks:
        function("callbacks", callback, ("generation",))

    def call(generation: "Generation") -> bool:
        returned = [callback(generation) for callback in callbacks]
        return all(map(should_continue, returned))

    return call


def figures(generation: "Generation") -> dict[str, float]:
    """Return the figures of a generation by the names of their curves."""
    return {
        "fitness/best_so_far": generation.best_so_far,
        "fitness/best": generation.best,
        "fitness/mean": generation.mean,
        "evaluations/total": float(generation.evaluations),
        "evaluations/failed": float(generation.failed),
        "evaluations/failed_total": float(generation.failed_so_far),
        "evaluations/per_second": generation.evaluations_per_second,
    }


def get_held_out_figures(run: "Run") -> dict[str, float]:
    """Return the fitness of a run's best on held-out seeds, its 95 % interval and its failed episodes.

    Empty without a validation.
    """
    evaluation = run.unseen
    if evaluation is None:
        return {}
    fitness, failed = evaluation.fitness, float(evaluation.failed)
    values = {"": fitness.mean, "_low": fitness.low, "_high": fitness.high, "_failed": failed}
    return {
        f"fitness/held_out{name}": value
        for name, value in values.items()
        if value is not None and math.isfinite(value)
    }
