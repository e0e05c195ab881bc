"""The examples in the docstrings of the public interface run, and every public function has one."""

import doctest
import inspect
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright

ROOT = Path(__file__).parents[2]
FUNCTIONS = [
    name for name in swarmwright.__all__ if inspect.isfunction(getattr(swarmwright, name)) and name[0] != "_"
]
STARTS = {"export_bundle", "sweep", "verify_bundle"}
"""Those whose examples start processes: compilers, mostly, which take half a minute on a quiet machine."""
MARKS = (pytest.mark.journey, pytest.mark.timeout(180))


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the `experiments`, runs `result` and `archive`, and sweep `study` of examples."""
    folder = tmp_path_factory.mktemp("prepared")
    (folder / "experiments").symlink_to(ROOT / "experiments")
    small: dict[str, Any] = {"simulation": "minisim", "method": {"population": 10, "generations": 2}}
    swarmwright.optimize(small, servers="in-process", out=folder / "result")
    archive = {"kind": "map_elites", "measures": {"steps": {"range": [0, 15], "bins": 3}}}
    swarmwright.optimize(
        {**small, "method": {**small["method"], **archive}}, servers="in-process", out=folder / "archive"
    )
    for kind in ("nnga", "random_search"):
        method = {**small["method"], "kind": kind}
        swarmwright.optimize(
            {**small, "method": method}, servers="in-process", out=folder / f"study/{kind}-1"
        )
    return folder


def functions() -> dict[str, Callable[..., Any]]:
    return {name: getattr(swarmwright, name) for name in FUNCTIONS}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=MARKS) if name in STARTS else name for name in FUNCTIONS]
)
def test_the_examples_of_a_public_function_run(
    name: str, prepared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(shutil.copytree(prepared, tmp_path / "copy", symlinks=True))
    function = inspect.unwrap(functions()[name])
    names = {"swarmwright": swarmwright, "np": np, "run": swarmwright.Run.open("result")}
    [test] = [
        test
        for test in doctest.DocTestFinder(recurse=False).find(function, name, globs=names)
        if test.examples
    ]
    result = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test)
    assert result.failed == 0


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_names_its_neighbours(name: str) -> None:
    assert "See also" in (inspect.getdoc(functions()[name]) or "")
