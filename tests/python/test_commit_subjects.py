"""What `.githooks/commit-msg` refuses."""

import subprocess
from pathlib import Path

import pytest

HOOK = Path(__file__).parents[2] / ".githooks/commit-msg"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("message", "status"),
    [
        ("pool: retry refused batches\n\nWhy.", 0),
        ("controllers, display: move kinds", 0),
        (f"pool: {'x' * 54}", 0),
        (f"pool: {'x' * 55}", 1),
        ("Retry refused batches", 1),
        ("pool:retry", 1),
        ("", 1),
        ("a: $(exit 0) `true` \"'", 0),
        ("Merge branch 'main'", 0),
    ],
)
def test_subjects(message: str, status: int, tmp_path: Path) -> None:
    (tmp_path / "message").write_text(message)
    done = subprocess.run([HOOK, tmp_path / "message"], capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert bool(done.stderr) == bool(status)
