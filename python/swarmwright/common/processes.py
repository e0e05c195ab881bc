"""This process: forks, its hash seed, its limit of open files, paths from its working folder."""

import errno
import os
import resource
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from swarmwright.common.errors import RunError

_process: int | None = None
"""That in which the engine's threads were first used; a forked child has the number of its parent here."""


def use_threads() -> None:
    """Note that the engine's threads are used in this process.

    Raises RunError when the process was forked from one that has used them.
    """
    global _process  # noqa: PLW0603 - one for the process, as the threads are
    here = os.getpid()
    if _process is None:
        _process = here
    elif _process != here:
        raise RunError(
            f"the engine cannot be used in process {here}, which was forked from process {_process} after "
            "that had used it: the engine's threads do not survive a fork; start processes by "
            'multiprocessing.get_context("spawn") or "forkserver", environments of Gymnasium by '
            'AsyncVectorEnv(.., context="forkserver"), or use the engine only after the fork'
        )


VARIABLE = "PYTHONHASHSEED"
_FIXED = "0"
"""The seed of processes that are started, unless the environment names one."""
RANDOM = "random"


def child_hash_seed(environment: Mapping[str, str] = os.environ) -> str:
    """Return the hash seed of processes that are started in an environment."""
    given = environment.get(VARIABLE, "")
    return _FIXED if given in {"", RANDOM} else given


def current_hash_seed() -> str:
    """Return the hash seed of this process; `random` where it is not known."""
    if sys.flags.ignore_environment:
        return RANDOM
    return os.environ.get(VARIABLE) or RANDOM if sys.flags.hash_randomization else _FIXED


def hash_seed_variables(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the environment variable by which a process has the seed of `child_hash_seed`."""
    return {VARIABLE: child_hash_seed(environment)}


_WANTED_FILES = 65536
"""Files that a broker with its most clients has open, and more."""


def allow_more_open_files() -> None:
    """Raise the soft limit of open files (`ulimit -Sn`, often 1024) to the hard one, at most 65536."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _WANTED_FILES if hard == resource.RLIM_INFINITY else min(hard, _WANTED_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with suppress(ValueError, OSError):  # macOS: fewer than the hard limit says
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def has_no_more_files() -> bool:
    """Whether this process has as many files open as it may."""
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        return error.errno == errno.EMFILE
    return False


def advise_open_files() -> str:
    """Return what to do where a file cannot be opened since too many are open."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return f"this process may open {most}: let it have more (ulimit -n 4096), or start fewer servers"


class StablePath:
    """What a path named when it was given, wherever the process works later."""

    def __init__(self, given: Path) -> None:
        self._given = given
        self._working = None if given.is_absolute() else _working_folder()

    @property
    def path(self) -> Path:
        """The path: as it was given where that is right, absolute where the working folder is another one."""
        stays = self._working is None or self._working == _working_folder()
        return self._given if stays else self.absolute

    @property
    def absolute(self) -> Path:
        """The absolute path."""
        return self._given if self._working is None else self._working / self._given


def _working_folder() -> Path | None:
    """Return the working folder; None when it was deleted."""
    with suppress(OSError):
        return Path.cwd()
    return None
