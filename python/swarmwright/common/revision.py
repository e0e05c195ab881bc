"""The commit of the checkout of this package, for citing results."""

import os
import subprocess
from functools import cache
from pathlib import Path

_DIRTY = "-dirty"
"""The suffix of `git describe --dirty`."""
_CODE = ("python", "engine")
"""Folders of the checkout that affect results."""
_LONGEST_S = 2.0
"""Time-out of git, seconds."""


@cache
def revision() -> str | None:
    """Return the commit, 40 hexadecimal digits, with `-dirty` if its code was changed.

    None outside of a checkout (installed from a wheel), or if git fails. Untracked files and the state of the
    compiled engine do not count. git runs once per process, for about 0.02 s.
    """
    return revision_of(Path(__file__).parents[3])


def revision_of(folder: Path) -> str | None:
    """Return the commit of a checkout; None for other folders."""
    # A virtual environment in another project's repository is not a checkout.
    if not ((folder / ".git").exists() and (folder / "engine" / "Cargo.toml").is_file()):
        return None
    # In git hooks, these variables name the hook's repository.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    command = ["git", "--no-optional-locks", "-C", str(folder), "status", "--porcelain=v2", "--branch"]
    try:
        status = subprocess.run(
            [*command, "--untracked-files=no", "--", *_CODE],
            env=environment,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_LONGEST_S,
            check=True,
        )
    except (OSError, subprocess.SubprocessError, UnicodeError):
        return None
    commit, changed = None, False
    for line in status.stdout.splitlines():
        if line.startswith("# branch.oid "):
            commit = line.split()[2]
        changed = changed or not line.startswith("#")
    if commit is None or not commit.isalnum():  # "(initial)" before the first commit
        return None
    return f"{commit}{_DIRTY}" if changed else commit
