"""Trials of a simulation's determinism: episodes with random actions, run in several processes.

Each process has its own hash seed.
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
from swarmwright.simulations.host import Host, StepResult
from swarmwright.simulations.loading import load
from swarmwright.simulations.names import name_of


@dataclass(frozen=True)
class Outcome:
    """Results of an episode."""

    trace: list[tuple[str, str]]
    """Label and SHA-256 of each returned value, in order."""
    results: list[float]
    """Fitness and metrics; empty if the episode did not end."""


@dataclass(frozen=True)
class Trial:
    """An episode with random actions that are the same in every process."""

    parameters: Mapping[str, Any]
    seed: int
    """Seed of the episode and of its actions."""
    steps: int
    """Largest number of steps."""

    def run(self, host: Host, seed: int | None = None, *, with_scenes: bool = False) -> Outcome:
        """Run the episode.

        seed: replaces the trial's seed. with_scenes: whether to request a scene after each step.
        """
        seed = self.seed if seed is None else seed
        random = np.random.default_rng(seed)
        state = host.reset({**self.parameters, "seed": seed})
        trace: list[tuple[str, str]] = []
        for step in range(self.steps):
            _append_trace(trace, step, state)
            if with_scenes:
                host.scene()
            acting, rows, over = state
            if over:
                break
            actions = np.zeros((len(rows), host.actuators), np.float32)
            actions[acting] = random.uniform(-1, 1, (len(acting), host.actuators))
            state = host.step(actions)
        if not state[2]:
            return Outcome(trace, [])
        host.truncated()
        return Outcome(trace, [host.fitness(), *(host.measure() if host.metrics else ())])


def _append_trace(trace: list[tuple[str, str]], step: int, state: StepResult) -> None:
    """Append the observations after a step, without the rows of agents that do not act."""
    acting, rows, over = state
    after = "at its start" if step == 0 else f"after {step} step{'s' if step > 1 else ''}"
    values = {f"end {after}": bytes([over])}
    if not over:
        values[f"agents that act {after}"] = acting.tobytes()
        values[f"observations {after}"] = rows[acting].tobytes()
    trace += [(label, sha256(value).hexdigest()) for label, value in values.items()]


def difference(repeated: Outcome, original: Outcome, host: Host) -> str | None:
    """Return the first difference of two episodes that should be the same; None if there is none.

    host: host of the simulation, whose declared determinism decides what must agree.
    """
    is_statistical = host.determinism == "statistical"
    if not is_statistical:
        for (label, digest), (_, first) in zip(repeated.trace, original.trace, strict=False):
            if digest != first:
                return label
    tolerance = host.tolerance if is_statistical else 0.0
    names = ["fitness", *(f"metric {name!r}" for name, _ in host.metrics)]
    for name, result, previous in zip(names, repeated.results, original.results, strict=False):
        margin = tolerance * max(1.0, abs(result), abs(previous))
        if not (
            result == previous
            or abs(result - previous) <= margin
            or (np.isnan(result) and np.isnan(previous))
        ):
            return f"{name}, {result!r} instead of {previous!r}"
    return None


_CODE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from swarmwright.simulations import other_process; other_process.main(sys.argv[2])"  # noqa: E501 - one line of a command

_is_child = False
"""Whether this process was started by `outcomes`."""


class NotRunError(Exception):
    """The simulation cannot be imported or fails in another process."""


def _name(simulation: type | str) -> str:
    """Return the name by which another process finds a simulation. Raises NotRunError without one."""
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
    """Run a trial in concurrent processes, one for each hash seed; return their outcomes.

    Raises NotRunError if a process cannot import the class, or its code fails.
    """
    if _is_child:
        raise NotRunError(
            "its file starts this check itself when it is imported; put that code under "
            '`if __name__ == "__main__":`'
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
        messages = [process.communicate()[1] for process in started]
        return [_read(folder / str(index), messages[index]) for index in range(len(started))]


def _read(file: Path, stderr: str) -> Outcome:
    if not file.exists():
        lines = stderr.strip().splitlines() or ["the process ended without a message"]
        raise NotRunError(lines[-1])
    record: dict[str, Any] = json.loads(file.read_text())
    if "failed" in record:
        raise NotRunError(record["failed"])
    return Outcome([(label, digest) for label, digest in record["trace"]], record["results"])


def main(file: str) -> None:
    """Run the trial described on standard input; write its outcome to a file."""
    global _is_child  # noqa: PLW0603 - of the whole process
    _is_child = True
    task = json.load(sys.stdin)
    try:
        kind: Any = load(task["simulation"])
        outcome = Trial(**task["trial"]).run(Host(kind))
        record = {"trace": outcome.trace, "results": outcome.results}
    except SwarmwrightError as error:
        record = {"failed": str(error)}
    Path(file).write_text(json.dumps(record))
