"""Calls of a user's code: what it raises is explained, and reported once."""

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
from swarmwright.common.errors import EpisodeError, InputError, SimulationError, reworded
from swarmwright.common.tracebacks import is_installed, words_of
from swarmwright.common.tracebacks import shown as shown_path

_STACK = 8000
"""Characters of a traceback that are kept, of its end, which has the exception."""

_REASON = 2000
"""Characters of a reason: the engine cuts longer ones (`MOST_REASON`), and failures are found by theirs."""

_WORDS = 1000
"""Characters of what an exception says in a reason: the line that raised it follows."""

_HERE = Path(__file__).parent

OBSERVATIONS_ALONE = (
    "expected the observations alone, not a tuple as of an environment of Gymnasium: done() says whether the "
    "episode has ended, fitness() how good it was; such an environment itself needs no class, "
    "see docs/how-to/use-environments.md"
)
"""What is said of the result of `reset` or `step` of a simulation that was written like an environment."""

_REMEMBERED = 100
"""Different failures that are reported, so that each is reported once."""

Made = TypeVar("Made")


class Calls(Generic[Made]):
    """Calls of one object of a user's class.

    Args:
        kind: the class.
        report: gets (reason, traceback) of a failure, once for each reason.
    """

    _beginning: ClassVar[str]
    """The method that gets the parameters, and may refuse them."""
    _needs: ClassVar[str]
    """What the class has to define, in words."""

    def __init__(self, kind: type[Made], report: Callable[[str, str], None] | None = None) -> None:
        self._kind = kind
        self._report = report or (lambda _reason, _traceback: None)
        self._reported: set[str] = set()
        self._failures: list[SimulationError] = []  # the last one, of all hosts of a class
        self._object: Made | None = None

    @property
    def failure(self) -> SimulationError | None:
        """What the code failed with last, chained to what it raised; None since `forget_failure`."""
        return self._failures[0] if self._failures else None

    def forget_failure(self) -> None:
        """Let go of the last failure, whose traceback holds the frames of the code."""
        self._failures.clear()

    def _reports_with(self, other: Self) -> None:
        """Report failures together with another host of the class."""
        self._reported, self._failures = other._reported, other._failures

    def _call(self, method: str, *arguments: Any) -> Any:  # noqa: ANN401 - whatever the code takes and returns
        """Call a method of the user's; what it raises becomes SimulationError."""
        try:
            return self._called(method, getattr(self._object, method), *arguments)
        except (InputError, _engine.InputError) as error:
            if method == self._beginning:  # about the parameters
                raise _engine.InputError(str(error)) from None
            self._fail(self._cause(method, error), error)
        except EpisodeError as error:  # it says where and what
            failure = reworded(error, _as_engine_keeps(str(error), _REASON))
            self._tell(str(failure), failure.stack)
            self._failures[:] = [failure]
            raise failure from error.__cause__
        except KeyboardInterrupt:
            raise
        # Also `sys.exit` ends only the episode.
        except BaseException as error:  # noqa: BLE001 - a user's code may fail in any way
            self._fail(self._cause(method, error), error)

    def _called(self, method: str, function: Callable[..., Any], *arguments: Any) -> Any:  # noqa: ANN401
        """Call a function; a child process that it forks, and that returns from it, ends here.

        It would go on as a second server with the connections of this one.
        """
        process = os.getpid()
        try:
            return function(*arguments)
        finally:
            if os.getpid() != process:
                _end_child(f"{self._kind.__name__}.{method}")

    def _made(self) -> Made:
        """Make an object. Raises InputError where it cannot be made with what is there."""
        check_methods(self._kind, self._needs)
        try:
            made: Made = self._called("__init__", self._kind)
            return made
        except InputError:  # what it needs is not there
            raise
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - as in `_call`
            self._fail(self._cause("__init__", error), error)

    def _cause(self, method: str, error: BaseException) -> str:
        """What was raised, and where: the last line of the class's file that led there.

        Where there is none, such as in a method of a base class, it is the last line of code that is not
        installed, and else the last of all.
        """
        frames = traceback.extract_tb(error.__traceback__)[1:]
        if isinstance(error, TypeError) and all(frame.filename == __file__ for frame in frames):
            # Not raised in the method: it cannot be called in this way.
            return self._not_called(method, error)
        of_adapter = bool(frames) and Path(frames[-1].filename).is_relative_to(_HERE)
        if of_adapter and isinstance(error, SimulationError):  # the adapter says what is wrong
            return f"{method}: {_message_of(error)}"
        file = getattr(sys.modules.get(self._kind.__module__), "__file__", None)
        mine = [frame for frame in frames if frame.filename == file and not is_installed(frame.filename)]
        mine = mine or [frame for frame in frames if not is_installed(frame.filename)] or frames
        where = f" ({shown_path(mine[-1].filename)}:{mine[-1].lineno})" if mine else ""
        words = _message_of(error)
        return f"{method}: {type(error).__name__}{': ' if words else ''}{words}{where}"

    def _not_called(self, method: str, error: TypeError) -> str:
        """What was raised because a method takes other arguments, or is none, and where it is defined."""
        found = self._kind if method == "__init__" else getattr(self._object, method)
        code = getattr(inspect.unwrap(getattr(self._kind, method)), "__code__", None)
        file = getattr(sys.modules.get(self._kind.__module__), "__file__", None)
        place = ""
        if code is not None:
            place = f" ({shown_path(code.co_filename)}:{code.co_firstlineno})"
        elif file is not None:
            place = f" ({shown_path(file)})"
        what = f"TypeError: {_message_of(error)}" if callable(found) else f"{short(found)} is no method"
        return f"{method}: {what}{place}; expected {self._signature(method)}"

    def _signature(self, method: str) -> str:
        """How a method has to be defined: as in the base class that declares it."""
        declared = [vars(base)[method] for base in self._kind.__mro__[:-1] if method in vars(base)]
        if method == "__init__" or not declared:
            return f"{method}(self)"
        return f"{method}({', '.join(inspect.signature(declared[-1]).parameters)})"

    def _fail(self, reason: str, error: BaseException | None = None) -> NoReturn:
        """Report and raise."""
        reason = _as_engine_keeps(f"{self._kind.__name__}.{reason}", _REASON)
        stack = None if error is None else _traceback(error)
        self._tell(reason, stack)
        failure = SimulationError(reason, stack)
        failure.__cause__ = error
        self._failures[:] = [failure]
        raise failure

    def _tell(self, reason: str, stack: str | None) -> None:
        """Report a failure, the first time."""
        if reason not in self._reported and len(self._reported) < _REMEMBERED:
            self._reported.add(reason)
            self._report(reason, stack or "")


