"""Calls of a user's code, whose exceptions are explained and reported once."""

import contextlib
import inspect
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Generic, NoReturn, Self, TypeVar

import numpy as np

from swarmwright import _engine
from swarmwright.common.errors import EpisodeError, InputError, SimulationError, with_message
from swarmwright.common.tracebacks import exception_text, is_installed
from swarmwright.common.tracebacks import shorten_path as shown_path

_STACK = 8000
"""Largest number of characters of a traceback; the end is kept, which has the exception."""

_REASON = 2000
"""Largest number of characters of a reason. The engine cuts longer ones (`MOST_REASON`), and reasons identify
failures."""

_WORDS = 1000
"""Largest number of characters of an exception's message in a reason; the line that raised it follows."""

_FOLDER = Path(__file__).parent

OBSERVATIONS_ALONE = (
    "expected only the observations, not a tuple as from a Gymnasium environment: done() returns whether the "
    "episode has ended, and fitness() its fitness. To use a Gymnasium environment without a class, "
    "see docs/how-to/use-environments.md"
)
"""Message for a simulation whose `reset` or `step` returns a tuple, as a Gymnasium environment does."""

_REMEMBERED = 100
"""Largest number of different failures that are reported, each once."""

Instance = TypeVar("Instance")


class Calls(Generic[Instance]):
    """Calls of the methods of an object of a user's class.

    Args:
        kind: the class.
        report: called with (reason, traceback) of a failure, once for each reason.
    """

    _beginning: ClassVar[str]
    """The method that receives the parameters, and may refuse them."""
    _needs: ClassVar[str]
    """The methods that the class must define, in words."""

    def __init__(self, kind: type[Instance], report: Callable[[str, str], None] | None = None) -> None:
        self._kind = kind
        self._report = report or (lambda _reason, _traceback: None)
        self._reported: set[str] = set()
        self._failures: list[SimulationError] = []  # the last one, of all hosts of a class
        self._object: Instance | None = None

    @property
    def failure(self) -> SimulationError | None:
        """The last failure, chained to the exception that caused it; None after `forget_failure`."""
        return self._failures[0] if self._failures else None

    def forget_failure(self) -> None:
        """Drop the last failure, whose traceback holds frames of the user's code."""
        self._failures.clear()

    def _share_reports(self, other: Self) -> None:
        """Share reported failures with another host of the class."""
        self._reported, self._failures = other._reported, other._failures

    def _call(self, method: str, *arguments: Any) -> Any:  # noqa: ANN401 - whatever the code takes and returns
        """Call a method of the user's object, and turn its exceptions into SimulationError."""
        try:
            return self._run_function(method, getattr(self._object, method), *arguments)
        except (InputError, _engine.InputError) as error:
            if method == self._beginning:  # about the parameters
                raise _engine.InputError(str(error)) from None
            self._fail(self._describe_cause(method, error), error)
        except EpisodeError as error:  # its message has the location and the cause
            failure = with_message(error, _shorten_like_engine(str(error), _REASON))
            self._report_once(str(failure), failure.stack)
            self._failures[:] = [failure]
            raise failure from error.__cause__
        except KeyboardInterrupt:
            raise
        # `sys.exit` ends only the episode, too.
        except BaseException as error:  # noqa: BLE001 - a user's code may fail in any way
            self._fail(self._describe_cause(method, error), error)

    def _run_function(self, method: str, function: Callable[..., Any], *arguments: Any) -> Any:  # noqa: ANN401
        """Call a function. If it forks a child process that returns, end the child.

        The child would otherwise continue as a second server with this server's connections.
        """
        process = os.getpid()
        try:
            return function(*arguments)
        finally:
            if os.getpid() != process:
                _end_child(f"{self._kind.__name__}.{method}")

    def _make_object(self) -> Instance:
        """Create the object. Raises InputError if it lacks methods or prerequisites."""
        check_methods(self._kind, self._needs)
        try:
            instance: Instance = self._run_function("__init__", self._kind)
            return instance
        except InputError:  # a prerequisite is missing
            raise
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - as in `_call`
            self._fail(self._describe_cause("__init__", error), error)

    def _describe_cause(self, method: str, error: BaseException) -> str:
        """Return the exception and its location: the last line of the traceback in the class's file.

        If there is none, such as in a method of a base class, it is the last line of code that is not an
        installed package, or else the last line of all.
        """
        frames = traceback.extract_tb(error.__traceback__)[1:]
        if isinstance(error, TypeError) and all(frame.filename == __file__ for frame in frames):
            # The call itself failed: the method has a different signature.
            return self._explain_type_error(method, error)
        is_from_adapter = bool(frames) and Path(frames[-1].filename).is_relative_to(_FOLDER)
        if is_from_adapter and isinstance(error, SimulationError):  # the message is complete
            return f"{method}: {_get_message(error)}"
        file = getattr(sys.modules.get(self._kind.__module__), "__file__", None)
        mine = [frame for frame in frames if frame.filename == file and not is_installed(frame.filename)]
        mine = mine or [frame for frame in frames if not is_installed(frame.filename)] or frames
        where = f" ({shown_path(mine[-1].filename)}:{mine[-1].lineno})" if mine else ""
        words = _get_message(error)
        return f"{method}: {type(error).__name__}{': ' if words else ''}{words}{where}"

    def _explain_type_error(self, method: str, error: TypeError) -> str:
        """Describe a method with a wrong signature, or an attribute that is not a method."""
        attribute = self._kind if method == "__init__" else getattr(self._object, method)
        code = getattr(inspect.unwrap(getattr(self._kind, method)), "__code__", None)
        file = getattr(sys.modules.get(self._kind.__module__), "__file__", None)
        location = ""
        if code is not None:
            location = f" ({shown_path(code.co_filename)}:{code.co_firstlineno})"
        elif file is not None:
            location = f" ({shown_path(file)})"
        problem = (
            f"TypeError: {_get_message(error)}"
            if callable(attribute)
            else f"{summarize(attribute)} is not a method"
        )
        return f"{method}: {problem}{location}; expected {self._signature(method)}"

    def _signature(self, method: str) -> str:
        """Return the signature of a method in the base class that declares it."""
        declared = [vars(base)[method] for base in self._kind.__mro__[:-1] if method in vars(base)]
        if method == "__init__" or not declared:
            return f"{method}(self)"
        return f"{method}({', '.join(inspect.signature(declared[-1]).parameters)})"

    def _fail(self, reason: str, error: BaseException | None = None) -> NoReturn:
        """Report a failure and raise SimulationError."""
        reason = _shorten_like_engine(f"{self._kind.__name__}.{reason}", _REASON)
        stack = None if error is None else _traceback(error)
        self._report_once(reason, stack)
        failure = SimulationError(reason, stack)
        failure.__cause__ = error
        self._failures[:] = [failure]
        raise failure

    def _report_once(self, reason: str, stack: str | None) -> None:
        """Report a failure unless it has been reported before."""
        if reason not in self._reported and len(self._reported) < _REMEMBERED:
            self._reported.add(reason)
            self._report(reason, stack or "")


