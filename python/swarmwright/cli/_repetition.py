"""What `swarmwright evaluate` shows of a candidate that is evaluated again with the seeds of its record."""

import math
from typing import TYPE_CHECKING

from swarmwright.cli._output import Output
from swarmwright.common.untrusted import one_line

if TYPE_CHECKING:
    from swarmwright import Experiment, Repeated, Run
    from swarmwright.cli._parameter_types import Servers


def show_repetition(
    output: Output,
    run: "Run",
    experiment: "Experiment",
    candidate: int | None,
    generation: int | None,
    broker: str | None,
    servers: "Servers | None",
) -> int:
    """Repeat an evaluation and compare it with its record; return the exit status, 0 if it is the same."""
    from swarmwright import repeat

    found = repeat(run, candidate, generation, experiment=experiment, broker=broker, servers=servers)
    output.json(
        {
            "number": found.number,
            "generation": found.generation,
            "candidate": found.candidate,
            "seeds": found.seeds,
            "recorded": found.recorded.tolist(),
            "repeated": found.repeated.tolist(),
            "same": found.same,
            "left_out": found.left_out,
            "recorded_errors": found.recorded_errors,
            "errors": found.errors,
        }
    )
    output.text(f"Candidate {found.candidate} of generation {found.generation}, evaluation {found.number}.")
    for episode, (before, now) in enumerate(
        zip(found.recorded.tolist(), found.repeated.tolist(), strict=True)
    ):
        output.text(f"  episode {episode}: recorded {_fitness(before)}, now {_fitness(now)}")
    if found.left_out:
        ran = len(found.recorded)
        output.text(
            f"It was dropped from the race after {ran} of {ran + found.left_out} episodes, "
            "which are compared."
        )
    if found.failed_again:
        for when, errors in (("as recorded", found.recorded_errors), ("now", found.errors)):
            output.text(f"Failed {when}: {'; '.join(map(one_line, errors)) or 'the reason is not known'}")
    output.text(_verdict(found))
    return 0 if found.same else 1


def _fitness(value: float) -> str:
    return "failed" if math.isnan(value) else repr(value)


def _verdict(found: "Repeated") -> str:
    """Say whether an evaluation and its repetition are the same."""
    if not found.failed_again:
        return "The fitness is the same, to the bit." if found.same else "The fitness is NOT the same."
    if found.failed_again == len(found.recorded):
        return "It failed again for the same reason." if found.same else "It failed for ANOTHER reason."
    if found.same:
        return "The fitness is the same, to the bit; what failed has failed again for the same reason."
    return "The fitness, or the reason why episodes failed, is NOT the same."
