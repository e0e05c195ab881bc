"""Failures of a simulation's code: which reasons of a journal are such, and what was raised."""

from collections.abc import Callable

from swarmwright.common.errors import RunError, SimulationError, reworded
from swarmwright.common.untrusted import lines, one_line
from swarmwright.servers.rows import Journal

FailureOf = Callable[[str], SimulationError | None]
"""Returns what the code of the simulation failed with, for a reason that a journal has; None for others."""

_MOST_REASONS = 200
"""Different reasons that are remembered, the last ones."""


class CodeFailures:
    """The reasons for which a simulation's code failed, with their tracebacks.

    A journal has the traceback of a reason once in a run, so they are remembered.
    """

    def __init__(self) -> None:
        self._stacks: dict[str, str | None] = {}

    def note(self, journal: Journal) -> None:
        """Note the reasons in a journal: those of this process, and those that servers gave."""
        for attempt in journal.attempts:
            known = attempt.error in self._stacks or attempt.outcome == "failed"
            if attempt.error and (attempt.stack is not None or known):
                self._remember(attempt.error, attempt.stack)

    def of(self, reason: str) -> SimulationError | None:
        """Return the error for a reason; None where it is not known as one of a simulation's code.

        The traceback of another process is a note of the error, which Python shows with its own.
        """
        if reason not in self._stacks:
            return None
        stack = self._stacks[reason]
        error = SimulationError(reason, stack)
        if stack is not None:
            error.add_note("\n".join(["In the simulation:", *(f"  {line}" for line in lines(stack))]))
        return error

    def _remember(self, reason: str, stack: str | None) -> None:
        before = self._stacks.pop(reason, None)  # so that it becomes the newest
        self._stacks[reason] = before if stack is None else stack
        if len(self._stacks) > _MOST_REASONS:
            del self._stacks[next(iter(self._stacks))]


def failed(message: str, reasons: list[str], failure_of: FailureOf, *, unknown: str = "") -> RunError:
    """Return the error of evaluations that failed: SimulationError where the last reason was such a failure.

    Args:
        message: what failed, to be followed by the last reason.
        reasons: for which episodes failed, in order.
        failure_of: of the backend.
        unknown: what is said where there are none.
    """
    if not reasons:
        return RunError(f"{message}{unknown}")
    words = f"{message}{one_line(reasons[-1])}"
    failure = failure_of(reasons[-1])
    if failure is None:
        return RunError(words)
    error = reworded(failure, words)
    error.__cause__ = failure.__cause__
    return error
