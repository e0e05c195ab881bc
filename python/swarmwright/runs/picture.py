"""`fitness.png`, drawn by a child process, so that a run's result does not wait for Matplotlib."""

import atexit
import os
import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from threading import Lock

from swarmwright.core.errors import InputError

FILE = "fitness.png"
_LONGEST = 60.0
"""Seconds until a drawing process is abandoned."""

_IDLE = 60.0
"""Seconds after which a process that was started ahead and has nothing to draw ends."""

_lock = Lock()
_waiting: list[Path] = []
_process: subprocess.Popen[bytes] | None = None
_ready: subprocess.Popen[bytes] | None = None  # started ahead


def prepare() -> None:
    """Start the process that draws before there is anything to draw, for programs that end with the run."""
    global _ready  # noqa: PLW0603 - there is one, as there is one interpreter
    with _lock:
        if _ready is None:
            _ready = _popen([], stdin=subprocess.PIPE)


def draw_later(folder: Path) -> None:
    """Have the plot of the run in `folder` drawn soon. This process draws all before it ends, see `wait`."""
    with _lock:
        _waiting.append(folder.absolute())
        if _process is None or _process.poll() is not None:
            _start()


def wait() -> None:
    """Wait until all plots are drawn. Errors are printed on standard error."""
    with _lock:
        while _process is not None:
            try:
                _process.wait(_LONGEST)
            except subprocess.TimeoutExpired:
                _process.kill()
                _process.wait()
            _start()


@atexit.register
def _at_exit() -> None:
    with suppress(KeyboardInterrupt):  # the process continues by itself
        wait()
        if _ready is not None:
            _ready.kill()
            _ready.communicate()


def _start() -> None:
    """Draw all waiting runs in one process."""
    global _process, _ready  # noqa: PLW0603
    _process = None
    if not _waiting:
        return
    folders = [str(folder) for folder in _waiting]
    _waiting.clear()
    if _ready is not None:
        _process, _ready = _ready, None
        try:
            assert _process.stdin is not None
            _process.stdin.write(b"\0".join(map(os.fsencode, folders)))
            _process.stdin.close()
        except BrokenPipeError:  # it had waited for too long
            _process.wait()
        else:
            return
    _process = _popen(folders, stdin=subprocess.DEVNULL)


def _popen(folders: list[str], stdin: int) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-P", "-m", __spec__.name, *folders]
    # A new session, so that Ctrl-C, which ends the tool, does not interrupt it.
    return subprocess.Popen(command, stdin=stdin, stdout=subprocess.DEVNULL, start_new_session=True)


def _asked_for() -> list[str]:
    """Return the folders that the tool writes, once it does."""
    from swarmwright.figures import run, style  # noqa: F401 - what takes long meanwhile

    if not select.select([sys.stdin], [], [], _IDLE)[0]:
        return []
    return [os.fsdecode(name) for name in sys.stdin.buffer.read().split(b"\0") if name]


def draw(folder: Path) -> None:
    """Draw the plot of a run now. Raises InputError when it has no generation, or cannot be written."""
    from swarmwright.figures import style
    from swarmwright.figures.run import fitness
    from swarmwright.runs.run import Run

    run = Run.open(folder)
    if not run.history:
        raise InputError(f"{folder}: holds no finished generation to draw")
    style.save(fitness(run), folder / FILE)


if __name__ == "__main__":
    for name in sys.argv[1:] or _asked_for():
        try:
            draw(Path(name))
        except InputError as error:
            # A missing folder was deleted meanwhile, which is not an error.
            if Path(name).exists():
                sys.stderr.write(f"swarmwright: {error}\n")
