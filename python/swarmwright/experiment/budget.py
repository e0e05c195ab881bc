"""Budgets of a run: generations, evaluations and seconds; the first one used up ends it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self, get_args

if TYPE_CHECKING:
    from swarmwright.methods import MethodOptions

Limit = Literal["generations", "evaluations", "seconds"]
LIMITS: tuple[Limit, ...] = get_args(Limit)


def sets_limit(options: Mapping[str, object]) -> bool:
    """Whether changed options of a method include a limit, which replaces all previous limits."""
    return any(options.get(limit) is not None for limit in LIMITS)


EndReason = Literal["generations", "evaluations", "seconds", "target"]
"""Reason why a run is done."""


@dataclass(frozen=True)
class Budget:
    """Limits of a run; None for no limit."""

    generations: int | None
    evaluations: int | None
    seconds: float | None

    @classmethod
    def from_options(cls, options: "MethodOptions") -> Self:
        """Return the budget in a method's options."""
        return cls(options.generation_limit, options.evaluations, options.seconds)

    def find_nearest(self, generations: int, evaluations: int, seconds: float) -> tuple[Limit, float]:
        """Return the limit with the largest used share, and this share, 0 to 1."""
        shares: dict[Limit, float] = {}
        if self.generations is not None:
            shares["generations"] = generations / self.generations
        if self.evaluations is not None:
            shares["evaluations"] = evaluations / self.evaluations
        if self.seconds is not None:
            shares["seconds"] = seconds / self.seconds
        if not shares:
            return "generations", 0.0
        name = max(shares, key=lambda share: shares[share])
        return name, min(shares[name], 1.0)

    def estimate_generations(self, generations: int, evaluations: int) -> int:
        """Estimate the number of generations of the run after these generations and evaluations."""
        expected = [max(generations, 1)] if self.generations is None else [self.generations]
        if self.evaluations is not None and evaluations:
            fitting = math.ceil(self.evaluations * max(generations, 1) / evaluations)
            expected = [fitting] if self.generations is None else [*expected, fitting]
        return max(min(expected), generations, 1)

    def describe_end(self, ended: EndReason, generations: int, evaluations: int) -> str:
        """Return why a run ended after these generations and evaluations."""
        done = f"all {self.generations} generations are done"
        if self.generations is not None and generations < self.generations:
            # Only methods that restart with larger populations use up the evaluations earlier.
            whole = self.generations
            done = (
                f"the evaluations are used after {generations} of {whole} generations, as restarts have "
                f"enlarged the population; method.restart: none runs all {whole}"
            )
        used = f"the next generation would exceed {self.evaluations} evaluations"
        if self.evaluations is not None and evaluations >= self.evaluations:
            used = f"all {self.evaluations} evaluations are used"
        if self.evaluations is not None and evaluations > self.evaluations:
            # The first generation is always evaluated.
            used = f"the first generation has used {evaluations} evaluations, more than {self.evaluations}"
        return {
            "generations": done,
            "evaluations": used,
            "seconds": f"the time limit of {self.seconds:g} seconds is reached"
            if self.seconds is not None
            else "",
            "target": "the target is reached",
        }[ended]
