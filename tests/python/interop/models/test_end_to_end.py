"""From the five files of a drawn model to a result, and back, with nothing but commands."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.python.interop.models.test_abstractions import written
from tests.python.interop.models.test_behaviour import WALK

SMALL = ("--set", "method.population=10", "--set", "method.generations=3", "--servers", "local")


@pytest.mark.slow
@pytest.mark.parametrize("evolved", ["parameter_set", "mealy_fsm"])
def test_five_files_to_a_result_and_back(
    program: Any, drawn: list[Path], tmp_path: Path, evolved: str
) -> None:
    (tmp_path / "walk.scxml").write_text(WALK)
    files = [*drawn, tmp_path / "walk.scxml", written(tmp_path)]
    controller = () if evolved == "parameter_set" else ("--controller", evolved)
    imported = program("import", *files, *controller, "--output", "experiment.yaml")
    assert imported.returncode == 0, imported.stderr
    done = program("optimize", "experiment.yaml", *SMALL, "--out", "run")
    assert done.returncode == 0, done.stderr
    model = [option for file in files for option in ("--model", file)]
    back = program("export", "run", *model, "--output", "back")
    assert back.returncode == 0, back.stderr
    names = {path.name for path in (tmp_path / "back").iterdir()} - {".swarmwright-export"}
    if evolved == "mealy_fsm":
        assert names == {"walk.scxml"}
    else:
        assert names == {"candidate.json", "parameters.json", "problem.xml"}
        best = json.loads((tmp_path / "run" / "best.json").read_text())
        candidate = json.loads((tmp_path / "back" / "candidate.json").read_text())
        assert [one["name"] for one in candidate] == ["avoidance", "maxSteps"]
        assert best["controller"]["kind"] == "parameter_set"
