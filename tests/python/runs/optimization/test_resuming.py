"""The commits that a run was made with, and what they do not change."""

from pathlib import Path

import pytest

from swarmwright import Experiment, Run, optimize
from swarmwright.runs.differences import find_first_difference
from swarmwright.runs.optimization.resuming import build_divergence_error

EXPERIMENT = Experiment.from_mapping(
    {
        "simulation": "minisim", "servers": "in-process", "validate": False,
        "method": {"kind": "random_search", "population": 4, "generations": 2},
    }
)  # fmt: skip


def _run(folder: Path, commit: str | None, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setattr("swarmwright.runs.store.provenance.revision", lambda: commit)
    return optimize(EXPERIMENT, out=folder)


def test_runs_of_other_commits_have_the_same_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, other, wheel = (
        _run(tmp_path / name, commit, monkeypatch)
        for name, commit in (("one", "a" * 40), ("other", f"{'b' * 40}-dirty"), ("wheel", None))
    )
    commits = [run.sessions[0].versions.get("swarmwright commit") for run in (one, other, wheel)]
    assert commits == ["a" * 40, f"{'b' * 40}-dirty", None]
    assert one.digest == other.digest == wheel.digest
    assert find_first_difference(one, other) is None
    assert find_first_difference(one, wheel) is None


def test_another_commit_is_named_where_a_run_cannot_continue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = _run(tmp_path / "run", "a" * 40, monkeypatch)
    for here, said in (
        ("b" * 40, f"another commit of this version (commit {'a' * 40}; now {'b' * 40})"),
        (None, f"another commit of this version (commit {'a' * 40}; now unknown)"),
        ("a" * 40, "another commit of this version;"),
    ):
        monkeypatch.setattr("swarmwright.runs.optimization.resuming.revision", lambda here=here: here)
        assert said in str(build_divergence_error(run._store, 0, []))
