"""Entry point of the program: runs a command and converts errors to messages and exit statuses."""

import errno
import os
import re
import sys
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from importlib import metadata

import click

from swarmwright.cli import _output
from swarmwright.cli._commands import program
from swarmwright.cli._signals import INTERRUPTED, terminate_like_interrupt
from swarmwright.common import untrusted
from swarmwright.common.processes import advise_open_files
from swarmwright.simulations.user_code.trust import asking

FAILED = 1


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status.

    arguments: without the program's name; by default those of the process.
    """
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        # A terminal shows a question mark for a character that it cannot show, instead of an error.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    status = 0
    try:
        with terminate_like_interrupt(), asking(_ask):
            status = _status(arguments)
            sys.stdout.flush()
    except KeyboardInterrupt:
        status = INTERRUPTED
    except BrokenPipeError:
        _reader_gone()
    return status


def _open_closed_streams() -> None:
    """Open standard streams that were closed (`>&-`) as empty input and discarded output.

    Otherwise another file could get their descriptor, and output of a library would be written into it.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115, PTH123 - to the end


def _status(arguments: Sequence[str] | None) -> int:
    try:
        _check_environment()
        result = _invoke(sys.argv[1:] if arguments is None else list(arguments))
    except click.exceptions.NoArgsIsHelpError as error:
        # The help of a command, without click's additions.
        sys.stderr.write(f"{error.format_message()}\n")
        return error.exit_code
    except click.ClickException as error:
        _show_usage_error(error)
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        _complain("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and not _is_panic(error):
            raise
        if _is_interrupt(error):
            _complain("interrupted")
            return INTERRUPTED
        if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
            from swarmwright.common.files import explain_not_utf8

            _complain(explain_not_utf8(error))
            return click.UsageError.exit_code
        # Users never see a traceback.
        if os.environ.get("SWARMWRIGHT_DEBUG"):
            raise
        message, status = _describe_error(error)
        _complain(message)
        return status
    return result if isinstance(result, int) else 0


def _check_environment() -> None:
    """Raise InputError for an invalid SWARMWRIGHT_INSTRUCTIONS."""
    if os.environ.get("SWARMWRIGHT_INSTRUCTIONS"):
        from swarmwright import _engine  # takes 10 ms, which --help avoids
        from swarmwright.common.errors import engine_errors

        with engine_errors():
            _engine.check_instructions()


def _ask(question: str) -> bool:
    """Ask the user at a terminal; return False without a terminal."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    first, *rest = untrusted.escape_lines(question)
    return click.confirm("\n".join([first, *(f"  {line}" for line in rest)]), err=True)


def _is_interrupt(error: BaseException) -> bool:
    """Return whether Ctrl-C caused an error: Python wraps exceptions raised while a class is created.

    A failing disk while Ctrl-C is handled is a separate error.
    """
    causes: list[BaseException] = []  # a chain may lead back into itself
    cause: BaseException | None = error
    while cause is not None and not any(cause is earlier for earlier in causes):
        if isinstance(cause, KeyboardInterrupt):
            return True
        if isinstance(cause, OSError) or type(cause).__module__ == "sqlite3":
            return False
        causes.append(cause)
        cause = cause.__cause__ or cause.__context__
    return False


def _is_panic(error: BaseException) -> bool:
    """Return whether an error is a panic of the engine."""
    return type(error).__module__ == "pyo3_runtime"


def _invoke(arguments: list[str]) -> object:
    if "_SWARMWRIGHT_COMPLETE" in os.environ:  # a shell asks for completions
        return program.main(args=arguments, prog_name="swarmwright")
    # Not `program.main`, which returns 1 for a closed pipe.
    to_read = "--json" in arguments and not {"--help", "--version"} & set(arguments)
    try:
        with (
            _output.reserve_stdout() if to_read else nullcontext(),
            _output.ignore_print_errors(),
            program.make_context("swarmwright", arguments) as context,
        ):
            return program.invoke(context)
    except click.exceptions.Exit as ending:
        return ending.exit_code


def _show_usage_error(error: click.ClickException) -> None:
    message = error.format_message()
    if message.endswith("?."):  # click appends a full stop
        message = message[:-1]
    if isinstance(error, click.UsageError) and error.ctx is not None:
        help_command = f"{error.ctx.command_path} --help"
        _complain(message, hint=f"Try '{help_command}'.")
    else:
        _complain(message)


_LEFT_OUT = {"matplotlib": "matplotlib", "PIL": "pillow", "scipy": "scipy"}
"""Module -> package that container images leave out, since only figures and statistics need it."""


def _describe_error(error: BaseException) -> tuple[str, int]:
    """Return the message on an error, and its exit status."""
    status = getattr(error, "exit_status", None)
    if isinstance(status, int):
        cause = error.__cause__
        # The message does not mention the limit on open files.
        few_files = isinstance(cause, OSError) and cause.errno == errno.EMFILE
        return f"{error}{_remedy(errno.EMFILE) if few_files else ''}", status
    engine = sys.modules.get("swarmwright._engine")
    if engine is not None and isinstance(error, engine.InputError | engine.EngineError):
        is_input = isinstance(error, engine.InputError)
        return str(error), click.UsageError.exit_code if is_input else FAILED
    if _no_thread(error):
        return f"cannot start a thread or process: {_MORE_MEMORY}", FAILED
    # The engine panics with a null pointer if it cannot allocate NumPy arrays.
    if isinstance(error, MemoryError) or (_is_panic(error) and "pointer is null" in str(error)):
        return (
            "out of memory: use a smaller population, or raise the limit (ulimit -v, "
            "or the limits of the container or cluster job)"
        ), FAILED
    if isinstance(error, ModuleNotFoundError) and error.name in _LEFT_OUT:
        package = _LEFT_OUT[error.name]
        return f"the package {package} is missing: pip install {package}", click.UsageError.exit_code
    plug_in_code = sys.modules.get("swarmwright.common.plug_in_code")  # imported only if a plug-in has run
    failure = None if plug_in_code is None else plug_in_code.find_failure(error)
    if failure is not None:
        return str(failure), FAILED
    if isinstance(error, OSError) and error.errno is not None:
        if error.filename is None and error.errno in {errno.EAGAIN, errno.ENOMEM}:  # of a new process
            return f"{error.strerror}: {_MORE_MEMORY}", FAILED
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror}{_remedy(error.errno)}", FAILED
    unsuitable = import_problem(error) if isinstance(error, ImportError) else None
    return unsuitable or (
        f"internal error: {type(error).__name__}: {error}\n"
        "This is a bug in Swarmwright. Please report it with what SWARMWRIGHT_DEBUG=1 shows."
    ), FAILED


_MORE_MEMORY = (
    "no memory or threads are left for this process; raise its limits (ulimit -v, ulimit -u, those of the "
    "container or cluster job), or start fewer servers"
)


def _no_thread(error: BaseException) -> bool:
    """Return whether the system refused a thread, in Python or in the engine."""
    if isinstance(error, RuntimeError):
        return "can't start new thread" in str(error)
    return _is_panic(error) and any(text in str(error) for text in ("ThreadPoolBuildError", "spawn thread"))


def _remedy(number: int) -> str:
    """Return the remedy for a system error, empty if unknown."""
    if number == errno.ENOSPC:
        return "; free some space and run again"
    if number == errno.EMFILE:
        return f"; {advise_open_files()}"
    return ""


def _complain(message: str, *, hint: str = "") -> None:
    with suppress(OSError):  # the pipe is closed; the exit status remains
        _output.complain(message, hint=hint)


def _reader_gone() -> None:
    """End silently after the reader of the output has left (`| head`); Python must not report it at exit."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, sys.stdout.fileno())
    os.close(sink)


_PACKAGES = {"PIL": "pillow", "ruamel": "ruamel.yaml"}
"""Module -> package with another name, even if it is not installed."""
_REQUIREMENT = re.compile(r"(?P<package>[\w.-]+)\s*(?P<versions>[^;]*)(?P<marker>.*)")


def import_problem(error: ImportError) -> str | None:
    """Return a message on a missing or unsuitable package that is required; None for other modules."""
    module = (error.name or "").partition(".")[0]
    if not module or module == "swarmwright":
        return None
    package = _PACKAGES.get(module) or next(iter(metadata.packages_distributions().get(module, ())), module)
    for owner in ("swarmwright", *_read_requirements("swarmwright")):
        versions = _read_requirements(owner).get(_normalize(package))
        if versions is None:
            continue
        try:
            state = f"{metadata.version(package)} cannot be used ({str(error).splitlines()[0]})"
        except metadata.PackageNotFoundError:
            state = "is not installed"
        needing = "Swarmwright" if owner == "swarmwright" else owner
        requirement = f"{package}{versions}"
        return f"the package {package} {state}: {needing} needs {requirement}: pip install '{requirement}'"
    return None


def _read_requirements(package: str) -> dict[str, str]:
    """Return package -> required versions, such as `>=2.10,<3`, without extras."""
    try:
        lines = metadata.requires(package) or []
    except metadata.PackageNotFoundError:
        return {}
    matches = [
        match for line in lines if (match := _REQUIREMENT.match(line)) and "extra" not in match["marker"]
    ]
    return {_normalize(requirement["package"]): requirement["versions"].strip() for requirement in matches}


def _normalize(package: str) -> str:
    """Normalize the name of a package for comparison."""
    return re.sub(r"[-_.]+", "-", package).lower()
