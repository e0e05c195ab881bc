"""Episodes with random actions, to see whether a simulation computes the same again."""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np

from swarmwright.simulations.host import Host, Seen


@dataclass(frozen=True)
class Outcome:
    """What an episode returned."""

    trace: list[tuple[str, str]]
    """In its order: what was returned where, and the SHA-256 of its bytes."""
    results: list[float]
    """Fitness and metrics; empty where the episode did not end."""


@dataclass(frozen=True)
class Trial:
    """An episode with random actions, the same whatever runs it."""

    parameters: Mapping[str, Any]
    seed: int
    """Of the episode and of its actions."""
    steps: int
    """At most."""

    def run(self, host: Host, seed: int | None = None, *, shown: bool = False) -> Outcome:
        """Run the episode.

        seed: instead of the trial's. shown: whether scenes are asked for.
        """
        seed = self.seed if seed is None else seed
        random = np.random.default_rng(seed)
        seen = host.reset({**self.parameters, "seed": seed})
        trace: list[tuple[str, str]] = []
        for step in range(self.steps):
            _note(trace, step, seen)
            if shown:
                host.scene()
            acting, rows, over = seen
            if over:
                break
            actions = np.zeros((len(rows), host.actuators), np.float32)
            actions[acting] = random.uniform(-1, 1, (len(acting), host.actuators))
            seen = host.step(actions)
        if not seen[2]:
            return Outcome(trace, [])
        host.truncated()
        return Outcome(trace, [host.fitness(), *(host.measure() if host.metrics else ())])


def _note(trace: list[tuple[str, str]], step: int, seen: Seen) -> None:
    """Note what is seen after a step; rows of agents that do not act do not count."""
    acting, rows, over = seen
    after = "at its start" if step == 0 else f"after {step} step{'s' if step > 1 else ''}"
    found = {f"end {after}": bytes([over])}
    if not over:
        found[f"agents that act {after}"] = acting.tobytes()
        found[f"observations {after}"] = rows[acting].tobytes()
    trace += [(what, sha256(value).hexdigest()) for what, value in found.items()]


def difference(now: Outcome, before: Outcome, host: Host) -> str | None:
    """Return the first difference between two episodes that should be the same, in words; None without one.

    host: of the simulation, which declares what has to be the same.
    """
    is_statistical = host.determinism == "statistical"
    if not is_statistical:
        for (what, digest), (_, first) in zip(now.trace, before.trace, strict=False):
            if digest != first:
                return f"other {what}"
    tolerance = host.tolerance if is_statistical else 0.0
    names = ["fitness", *(f"metric {name!r}" for name, _ in host.metrics)]
    for name, one, other in zip(names, now.results, before.results, strict=False):
        margin = tolerance * max(1.0, abs(one), abs(other))
        if not (one == other or abs(one - other) <= margin or (np.isnan(one) and np.isnan(other))):
            return f"another {name}, {one!r} instead of {other!r}"
    return None
