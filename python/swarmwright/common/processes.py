"""Properties of the process: forks, hash seed, limit of open files, working folder."""

import errno
import os
import resource
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from swarmwright.common.errors import RunError

_process: int | None = None
"""Id of the process that first used the engine's threads; a forked child inherits that of its parent."""


def use_threads() -> None:
    """Record that this process uses the engine's threads.

    Raises RunError if it was forked from a process that has used them.
    """
    global _process  # noqa: PLW0603 - one for the process, as the threads are
    current = os.getpid()
    if _process is None:
        _process = current
    elif _process != current:
        raise RunError(
            f"the engine cannot be used in process {current}, which was forked from process {_process} after "
            "that had used it: the engine's threads do not survive a fork; start processes with "
            'multiprocessing.get_context("spawn") or "forkserver", environments of Gymnasium by '
            'AsyncVectorEnv(.., context="forkserver"), or use the engine only after the fork'
        )


VARIABLE = "PYTHONHASHSEED"
_FIXED = "0"
"""The default seed of started processes."""
RANDOM = "random"


def child_hash_seed(environment: Mapping[str, str] = os.environ) -> str:
    """Return the hash seed of processes started in an environment."""
    value = environment.get(VARIABLE, "")
    return _FIXED if value in {"", RANDOM} else value


def current_hash_seed() -> str:
    """Return the hash seed of this process; `random` if unknown."""
    if sys.flags.ignore_environment:
        return RANDOM
    return os.environ.get(VARIABLE) or RANDOM if sys.flags.hash_randomization else _FIXED


def hash_seed_variables(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the environment variable that sets the seed of `child_hash_seed`."""
    return {VARIABLE: child_hash_seed(environment)}


_WANTED_FILES = 65536
"""Open files, more than a broker needs with all of its clients."""


def allow_more_open_files() -> None:
    """Raise the soft limit of open files (`ulimit -Sn`, often 1024) to the hard limit, at most 65536."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    target = _WANTED_FILES if hard == resource.RLIM_INFINITY else min(hard, _WANTED_FILES)
    if soft != resource.RLIM_INFINITY and soft < target:
        with suppress(ValueError, OSError):  # macOS allows fewer than the hard limit
            resource.setrlimit(resource.RLIMIT_NOFILE, (target, hard))


def has_no_more_files() -> bool:
    """Return whether this process has reached its limit of open files."""
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        return error.errno == errno.EMFILE
    return False


def advise_open_files() -> str:
    """Return the remedy for too many open files."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return f"the limit of this process is {most}; raise it (ulimit -n 4096), or start fewer servers"


class StablePath:
    """A path that keeps its meaning if the working folder of the process changes."""

    def __init__(self, path: Path) -> None:
        self._given = path
        self._working = None if path.is_absolute() else _working_folder()

    @property
    def path(self) -> Path:
        """The original path, or the absolute one if the working folder has changed."""
        stays = self._working is None or self._working == _working_folder()
        return self._given if stays else self.absolute

    @property
    def absolute(self) -> Path:
        """The absolute path."""
        return self._given if self._working is None else self._working / self._given


def _working_folder() -> Path | None:
    """Return the working folder; None if it was deleted."""
    with suppress(OSError):
        return Path.cwd()
    return None
