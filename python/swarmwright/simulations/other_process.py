"""Runs a trial of a simulation in other processes, each with a hash seed of its own."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from swarmwright.common import hash_seed
from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.simulations.host import Host
from swarmwright.simulations.loading import load
from swarmwright.simulations.names import name_of
from swarmwright.simulations.trial import Outcome, Trial

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
                env={**os.environ, hash_seed.VARIABLE: seed},
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
