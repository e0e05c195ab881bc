"""Checks of simulations in Python: episodes depend only on parameters, seed and actions."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.suggestions import unknown
from swarmwright.simulations import other_process
from swarmwright.simulations.base import BatchSimulation, Simulation
from swarmwright.simulations.host import Host
from swarmwright.simulations.loading import load
from swarmwright.simulations.other_process import Outcome, Trial, difference

MOST_STEPS = 1000

_HASH_SEEDS = ("1", "2")
_OTHER_OBJECT = "random numbers that are not from `seed`, the time of day, or what is kept outside of it"
_WITHIN = "what `reset` does not set anew"
_OUTSIDE = (
    "what is kept in classes and modules from one episode to the next, the order of objects by their "
    "addresses, or random numbers that are not from `seed`"
)
_HASHED = "sets of texts that are iterated over: their order is another one in each process; sort them first"


def check_simulation(
    simulation: type[Simulation] | type[BatchSimulation] | str,
    parameters: Mapping[str, Any] | None = None,
    *,
    seed: int = 1,
    steps: int = MOST_STEPS,
) -> None:
    """Check that an episode depends only on parameters, seed and actions, and that its values are valid.

    An episode with random actions is run by an object, by another one, again by the first one, and once more
    after an episode with another seed: observations, acting agents, end, fitness and metrics must be the
    same, to the bit. It is also run with a call of `scene` after every step, which must not change anything,
    and in two other processes with different hash seeds (PYTHONHASHSEED), which change the order of sets of
    strings. A class that other processes cannot import, because it is defined in the running script or within
    a function, is not checked in these, and a warning says so. Attributes, shapes, names of metrics and
    scenes are checked as in runs.

    If the class declares its `determinism` as statistical, only fitness and metrics are compared, within its
    `tolerance`; if it declares `none`, nothing is compared, and one episode is run, with calls of `scene`.

    Args:
        simulation: the class, or its name: `path/to/file.py:Class`, `package.module:Class`, or the name of an
            environment.
        parameters: parameters of the episode; default: the simulation's defaults.
        seed: seed of the episode and of its actions, 0 to 2**63 - 1.
        steps: largest number of steps, at least 1; fitness and metrics of an unfinished episode are not
            checked.

    Raises AssertionError, InputError or RunError with the problem.
    """
    kind = class_of(simulation, (Simulation, BatchSimulation), "a Simulation")
    if steps < 1:
        raise InputError(f"steps: {steps} found, expected at least 1")
    with engine_errors():
        first, second = Host(kind), Host(kind)
        if first.takes_controller:
            raise InputError(f"{kind.__name__}: runs controllers itself, which this check does not have")
        for name in parameters or {}:
            if first.description.parameters and name not in first.description.parameters:
                raise InputError(
                    f"{kind.__name__}: {unknown('parameter', name, first.description.parameters)}"
                )
        trial = Trial(dict(parameters or {}), seed, steps)
        if first.determinism == "none":
            trial.run(first, with_scenes=first.has_scenes)
            return
        check = _Check(kind.__name__, trial, trial.run(first))
        check.compare(second, "of another object", _OTHER_OBJECT)
        check.compare(first, "that is repeated", _WITHIN)
        trial.run(first, seed + 1)
        check.compare(first, "after one with another seed", _WITHIN)
        if first.has_scenes:
            check.compare(first, "in which `scene` is called", "what `scene` changes", shown=True)
        check.compare_processes(simulation, first)


def class_of(simulation: type | str, bases: tuple[type[Any], ...], expected: str) -> type[Any]:
    """Return a class, by itself or by its name. Raises InputError if it does not derive from `bases`."""
    kind: Any = load(simulation) if isinstance(simulation, str) else simulation
    if not isinstance(kind, type) or not issubclass(kind, bases):
        raise InputError(f"{getattr(kind, '__name__', repr(kind))}: is not {expected}")
    return kind


@dataclass(frozen=True)
class _Check:
    """Compares episodes of a trial with the first; methods raise AssertionError on a difference."""

    name: str
    trial: Trial
    first: Outcome

    def compare(self, host: Host, variant: str, cause: str, *, shown: bool = False) -> None:
        """Run the episode once more in this process."""
        description = difference(self.trial.run(host, with_scenes=shown), self.first, host)
        assert description is None, self._words(variant, description, cause)

    def compare_processes(self, simulation: type | str, host: Host) -> None:
        """Run the episode in two processes with different hash seeds."""
        try:
            first, second = other_process.outcomes(simulation, self.trial, _HASH_SEEDS)
            description = difference(second, first, host)
            if description is not None:
                (repeated,) = other_process.outcomes(simulation, self.trial, _HASH_SEEDS[:1])
                by_hash_seed = difference(repeated, first, host) is None
                variant = "with another hash seed (PYTHONHASHSEED)" if by_hash_seed else "in another process"
                raise AssertionError(self._words(variant, description, _HASHED if by_hash_seed else _OUTSIDE))
        except other_process.NotRunError as error:
            logging.getLogger("swarmwright").warning(
                "%s was not checked in other processes: %s", self.name, error
            )
            return
        description = difference(first, self.first, host)
        assert description is None, self._words("in another process", description, _OUTSIDE)

    def _words(self, variant: str, description: str | None, cause: str) -> str:
        episode = f"an episode {variant}, with the same seed and actions, differs in its {description}"
        return f"{self.name}: {episode}; look for {cause}"


EPISODES = 7
"""Enough for full and partial SIMD vectors in numpy's loops."""


