"""The record of a sweep, as it is read."""

import json
from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError
from swarmwright.analysis.sweep.record import FILE, runs_of


def test_the_folders_that_a_record_names_are_beside_it(tmp_path: Path) -> None:
    assert runs_of(tmp_path) is None
    (tmp_path / FILE).write_text(json.dumps({"variants": [{"runs": ["a-1", "a-2"]}, {"runs": ["..b-1"]}]}))
    assert runs_of(tmp_path) == [tmp_path / name for name in ("a-1", "a-2", "..b-1")]


@pytest.mark.parametrize(
    "runs",
    ["ab", None, [1], ["/etc"], ["../../x"], ["a/b"], ["a\\b"], [".."], ["."], [""], ["a\0"], {"a": 1}],
)
def test_names_that_are_no_folders_beside_it_are_refused(tmp_path: Path, runs: Any) -> None:
    (tmp_path / FILE).write_text(json.dumps({"variants": [{"runs": runs}]}))
    with pytest.raises(InputError, match=r"sweep\.json: is not the record of a sweep; delete it"):
        runs_of(tmp_path)


@pytest.mark.parametrize("text", ["", "[" * 100_000, "[]", "{}", '{"variants": 3}', '{"variants": ["ab"]}'])
def test_files_that_are_no_record_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(InputError, match=r"sweep\.json: is not the record of a sweep"):
        runs_of(tmp_path)
