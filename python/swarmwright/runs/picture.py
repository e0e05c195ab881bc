"""`fitness.png`, drawn by a child process, so that a run's result does not wait for Matplotlib."""

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

_DELAY = 0.05
"""Seconds until a process is started to draw: its start takes milliseconds from what is going on."""

_lock = Lock()
_waiting: list[Path] = []
_process: subprocess.Popen[bytes] | None = None
_timer: Timer | None = None


def wanted() -> bool:
    """Return whether runs end with a plot: unless SWARMWRIGHT_PLOT=0, or Matplotlib is not installed."""
    return os.environ.get("SWARMWRIGHT_PLOT") != "0" and find_spec("matplotlib") is not None


def draw_later(folder: Path) -> None:
    """Have the plot of the run in `folder` drawn soon, if it is wanted.

    This process draws all before it ends, see `wait`.
    """
    global _timer  # noqa: PLW0603 - there is one, as there is one interpreter
    if not wanted():
        return
    with _lock:
        _waiting.append(folder.absolute())
        if _timer is None or not _timer.is_alive():
            _timer = Timer(_DELAY, _start_now)
            _timer.daemon = True
            with suppress(RuntimeError):  # no memory or threads are left; `wait` draws it
                _timer.start()


def draw_missing(folder: Path) -> None:
    """Have the plot of a finished run drawn soon where it is missing or empty, because a disk was full."""
    file = folder / FILE
    if os.access(folder, os.W_OK) and not (file.exists() and file.stat().st_size):
        draw_later(folder)


def wait() -> None:
    """Wait until all plots are drawn. Errors are printed on standard error."""
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
def _at_exit() -> None:
    try:
        wait()
    except KeyboardInterrupt:
        pass  # the process continues by itself
    except (OSError, MemoryError) as error:
        sys.stderr.write(f"swarmwright: no plot is drawn: {error}\n")


def _start_now() -> None:
    """Draw all waiting runs, unless a process is drawing others; they are drawn after those then."""
    global _timer  # noqa: PLW0603 - there is one, as there is one interpreter
    with _lock:
        _timer = None
        if _process is None or _process.poll() is not None:
            _start()


def _start() -> None:
    """Draw all waiting runs in one process."""
    global _process  # noqa: PLW0603 - there is one, as there is one interpreter
    _process = None
    if not _waiting:
        return
    command = [sys.executable, "-P", "-m", __spec__.name, *map(str, _waiting)]
    _waiting.clear()
    # A new session, so that Ctrl-C, which ends the tool, does not interrupt it. No linear algebra is needed,
    # for which each thread of OpenBLAS takes memory.
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
        raise InputError(f"{folder}: holds no finished generation to draw")
    style.save(fitness(run), folder / FILE)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        try:
            draw(Path(name))
        except (SwarmwrightError, OSError) as error:
            # A run may have been deleted meanwhile; its folder may go last, or be another's already.
            if (Path(name) / STORE).exists():
                sys.stderr.write(f"swarmwright: {error}\n")
