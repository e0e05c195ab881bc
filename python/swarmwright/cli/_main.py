"""Entry of the program: runs a command and turns its end into a message and an exit status."""

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
from swarmwright.common.processes import more_open_files
from swarmwright.simulations.user_code.trust import asking

FAILED = 1


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status.

    arguments: without the program's name; by default those of the process.
    """
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        # A terminal that cannot show a character shows a question mark rather than an error.
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
    """Let output of a process that was started without (`>&-`) go nowhere, and input be empty.

    No other file may get the number of one of them: what a library prints would be written into it.
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
        if _interrupted(error):
            _complain("interrupted")
            return INTERRUPTED
        if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
            from swarmwright.common.files import not_utf8

            _complain(not_utf8(error))
            return click.UsageError.exit_code
        # The last resort: users never see a traceback.
        if os.environ.get("SWARMWRIGHT_DEBUG"):
            raise
        return _show_error(error)
    return result if isinstance(result, int) else 0


def _check_environment() -> None:
    """Raise InputError for a mistake in the variable that limits instruction sets."""
    if os.environ.get("SWARMWRIGHT_INSTRUCTIONS"):
        from swarmwright import _engine  # loads in 10 ms, not for --help
        from swarmwright.common.errors import engine_errors

        with engine_errors():
            _engine.check_instructions()


def _ask(question: str) -> bool:
    """Ask a person at a terminal; without a terminal, the answer is no."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    first, *rest = untrusted.lines(question)
    return click.confirm("\n".join([first, *(f"  {line}" for line in rest)]), err=True)


def _interrupted(error: BaseException) -> bool:
    """Whether an error was caused by Ctrl-C: while a class is made, Python wraps exceptions.

    A disk that fails while Ctrl-C is handled is a separate error.
    """
    seen: list[BaseException] = []  # a chain may lead back into itself
    cause: BaseException | None = error
    while cause is not None and not any(cause is earlier for earlier in seen):
        if isinstance(cause, KeyboardInterrupt):
            return True
        if isinstance(cause, OSError) or type(cause).__module__ == "sqlite3":
            return False
        seen.append(cause)
        cause = cause.__cause__ or cause.__context__
    return False


def _is_panic(error: BaseException) -> bool:
    """Whether an error is one of the engine that it did not expect."""
    return type(error).__module__ == "pyo3_runtime"


def _invoke(arguments: list[str]) -> object:
    if "_SWARMWRIGHT_COMPLETE" in os.environ:  # a shell asks for completions
        return program.main(args=arguments, prog_name="swarmwright")
    # Not `program.main`, which returns 1 for a closed pipe.
    to_read = "--json" in arguments and not {"--help", "--version"} & set(arguments)
    try:
        with (
            _output.only_results() if to_read else nullcontext(),
            _output.harmless_printing(),
            program.make_context("swarmwright", arguments) as context,
        ):
            return program.invoke(context)
    except click.exceptions.Exit as ending:
        return ending.exit_code


def _show_usage_error(error: click.ClickException) -> None:
    message = error.format_message()
    if message.endswith("?."):  # click ends what it is told with a full stop
        message = message[:-1]
    if isinstance(error, click.UsageError) and error.ctx is not None:
        help_command = f"{error.ctx.command_path} --help"
        _complain(message, hint=f"Try '{help_command}'.")
    else:
        _complain(message)


_LEFT_OUT = {"matplotlib": "matplotlib", "PIL": "pillow", "scipy": "scipy"}
"""Packages by modules: what container images leave out, since only figures and statistics need them."""


def _show_error(error: BaseException) -> int:
    """Say what went wrong; the exit status that goes with it."""
    status = getattr(error, "exit_status", None)
    if isinstance(status, int):
        cause = error.__cause__
        # Whatever could not be opened or made is only named where it was tried.
        few_files = isinstance(cause, OSError) and cause.errno == errno.EMFILE
        _complain(f"{error}{_remedy(errno.EMFILE) if few_files else ''}")
        return status
    engine = sys.modules.get("swarmwright._engine")
    if engine is not None and isinstance(error, engine.InputError):
        _complain(str(error))
        return click.UsageError.exit_code
    if engine is not None and isinstance(error, engine.EngineError):
        _complain(str(error))
        return FAILED
    if _no_thread(error):
        _complain(f"no thread or process could be started: {_MORE_MEMORY}")
        return FAILED
    # NumPy's arrays of the engine that could not be made.
    if isinstance(error, MemoryError) or (_is_panic(error) and "pointer is null" in str(error)):
        _complain(
            "there is not enough memory: take a smaller population, or let the process have more (ulimit -v, "
            "the limits of a container or of a cluster's job)"
        )
        return FAILED
    if isinstance(error, ModuleNotFoundError) and error.name in _LEFT_OUT:
        _complain(f"this needs the package {_LEFT_OUT[error.name]}: pip install {_LEFT_OUT[error.name]}")
        return click.UsageError.exit_code
    plug_in_code = sys.modules.get("swarmwright.common.plug_in_code")  # not imported: then no plug-in has run
    found = None if plug_in_code is None else plug_in_code.failure(error)
    if found is not None:
        _complain(str(found))
        return FAILED
    if isinstance(error, OSError) and error.errno is not None:
        if error.filename is None and error.errno in {errno.EAGAIN, errno.ENOMEM}:  # of a new process
            _complain(f"{error.strerror}: {_MORE_MEMORY}")
            return FAILED
        where = f"{error.filename}: " if error.filename else ""
        _complain(f"{where}{error.strerror}{_remedy(error.errno)}")
        return FAILED
    if isinstance(error, ImportError):
        unsuitable = import_problem(error)
        if unsuitable is not None:
            _complain(unsuitable)
            return FAILED
    _complain(
        f"internal error: {type(error).__name__}: {error}\n"
        "This is a bug in Swarmwright. Please report it with what SWARMWRIGHT_DEBUG=1 shows."
    )
    return FAILED


_MORE_MEMORY = (
    "no memory or threads are left for this process; let it have more (ulimit -v, ulimit -u, the limits of a "
    "container or of a cluster's job), or start fewer servers"
)


def _no_thread(error: BaseException) -> bool:
    """Whether the system refused a thread, in Python or in the engine."""
    if isinstance(error, RuntimeError):
        return "can't start new thread" in str(error)
    return _is_panic(error) and any(text in str(error) for text in ("ThreadPoolBuildError", "spawn thread"))


def _remedy(number: int) -> str:
    """Return what helps against an error of the system, as far as that is known."""
    if number == errno.ENOSPC:
        return "; free some space and run again"
    if number == errno.EMFILE:
        return f"; {more_open_files()}"
    return ""


def _complain(message: str, *, hint: str = "") -> None:
    with suppress(OSError):  # the pipe is closed; the exit status remains
        _output.complain(message, hint=hint)


def _reader_gone() -> None:
    """The reader of the output left (`| head`): end silently, and keep Python from reporting it at exit."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, sys.stdout.fileno())
    os.close(sink)


