"""Which code of run folders this user trusts: that of runs that this user made, and what was allowed.

Kept by its SHA-256 in a folder of the user, outside of all run folders: the author of a run folder
controls everything in it.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.warn_once import warn_once

Ask = Callable[[str], bool]
"""Asks a person a question, which may have several lines; whether the answer is yes."""

_granted: set[str] = set()
"""By this process; also where the folder cannot be written."""
_asks: list[Ask] = []
_all = 0


def folder() -> Path | None:
    """Return the folder with a file for each digest: below XDG_STATE_HOME, by default ~/.local/state.

    A relative XDG_STATE_HOME is ignored, as the XDG Base Directory Specification demands. None for a user
    without a home, as those of containers may be.
    """
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    if not state.is_absolute():
        try:
            state = Path.home() / ".local" / "state"
        except RuntimeError:
            return None
    return state / "swarmwright" / "trusted-code"


def digest_of(files: Mapping[str, str]) -> str:
    """Return the SHA-256, in hexadecimal, of source: place -> SHA-256 of the file."""
    return hashlib.sha256(json.dumps(dict(files), sort_keys=True).encode()).hexdigest()


def remember(files: Mapping[str, str], name: str) -> None:
    """Trust source from now on.

    files: place -> SHA-256. name: what it is, for people who look into the folder.
    """
    if not files:
        return
    digest = digest_of(files)
    _granted.add(digest)
    kept, why = folder(), "HOME and XDG_STATE_HOME are not set,"
    if kept is not None:
        try:
            if not (kept / digest).exists():
                kept.mkdir(mode=0o700, parents=True, exist_ok=True)
                (kept / digest).write_text(f"{name}\n", encoding="utf-8", errors="backslashreplace")
            return
        except OSError as error:
            why = f"{kept}: cannot be written: {error.strerror};"
    warn_once(f"{why} so later commands ask whether the code of this run is to be trusted, or need --trust")


def is_trusted(files: Mapping[str, str]) -> bool:
    """Whether source was remembered."""
    digest = digest_of(files)
    if digest in _granted:
        return True
    kept = folder()
    with suppress(OSError):  # a home that this user may not enter
        return kept is not None and (kept / digest).is_file()
    return False


def require(files: Mapping[str, str], path: Path) -> None:
    """Check that source is trusted, or ask a person whether it may be executed.

    files: place -> SHA-256. path: where the main file is.

    Raises InputError when it is not.
    """
    if is_trusted(files):
        return
    digest = digest_of(files)
    what = f"{path} (SHA-256 {digest[:16]}..) is code that a run folder names"
    more = "" if len(files) == 1 else f", with {len(files) - 1} more files that it imports"
    if _all or any(
        ask(
            f"{what}{more}, and it is not of a run that was made here by this user.\n"
            "It can do whatever you can. Execute it, now and from now on?"
        )
        for ask in _asks
    ):
        remember(files, str(path))
        return
    raise InputError(
        f"{what}{more}, and it is not of a run that was made here by this user, so it is not executed. Read "
        "it; to trust it from now on, give --trust (in Python, Run.open(folder, trust=True)), or name other "
        "code: --simulation FILE:Class"
    )


@contextmanager
def trusting() -> Iterator[None]:
    """Within the block, all code is trusted, and the decision is stored."""
    global _all  # noqa: PLW0603 - of the process, as modules are
    _all += 1
    try:
        yield
    finally:
        _all -= 1


@contextmanager
def asking(ask: Ask) -> Iterator[None]:
    """Within the block, a person is asked about code that is not trusted."""
    _asks.append(ask)
    try:
        yield
    finally:
        _asks.remove(ask)
