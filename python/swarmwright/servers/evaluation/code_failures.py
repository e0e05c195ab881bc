"""Failures in a simulation's code, with their tracebacks."""

from collections.abc import Callable

from swarmwright.common.errors import RunError, SimulationError, with_message
from swarmwright.common.untrusted import escape_line, escape_lines
from swarmwright.servers.rows import Journal

FailureOf = Callable[[str], SimulationError | None]
"""Returns the error of the simulation's code for a reason in a journal; None for other reasons."""

_MAX_REASONS = 200
"""Number of distinct reasons to remember; the oldest are dropped."""


class CodeFailures:
    """Reasons of failures in a simulation's code, with their tracebacks.

    A run's journal contains the traceback of a reason only once, so it is remembered here.
    """

    def __init__(self) -> None:
        self._stacks: dict[str, str | None] = {}

    def note(self, journal: Journal) -> None:
        """Note the reasons in a journal, from this process and from servers."""
        for attempt in journal.attempts:
            is_known = attempt.error in self._stacks or attempt.outcome == "failed"
            if attempt.error and (attempt.stack is not None or is_known):
                self._remember(attempt.error, attempt.stack)

    def find_error(self, reason: str) -> SimulationError | None:
        """Return the error for a reason; None if it did not come from a simulation's code.

        A traceback from another process is attached as a note.
        """
        if reason not in self._stacks:
            return None
        stack = self._stacks[reason]
        error = SimulationError(reason, stack)
        if stack is not None:
            error.add_note("\n".join(["In the simulation:", *(f"  {line}" for line in escape_lines(stack))]))
        return error

    def _remember(self, reason: str, stack: str | None) -> None:
        before = self._stacks.pop(reason, None)  # becomes the newest
        self._stacks[reason] = before if stack is None else stack
        if len(self._stacks) > _MAX_REASONS:
            del self._stacks[next(iter(self._stacks))]


def build_error(message: str, reasons: list[str], failure_of: FailureOf, *, unknown: str = "") -> RunError:
    """Build the error for failed evaluations: SimulationError if the last reason came from its code.

    Args:
        message: beginning of the message, followed by the last reason.
        reasons: reasons of the failed episodes, in order.
        failure_of: function of this name of the backend.
        unknown: end of the message if there are no reasons.
    """
    if not reasons:
        return RunError(f"{message}{unknown}")
    words = f"{message}{escape_line(reasons[-1])}"
    failure = failure_of(reasons[-1])
    if failure is None:
        return RunError(words)
    error = with_message(failure, words)
    error.__cause__ = failure.__cause__
    return error
