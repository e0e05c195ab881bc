"""The program `swarmwright`, also as `python -m swarmwright`."""

import atexit
import gc
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn

from swarmwright.common import installation

INTERRUPTED = 130


def _handle_signal(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line and leave with its exit status."""
    problem = installation.problem()
    if problem is not None:
        sys.exit(f"swarmwright: {problem}")
    # As Ctrl-C, also while the rest of the program is loaded, which then handles it itself.
    signal.signal(signal.SIGTERM, _handle_signal)
    # Imported objects live until the end: collect less often, so that they are not scanned repeatedly.
    gc.set_threshold(100_000, 50, 50)
    # pydantic would look through all installed packages for plug-ins of pydantic.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # NumPy's OpenBLAS starts a thread for each processor, which loops for 2^26 cycles before it sleeps: half
    # as long as the import of NumPy takes. With 2^10 cycles it is woken where it has work as well.
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "10")
    try:
        from swarmwright.cli import run  # noqa: PLC0415 - after the signals are set

        status = run()
    except KeyboardInterrupt:  # while the program itself was loaded, or on the way out
        sys.stderr.write("swarmwright: interrupted\n")
        status = INTERRUPTED
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # what is left to do takes no time
    gc.freeze()  # skip collection at exit
    if status == INTERRUPTED:
        _leave(status)
    sys.exit(status)


def _leave(status: int) -> NoReturn:
    """Exit with this status.

    If Ctrl-C arrived while Python compiled a text, as for data classes, `sys.exit` would end the
    process by the signal, although it was handled.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(status)


if __name__ == "__main__":
    main()
