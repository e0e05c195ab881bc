"""The commit of the checkout that this package is used from, by which results can be cited."""

import os
import subprocess
from functools import cache
from pathlib import Path

_DIRTY = "-dirty"
"""As `git describe --dirty` marks it."""
_CODE = ("python", "engine")
"""Folders of the checkout that results depend on."""
_LONGEST_S = 2.0


@cache
def revision() -> str | None:
    """Return the commit, 40 hexadecimal digits, with `-dirty` where its code was changed since.

    None where the package is not used from a checkout (but was installed from a wheel), or git does not tell.
    Untracked files, and which state the engine was compiled from, do not count. git is asked once per
    process, which takes about 0.02 s.
    """
    return revision_of(Path(__file__).parents[3])


def revision_of(folder: Path) -> str | None:
    """Return the same of a checkout; None for any other folder."""
    # A virtual environment in the repository of another project is not a checkout of this one.
    if not ((folder / ".git").exists() and (folder / "engine" / "Cargo.toml").is_file()):
        return None
    # Within git's hooks these variables name the repository that the hook is for.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    command = ["git", "--no-optional-locks", "-C", str(folder), "status", "--porcelain=v2", "--branch"]
    try:
        asked = subprocess.run(
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
    for line in asked.stdout.splitlines():
        if line.startswith("# branch.oid "):
            commit = line.split()[2]
        changed = changed or not line.startswith("#")
    if commit is None or not commit.isalnum():  # "(initial)" before the first
        return None
    return f"{commit}{_DIRTY}" if changed else commit
