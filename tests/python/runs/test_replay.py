from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from swarmwright.runs.replay import name_replays


@pytest.mark.parametrize(
    ("paths", "named"),
    [
        (["a/one", "a/one"], ["0:1", "0:1"]),
        (["a/one", "a/two"], ["one 0:1", "two 0:1"]),
        (["a/best", "b/best"], ["a/best 0:1", "b/best 0:1"]),
        (["a/seed1/best", "b/seed1/best"], ["a/seed1/best 0:1", "b/seed1/best 0:1"]),
        (["seed1/best", "b/seed1/best", "b/seed2/best"], None),
    ],
)
def test_different_runs_have_different_names(
    tmp_path: Path, paths: list[str], named: list[str] | None
) -> None:
    replays = [
        SimpleNamespace(
            controller_run=None, run=SimpleNamespace(path=tmp_path / path), name="0:1", choice=object()
        )
        for path in paths
    ]
    found = name_replays(cast(Any, replays))
    assert len(set(found)) == len(set(paths))
    assert named is None or found == named
