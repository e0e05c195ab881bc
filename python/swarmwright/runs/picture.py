"""Draw `fitness.png` in a child process, so that a run's result does not wait for Matplotlib."""

import atexit
import os
import subprocess
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from threading import Lock, Timer

from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.runs.store.database import FILE as STORE

FILE = "fitness.png"
_LONGEST_DRAWING_S = 60.0
"""Seconds until a drawing process is abandoned."""

_DELAY_S = 0.05
"""Delay of the drawing process, whose start slows down this process for milliseconds."""

_lock = Lock()
_waiting: list[Path] = []
_process: subprocess.Popen[bytes] | None = None
_timer: Timer | None = None


def is_enabled() -> bool:
    """Return whether runs end with a plot: Matplotlib is installed, and SWARMWRIGHT_PLOT is not 0."""
    return os.environ.get("SWARMWRIGHT_PLOT") != "0" and find_spec("matplotlib") is not None


def draw_later(folder: Path) -> None:
    """Draw the plot of the run in `folder` soon, if plots are enabled.

    This process waits for all plots before it ends, see `wait`.
    """
    global _timer  # noqa: PLW0603 - shared by the whole process
    if not is_enabled():
        return
    with _lock:
        _waiting.append(folder.absolute())
        if _timer is None or not _timer.is_alive():
            _timer = Timer(_DELAY_S, _start_now)
            _timer.daemon = True
            with suppress(RuntimeError):  # no memory or threads are left; `wait` draws it
                _timer.start()


def draw_missing(folder: Path) -> None:
    """Draw the plot of a finished run soon if it is missing or empty, for example after a full disk."""
    file = folder / FILE
    if os.access(folder, os.W_OK) and not (file.exists() and file.stat().st_size):
        draw_later(folder)


def wait() -> None:
    """Wait until all plots are drawn. Errors are printed to standard error."""
    with _lock:
        if _timer is not None:
            _timer.cancel()
        if _process is None:
            _start()
        while _process is not None:
            try:
                _process.wait(_LONGEST_DRAWING_S)
            except subprocess.TimeoutExpired:
                _process.kill()
                _process.wait()
            _start()


@atexit.register
def _finish_at_exit() -> None:
    try:
        wait()
    except KeyboardInterrupt:
        pass  # the process continues by itself
    except (OSError, MemoryError) as error:
        sys.stderr.write(f"swarmwright: the plot cannot be drawn: {error}\n")


def _start_now() -> None:
    """Draw all waiting runs, or leave them for later if a process is still drawing others."""
    global _timer  # noqa: PLW0603 - shared by the whole process
    with _lock:
        _timer = None
        if _process is None or _process.poll() is not None:
            _start()


def _start() -> None:
    """Draw all waiting runs in one process."""
    global _process  # noqa: PLW0603 - shared by the whole process
    _process = None
    if not _waiting:
        return
    command = [sys.executable, "-P", "-m", __spec__.name, *map(str, _waiting)]
    _waiting.clear()
    # A new session, so that Ctrl-C does not interrupt it. A single thread of OpenBLAS saves memory.
    _process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )


def draw(folder: Path) -> None:
    """Draw the plot of a run now. Raises InputError when it has no generation, or cannot be written."""
    from swarmwright.display.figures import style
    from swarmwright.display.figures.run import fitness
    from swarmwright.runs.run import Run

    run = Run.open(folder)
    if not run.history:
        raise InputError(f"{folder}: has no finished generation to draw")
    style.save(fitness(run), folder / FILE)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        try:
            draw(Path(name))
        except (SwarmwrightError, OSError) as error:
            # Ignore runs that have been deleted meanwhile.
            if (Path(name) / STORE).exists():
                sys.stderr.write(f"swarmwright: {error}\n")