_PACKAGES = {"PIL": "pillow", "ruamel": "ruamel.yaml"}
"""Packages by the modules that are called otherwise, also where they are not installed."""
_REQUIREMENT = re.compile(r"(?P<package>[\w.-]+)\s*(?P<versions>[^;]*)(?P<marker>.*)")


def import_problem(error: ImportError) -> str | None:
    """Return which required package is missing or unsuitable, and what to install; None for other modules."""
    module = (error.name or "").partition(".")[0]
    if not module or module == "swarmwright":
        return None
    package = _PACKAGES.get(module) or next(iter(metadata.packages_distributions().get(module, ())), module)
    for owner in ("swarmwright", *_required("swarmwright")):
        versions = _required(owner).get(_normalized(package))
        if versions is None:
            continue
        try:
            found = f"{metadata.version(package)} cannot be used ({str(error).splitlines()[0]})"
        except metadata.PackageNotFoundError:
            found = "is not installed"
        needing = "Swarmwright" if owner == "swarmwright" else owner
        wanted = f"{package}{versions}"
        return f"the package {package} {found}: {needing} needs {wanted}: pip install '{wanted}'"
    return None


def _required(package: str) -> dict[str, str]:
    """Return the versions that a package requires of others, `>=2.10,<3`, without those of its extras."""
    try:
        lines = metadata.requires(package) or []
    except metadata.PackageNotFoundError:
        return {}
    found = [
        match for line in lines if (match := _REQUIREMENT.match(line)) and "extra" not in match["marker"]
    ]
    return {_normalized(requirement["package"]): requirement["versions"].strip() for requirement in found}


def _normalized(package: str) -> str:
    """Return the name of a package as it is compared."""
    return re.sub(r"[-_.]+", "-", package).lower()
