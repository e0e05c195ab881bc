"""The code of run folders that this user trusts: that of the user's own runs, and code that was allowed.

It is recorded by its SHA-256 in a folder of the user outside all run folders, because the author of a run
folder controls everything in it.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import make_private_folder, state_folder
from swarmwright.common.warn_once import warn_once

Ask = Callable[[str], bool]
"""Asks the user a question, which may have several lines; returns whether the answer is yes."""

_granted: set[str] = set()
"""Digests that this process trusts, even if the folder cannot be written."""
_asks: list[Ask] = []
_all = 0


def folder() -> Path | None:
    """Return the folder with a file for each digest; None for a user without a home folder."""
    state = state_folder()
    return None if state is None else state / "trusted-code"


def digest_of(files: Mapping[str, str]) -> str:
    """Return the SHA-256, in hexadecimal, of source: location -> SHA-256 of the file."""
    return hashlib.sha256(json.dumps(dict(files), sort_keys=True).encode()).hexdigest()


def remember(files: Mapping[str, str], name: str) -> None:
    """Trust source from now on.

    files: location -> SHA-256. name: a description for people who read the folder.
    """
    if not files:
        return
    digest = digest_of(files)
    _granted.add(digest)
    folder_, problem = folder(), "HOME and XDG_STATE_HOME are not set,"
    if folder_ is not None:
        try:
            if not (folder_ / digest).exists():
                make_private_folder(folder_)
                (folder_ / digest).write_text(f"{name}\n", encoding="utf-8", errors="backslashreplace")
            return
        except OSError as error:
            problem = f"{folder_}: cannot be written: {error.strerror};"
    warn_once(f"{problem} so later commands will ask whether to trust the code of this run, or need --trust")


def is_trusted(files: Mapping[str, str]) -> bool:
    """Return whether source is trusted."""
    digest = digest_of(files)
    if digest in _granted:
        return True
    folder_ = folder()
    with suppress(OSError):  # a home that this user may not enter
        return folder_ is not None and (folder_ / digest).is_file()
    return False


def require(files: Mapping[str, str], path: Path) -> None:
    """Check that source is trusted, or ask the user whether to execute it.

    files: location -> SHA-256. path: the main file.

    Raises InputError if it is not trusted.
    """
    if is_trusted(files):
        return
    digest = digest_of(files)
    subject = f"{path} (SHA-256 {digest[:16]}..) is code named by a run folder"
    imports = "" if len(files) == 1 else f", with {len(files) - 1} more files that it imports"
    if _all or any(
        ask(
            f"{subject}{imports}, and does not belong to a run that you made on this machine.\n"
            "It can do whatever you can. Trust it from now on, and execute it?"
        )
        for ask in _asks
    ):
        remember(files, str(path))
        return
    raise InputError(
        f"{subject}{imports}, and does not belong to a run that you made on this machine, so it is not "
        "executed. Read it; to trust it from now on, pass --trust (in Python, Run.open(folder, trust=True)), "
        "or name other code with --simulation FILE:Class"
    )


@contextmanager
def trusting() -> Iterator[None]:
    """Trust all code within the block, and store that decision."""
    global _all  # noqa: PLW0603 - of the process, as modules are
    _all += 1
    try:
        yield
    finally:
        _all -= 1


@contextmanager
def asking(ask: Ask) -> Iterator[None]:
    """Ask the user about code that is not trusted within the block."""
    _asks.append(ask)
    try:
        yield
    finally:
        _asks.remove(ask)
