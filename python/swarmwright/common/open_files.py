"""The limit of open files, of which a broker needs one for each client."""

import errno
import os
import resource
from contextlib import suppress

_WANTED_FILES = 65536
"""Files that a broker with its most clients has open, and more."""


def allow_more_open_files() -> None:
    """Raise the soft limit of open files (`ulimit -Sn`, often 1024) to the hard one, at most 65536."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _WANTED_FILES if hard == resource.RLIM_INFINITY else min(hard, _WANTED_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with suppress(ValueError, OSError):  # macOS: fewer than the hard limit says
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def no_more_files() -> bool:
    """Whether this process has as many files open as it may."""
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        return error.errno == errno.EMFILE
    return False


def more_open_files() -> str:
    """Return what to do where a file cannot be opened since too many are open."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return f"this process may open {most}: let it have more (ulimit -n 4096), or start fewer servers"
