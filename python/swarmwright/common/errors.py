"""Errors with complete messages for users, and the exit statuses of the command line."""

import traceback
from collections.abc import Callable
from types import TracebackType
from typing import ClassVar, TypeVar

from swarmwright.common.untrusted import escape_line

Reworded = TypeVar("Reworded", bound="SwarmwrightError")


class SwarmwrightError(Exception):
    """Base class of all errors of Swarmwright. The message states the problem, the place and the remedy."""

    exit_status: ClassVar[int] = 1
    """Exit status of a command that ends with this error."""


class InputError(SwarmwrightError):
    """Invalid input: an experiment, a controller, genomes, an address. Exit status 2."""

    exit_status: ClassVar[int] = 2


class RunError(SwarmwrightError):
    """A run failed although the input was valid.

    For example, there is no broker or server, or all candidates failed. Exit status 1.
    """

    exit_status: ClassVar[int] = 1


class PlugInError(RunError):
    """The code of a plug-in failed or returned an invalid value. The message names the line."""


class SimulationError(RunError):
    """The code of a simulation failed. The message names the method, the error and the line.

    `stack` is the traceback within the simulation's code, None if nothing was raised. In the process of the
    simulation `__cause__` is the exception; elsewhere a note of the error has the traceback.
    """

    def __init__(self, reason: str, stack: str | None = None) -> None:
        super().__init__(reason)
        self.stack = stack


class EpisodeError(SimulationError):
    """An episode failed outside of Python code. `stack` is the printed output."""


def describe_exception(error: BaseException) -> str:
    """Return kind and text of an exception from third-party code; without a text, the line that raised it."""
    kind, words = type(error).__name__, str(error).strip()
    if words:
        return f"{kind}: {words}"
    frames = traceback.extract_tb(error.__traceback__)
    if not frames:
        return kind
    last = frames[-1]
    line = f": {last.line}" if last.line else ""
    return f"{kind} ({last.filename}:{last.lineno}{line})"


def with_message(error: Reworded, message: str) -> Reworded:
    """Return a copy of an error with another message but the same class and attributes."""
    copy = type(error).__new__(type(error))
    vars(copy).update(vars(error))
    copy.args = (message,)
    return copy


class engine_errors:  # noqa: N801 - used like a function
    """Convert errors of the compiled engine to InputError and RunError.

    Their messages may quote peers and are escaped, see `untrusted`.

    Args:
        where: prefix of the message of an input error.
        failure: returns the last failure of a simulation in this process, of which the engine has only the
            message. An error with this message becomes a SimulationError, chained to the exception.
    """

    __slots__ = ("_failure", "_where")

    def __init__(self, where: str = "", failure: Callable[[], SimulationError | None] | None = None) -> None:
        self._where = where
        self._failure = failure

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(
        self, _: type[BaseException] | None, error: BaseException | None, __: TracebackType | None
    ) -> None:
        """Raise the converted error."""
        if error is None:
            return
        from swarmwright import _engine  # noqa: PLC0415 - loads in 10 ms, not for --help

        if isinstance(error, _engine.InputError):
            text = escape_line(str(error))
            named = text.startswith(self._where)  # by the engine itself
            raise InputError(text if named else f"{self._where}{text}") from error
        if isinstance(error, _engine.EngineError):
            words, failure = str(error), self._failure and self._failure()
            if failure is not None and str(failure) in words:
                raise SimulationError(escape_line(words), failure.stack) from failure.__cause__ or error
            raise RunError(escape_line(words)) from error
