"""Runs a trial of a simulation in other processes, each with a hash seed of its own.

Episodes with random actions, to see whether a simulation computes the same again.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright.common import processes
from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.simulations.host import Host, Seen
from swarmwright.simulations.loading import load
from swarmwright.simulations.names import name_of


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
    for name, result, other in zip(names, now.results, before.results, strict=False):
        margin = tolerance * max(1.0, abs(result), abs(other))
        if not (result == other or abs(result - other) <= margin or (np.isnan(result) and np.isnan(other))):
            return f"another {name}, {result!r} instead of {other!r}"
    return None


_CODE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from swarmwright.simulations import other_process; other_process.main(sys.argv[2])"  # noqa: E501 - one line of a command

_is_other = False
"""Whether this process was started here."""


class NotRunError(Exception):
    """The simulation cannot be imported in another process, or fails there."""


def _name(simulation: type | str) -> str:
    """Return the name by which another process finds a simulation. Raises NotRunError where it has none."""
    if isinstance(simulation, str):
        return simulation
    try:
        name = name_of(simulation)
    except InputError as error:
        raise NotRunError(str(error)) from error
    if name.startswith("__main__:"):
        raise NotRunError("it is defined in a notebook or an interactive session")
    return name


def outcomes(simulation: type | str, trial: Trial, seeds: Sequence[str]) -> list[Outcome]:
    """Return what a trial returns in processes that run at the same time, one for each hash seed.

    Raises NotRunError where the class cannot be imported there, or its code fails.
    """
    if _is_other:
        raise NotRunError(
            'this process imports it to check it; put what its file runs under `if __name__ == "__main__":`'
        )
    named = _name(simulation)
    values = {"parameters": dict(trial.parameters), "seed": trial.seed, "steps": trial.steps}
    try:
        task = json.dumps({"simulation": named, "trial": values})
    except (TypeError, ValueError) as error:
        raise NotRunError(f"its parameters cannot be written as JSON: {error}") from error
    with ExitStack() as stack:
        folder = stack.enter_context(TemporaryFolder("check"))
        started = []
        for index, seed in enumerate(seeds):
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", _CODE, json.dumps(sys.path), str(folder / str(index))],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                env={**os.environ, processes.VARIABLE: seed},
                text=True,
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            started.append(process)
        for process in started:
            assert process.stdin is not None
            process.stdin.write(task)
            process.stdin.flush()
            process.stdin.close()
            process.stdin = None
        said = [process.communicate()[1] for process in started]
        return [_read(folder / str(index), said[index]) for index in range(len(started))]


def _read(file: Path, said: str) -> Outcome:
    if not file.exists():
        lines = said.strip().splitlines() or ["the process ended without a message"]
        raise NotRunError(lines[-1])
    found: dict[str, Any] = json.loads(file.read_text())
    if "failed" in found:
        raise NotRunError(found["failed"])
    return Outcome([(what, digest) for what, digest in found["trace"]], found["results"])


def main(file: str) -> None:
    """Run the trial that standard input describes; write what it returns to a file."""
    global _is_other  # noqa: PLW0603 - of the whole process
    _is_other = True
    task = json.load(sys.stdin)
    try:
        kind: Any = load(task["simulation"])
        outcome = Trial(**task["trial"]).run(Host(kind))
        found = {"trace": outcome.trace, "results": outcome.results}
    except SwarmwrightError as error:
        found = {"failed": str(error)}
    Path(file).write_text(json.dumps(found))
