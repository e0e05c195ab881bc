"""What is compiled once for a candidate, by whichever instance needs it first."""

import contextlib
import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from swarmwright.common.temporary import remove

_KEPT = 32
"""Builds that are kept, the ones used last."""


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def built(folder: Path, build: Callable[[Path], None]) -> None:
    """Have a folder made by `build`, which gets it empty, unless that was done; what it raises is passed on.

    folder: whose name is a digest of what is built; others beside it are deleted when there are many.
    """
    folder.parent.mkdir(exist_ok=True)
    done = folder / ".done"
    with _locked(folder.parent / f"{folder.name[:2]}.lock"):
        if not done.exists():
            remove(folder)
            folder.mkdir()
            build(folder)
            done.touch()
            _forget(folder.parent)
        os.utime(done)


def _forget(builds: Path) -> None:
    """Delete builds that have not been used for long."""
    found = []
    for done in builds.glob("*/.done"):
        with contextlib.suppress(OSError):
            found.append((done.stat().st_mtime, done.parent))
    for _, folder in sorted(found)[:-_KEPT]:
        remove(folder)
