"""The commit of a checkout."""

import os
import subprocess
from pathlib import Path

import pytest

from swarmwright.common.revision import revision_of

pytestmark = pytest.mark.slow


def git(folder: Path, *arguments: str) -> str:
    """Run git as a user without settings."""
    apart = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull}
    who = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    command = ["git", *who, "-C", str(folder), *arguments]
    done = subprocess.run(
        command, env={**os.environ, **apart}, check=True, capture_output=True, text=True, timeout=50
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with one commit, and its name."""
    for name in ("python/code.py", "engine/Cargo.toml", "docs/page.md"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text("")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "all")
    return tmp_path


def test_the_commit_and_whether_the_code_was_changed(checkout: Path) -> None:
    commit = git(checkout, "rev-parse", "HEAD")
    assert revision_of(checkout) == commit
    (checkout / "docs" / "page.md").write_text("other words")
    (checkout / "python" / "untracked.py").write_text("")
    assert revision_of(checkout) == commit
    (checkout / "python" / "code.py").write_text("pass")
    assert revision_of(checkout) == f"{commit}-dirty"
    git(checkout, "add", "python")
    assert revision_of(checkout) == f"{commit}-dirty"
    git(checkout, "commit", "-q", "-m", "more")
    assert revision_of(checkout) == git(checkout, "rev-parse", "HEAD")
    git(checkout, "worktree", "add", "-q", str(checkout / "other"), commit)
    assert revision_of(checkout / "other") == commit


def test_hooks_of_other_repositories_do_not_mislead(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commit = git(checkout, "rev-parse", "HEAD")
    monkeypatch.setenv("GIT_DIR", "/nowhere")
    assert revision_of(checkout) == commit


def test_what_is_no_checkout_has_none(
    checkout: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path_factory.mktemp("other")
    assert revision_of(folder) is None
    git(folder, "init", "-q")
    assert revision_of(folder) is None, "the repository of another project"
    (folder / "engine").mkdir()
    (folder / "engine" / "Cargo.toml").write_text("")
    assert revision_of(folder) is None, "without a commit"
    (checkout / ".git" / "HEAD").write_text("damaged")
    assert revision_of(checkout) is None
    monkeypatch.setenv("PATH", "/nowhere")
    assert revision_of(checkout) is None, "without git"