def check_methods(kind: type, needs: str) -> None:
    """Raise InputError where a class lacks methods; needs: which it has to define, in words."""
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    if missing:
        raise InputError(f"{kind.__name__}: has no method {', '.join(missing)}; {needs}")


def _end_child(method: str) -> NoReturn:
    """End this process, which a user's method has forked: as `sys.exit` says if it called that."""
    raised = sys.exc_info()[1]
    if isinstance(raised, SystemExit) and isinstance(raised.code, int | None):
        os._exit(raised.code or 0)
    if raised is not None:
        traceback.print_exception(raised)
    sys.stderr.write(
        f"swarmwright: {method}: a process that it forked ends where it returns; end it with os._exit, "
        "or use subprocess or multiprocessing\n"
    )
    sys.stderr.flush()
    os._exit(1)


def _message_of(error: BaseException) -> str:
    """Return what an exception says, shortened."""
    return _as_engine_keeps(words_of(error), _WORDS)


def _as_engine_keeps(text: str, most: int) -> str:
    """Return a text as the engine would keep it: without lone surrogates, and shortened."""
    text = text.encode(errors="replace").decode()
    return text if len(text) <= most else f"{text[: most - 3]}..."


def short(value: Any) -> str:  # noqa: ANN401 - any object
    """Return what an object is, in at most 60 characters.

    Of arrays and tuples that are longer it is their type and size: the same in each episode, so that failures
    of the same kind are counted together.
    """
    with contextlib.suppress(Exception):
        if isinstance(value, tuple) and len(repr(value)) > 60 and len(value) > 1:
            return f"a tuple of {len(value)} ({', '.join(type(item).__name__ for item in value)})"
        text = " ".join(repr(value).split())
        if len(text) > 60 and isinstance(value, np.ndarray):
            return f"an array of {value.dtype} of the shape {value.shape}"
        return text if len(text) <= 60 else f"{text[:57]}..."
    return f"a {type(value).__name__}"


def is_of_gymnasium(returned: Any) -> bool:  # noqa: ANN401 - whatever `reset` or `step` returns
    """Whether observations come with infos, or with rewards and flags, as from environments of Gymnasium."""
    if not isinstance(returned, tuple) or len(returned) not in {2, 4, 5}:
        return False
    return isinstance(returned[-1], Mapping)


def _traceback(error: BaseException) -> str:
    """The traceback from the user's code on, without the lines of this folder."""
    folder = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120 - as in frames
    trace = error.__traceback__
    while trace is not None and os.path.dirname(os.path.abspath(trace.tb_frame.f_code.co_filename)) == folder:  # noqa: PTH100, PTH120
        trace = trace.tb_next
    text = "".join(traceback.format_exception(type(error), error, trace)).rstrip()
    return text if len(text) <= _STACK else f"...{text[3 - _STACK :]}"