def check_methods(kind: type, needs: str) -> None:
    """Raise InputError if a class lacks methods; needs: the required methods, in words."""
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    if missing:
        raise InputError(f"{kind.__name__}: has no method {', '.join(missing)}; {needs}")


def _end_child(method: str) -> NoReturn:
    """End this process, which a user's method has forked, with the exit status of `sys.exit` if called."""
    raised = sys.exc_info()[1]
    if isinstance(raised, SystemExit) and isinstance(raised.code, int | None):
        os._exit(raised.code or 0)
    if raised is not None:
        traceback.print_exception(raised)
    sys.stderr.write(
        f"swarmwright: {method}: a child process that it forked has returned and is ended; end it with "
        "os._exit, or use subprocess or multiprocessing\n"
    )
    sys.stderr.flush()
    os._exit(1)


def _get_message(error: BaseException) -> str:
    """Return the message of an exception, shortened."""
    return _shorten_like_engine(exception_text(error), _WORDS)


def _shorten_like_engine(text: str, most: int) -> str:
    """Replace lone surrogates and shorten a text, as the engine does."""
    text = text.encode(errors="replace").decode()
    return text if len(text) <= most else f"{text[: most - 3]}..."


def summarize(value: Any) -> str:  # noqa: ANN401 - any object
    """Return the representation of an object, in at most 60 characters.

    Longer arrays and tuples are represented by their type and size, which are the same in each episode, so
    that failures of the same kind are counted together.
    """
    with contextlib.suppress(Exception):
        if isinstance(value, tuple) and len(repr(value)) > 60 and len(value) > 1:
            return f"a tuple of {len(value)} ({', '.join(type(item).__name__ for item in value)})"
        text = " ".join(repr(value).split())
        if len(text) > 60 and isinstance(value, np.ndarray):
            return f"an array of {value.dtype} of the shape {value.shape}"
        return text if len(text) <= 60 else f"{text[:57]}..."
    return f"a {type(value).__name__}"


def is_gymnasium_result(returned: Any) -> bool:  # noqa: ANN401 - whatever `reset` or `step` returns
    """Return whether a result is a tuple with infos, as from a Gymnasium environment."""
    if not isinstance(returned, tuple) or len(returned) not in {2, 4, 5}:
        return False
    return isinstance(returned[-1], Mapping)


def _traceback(error: BaseException) -> str:
    """Return the traceback, beginning with the user's code."""
    folder = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120 - as in frames
    trace = error.__traceback__
    while trace is not None and os.path.dirname(os.path.abspath(trace.tb_frame.f_code.co_filename)) == folder:  # noqa: PTH100, PTH120
        trace = trace.tb_next
    text = "".join(traceback.format_exception(type(error), error, trace)).rstrip()
    return text if len(text) <= _STACK else f"...{text[3 - _STACK :]}"
