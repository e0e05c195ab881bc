"""Checks of simulations in Python: an episode follows from parameters, seed and actions alone."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmwright.core.errors import InputError, engine_errors
from swarmwright.core.suggestions import unknown
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.batches import BatchSimulation
from swarmwright.simulations.host import Host, Seen
from swarmwright.simulations.loading import load

MOST_STEPS = 1000

Trace = list[tuple[str, bytes]]
"""What an episode returns, in its order: where and what, and its bytes."""


def check_simulation(
    simulation: type[Simulation] | type[BatchSimulation] | str,
    parameters: Mapping[str, Any] | None = None,
    *,
    seed: int = 1,
    steps: int = MOST_STEPS,
) -> None:
    """Check that an episode follows from parameters, seed and actions alone, and that all it returns fits.

    An episode with random actions is run by an object, by another one, again by the first one, and once more
    after an episode with another seed: observations, who acts, when it ends, fitness and metrics must be the
    same, to the bit. It is also run with `scene` being called after every step, which may change nothing.
    Attributes, shapes, names of metrics and scenes are checked as in runs.

    Where the class declares `determinism` as statistical, fitness and metrics are compared, within its
    `tolerance`; where it declares none, nothing is, and one episode is run, with `scene` being called.

    Args:
        simulation: the class, or its name: `path/to/file.py:Class`, `package.module:Class`, or one of an
            environment.
        parameters: with which it is reset; default: its defaults.
        seed: of the episode and of its actions, 0 to 2**63 - 1.
        steps: of an episode at most, from 1 on; of one that has not ended then, fitness and metrics are
            not looked at.

    AssertionError says what is wrong, InputError and RunError too.
    """
    kind = class_of(simulation, (Simulation, BatchSimulation), "a Simulation")
    if steps < 1:
        raise InputError(f"steps: {steps} found, expected at least 1")
    with engine_errors():
        one, other = Host(kind), Host(kind)
        if one.takes_controller:
            raise InputError(f"{kind.__name__}: runs controllers itself, which this check does not have")
        for name in parameters or {}:
            if one.description.parameters and name not in one.description.parameters:
                raise InputError(f"{kind.__name__}: {unknown('parameter', name, one.description.parameters)}")
        episodes = _Episodes(kind.__name__, dict(parameters or {}), seed, steps)
        if one.determinism == "none":
            episodes.run(one, shown=one.has_scenes)
            return
        first = episodes.run(one)
        outside = "random numbers that are not from `seed`, the time of day, or what is kept outside of it"
        within = "what `reset` does not set anew"
        episodes.compare(first, other, "of another object", outside)
        episodes.compare(first, one, "that is repeated", within)
        episodes.run(one, seed + 1)
        episodes.compare(first, one, "after one with another seed", within)
        if one.has_scenes:
            episodes.compare(first, one, "in which `scene` is called", "what `scene` changes", shown=True)


def class_of(simulation: type | str, bases: tuple[type[Any], ...], expected: str) -> type[Any]:
    """Return the class that is named or given. Raises InputError where it is not derived from `bases`."""
    kind: Any = load(simulation) if isinstance(simulation, str) else simulation
    if not isinstance(kind, type) or not issubclass(kind, bases):
        raise InputError(f"{getattr(kind, '__name__', repr(kind))}: is not {expected}")
    return kind


class _Episodes:
    """Episodes with the same parameters, and the same actions wherever the seed is the same."""

    def __init__(self, name: str, parameters: dict[str, Any], seed: int, steps: int) -> None:
        self._name, self._parameters, self._seed, self._steps = name, parameters, seed, steps

    def run(self, host: Host, seed: int | None = None, *, shown: bool = False) -> tuple[Trace, list[float]]:
        """Run an episode; return what it shows, and fitness and metrics, none where it does not end.

        seed: default: the usual one. shown: whether scenes are asked for.
        """
        seed = self._seed if seed is None else seed
        random = np.random.default_rng(seed)
        seen = host.reset({**self._parameters, "seed": seed})
        trace: Trace = []
        for step in range(self._steps):
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
            return trace, []
        host.truncated()
        return trace, [host.fitness(), *(host.measure() if host.metrics else ())]

    def compare(
        self, first: tuple[Trace, list[float]], host: Host, which: str, cause: str, *, shown: bool = False
    ) -> None:
        """Raise AssertionError where an episode differs from the first one."""
        trace, results = self.run(host, shown=shown)
        where = f"{self._name}: an episode {which}, with the same seed and actions, has"
        if host.determinism != "statistical":
            for (what, one), (_, before) in zip(trace, first[0], strict=False):
                assert one == before, f"{where} other {what}; look for {cause}"
        tolerance = host.tolerance if host.determinism == "statistical" else 0.0
        names = ["fitness", *(f"metric {name!r}" for name, _ in host.metrics)]
        for name, now, then in zip(names, results, first[1], strict=False):
            margin = tolerance * max(1.0, abs(now), abs(then))
            same = now == then or abs(now - then) <= margin or (np.isnan(now) and np.isnan(then))
            assert same, f"{where} another {name}, {now!r} instead of {then!r}; look for {cause}"


def _note(trace: Trace, step: int, seen: Seen) -> None:
    """Note what is seen after a step; rows of agents that do not act do not count."""
    acting, rows, over = seen
    after = "at its start" if step == 0 else f"after {step} step{'s' if step > 1 else ''}"
    trace.append((f"end {after}", bytes([over])))
    if not over:
        trace.append((f"agents that act {after}", acting.tobytes()))
        trace.append((f"observations {after}", rows[acting].tobytes()))