def check_batch_simulation(
    simulation: type[BatchSimulation] | str, parameters: Mapping[str, Any] | None = None, *, seed: int = 1
) -> None:
    """Check that episodes do not depend on the others in the batch.

    Seven episodes are run together, with random actions, and each alone: observations, acting agents, end,
    fitness and metrics must be the same, to the bit.

    Args:
        simulation: the class, or its name: `path/to/file.py:Class` or `package.module:Class`.
        parameters: parameters of the episode; default: the simulation's defaults.
        seed: seed of the actions.

    Raises AssertionError, InputError or RunError with the problem.
    """
    kind = class_of(simulation, (BatchSimulation,), "a BatchSimulation; check_simulation checks others")
    values = dict(parameters or {})
    seeds = np.arange(EPISODES, dtype=np.uint64)
    together, alone = Host(kind), [Host(kind) for _ in seeds]
    turn = together.start(values, seeds)
    single = [host.start(values, seeds[i : i + 1]) for i, host in enumerate(alone)]
    random = np.random.default_rng(seed)
    ended = np.zeros(EPISODES, bool)
    for step in range(MOST_STEPS):
        for i, (acts, rows, over) in enumerate(single):
            if ended[i]:
                continue
            where = f"{kind.__name__}: after {step} steps, an episode alone has other"
            assert over[0] == turn[2][i], f"{where} end"
            if not over[0]:
                assert (acts[0] == turn[0][i]).all(), f"{where} agents that act"
                same = (rows[0] == turn[1][i])[acts[0]]
                assert same.all(), f"{where} observations"
        fresh = turn[2] & ~ended
        if fresh.any():
            results = together.results(bool(together.metrics))
            for i in np.flatnonzero(fresh).tolist():
                separate = alone[i].results(bool(together.metrics))[:, 0]
                assert (separate == results[:, i]).all(), (
                    f"{kind.__name__}: an episode alone has other results: {separate}, not {results[:, i]}"
                )
            ended |= fresh
        if ended.all():
            return
        actions = random.uniform(-1, 1, (*turn[0].shape, together.actuators)).astype(np.float32)
        actions[~turn[0]] = 0
        turn = together.go(actions)
        single = [now if ended[i] else alone[i].go(actions[i : i + 1]) for i, now in enumerate(single)]
