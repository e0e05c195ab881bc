"""Errors with a message for users.

Each message is complete, and each class has the exit status of a command line tool that ends with it.
"""

import traceback
from collections.abc import Callable
from types import TracebackType
from typing import ClassVar, TypeVar

from swarmwright.common.untrusted import escape_line

Reworded = TypeVar("Reworded", bound="SwarmwrightError")


class SwarmwrightError(Exception):
    """Base of all errors of Swarmwright. The message says what is wrong, where, and how to fix it."""

    exit_status: ClassVar[int] = 1
    """What a command line tool that ends with this error exits with."""


class InputError(SwarmwrightError):
    """What was given is wrong: an experiment, a controller, genomes, an address. Exit status 2."""

    exit_status: ClassVar[int] = 2


class RunError(SwarmwrightError):
    """The run failed although the input was valid.

    No broker, no server, all candidates failed. Exit status 1.
    """

    exit_status: ClassVar[int] = 1


class PlugInError(RunError):
    """The code of a plug-in failed, or returned something else than it must. The message says where."""


class SimulationError(RunError):
    """The code of a simulation failed. The message says in which method, what, and in which line.

    `stack` is the traceback from the simulation's code on, None where nothing was raised. In the process of
    the simulation `__cause__` is the exception; elsewhere a note of the error has the traceback.
    """

    def __init__(self, reason: str, stack: str | None = None) -> None:
        super().__init__(reason)
        self.stack = stack


class EpisodeError(SimulationError):
    """An episode failed outside of Python's code, which needs no place in it. `stack` is what was printed."""


def describe_exception(error: BaseException) -> str:
    """Return kind and text of an exception raised by third-party code; or the line that raised it."""
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
    """Return a copy of an error with another message, of the same class and with the same attributes."""
    copy = type(error).__new__(type(error))
    vars(copy).update(vars(error))
    copy.args = (message,)
    return copy


class engine_errors:  # noqa: N801 - used like a function
    """Turn the compiled engine's errors into InputError and RunError.

    Their messages may quote peers, and are reduced to one line, see `untrusted`.

    Args:
        where: put before an input error's message.
        failure: returns what a simulation's code in this process failed with last; the engine has its words
            only. An error that has them becomes a SimulationError, chained to what was raised.
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
        """Raise the error that is meant."""
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
