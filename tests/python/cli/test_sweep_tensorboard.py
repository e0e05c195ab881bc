"""`sweep --tensorboard`."""

import json
import sys
from pathlib import Path

import pytest

from swarmwright import Experiment
from swarmwright.cli._main import run as command
from tests.python.runs.callbacks.test_callbacks import scalars


@pytest.fixture
def file(tmp_path: Path) -> Path:
    Experiment.from_mapping(
        {"simulation": "minisim", "servers": "local", "method": {"population": 4, "generations": 3}}
    ).save(tmp_path / "base.yaml")
    text = {"experiment": "base.yaml", "grid": {"method.population": [4, 5]}, "seeds": 1}
    (tmp_path / "sweep.yaml").write_text(json.dumps({**text, "out": str(tmp_path / "out")}))
    return tmp_path / "sweep.yaml"


@pytest.mark.slow
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_each_run_has_its_curves(file: Path, jobs: str) -> None:
    logs = file.parent / "logs"
    assert command(["sweep", str(file), "--tensorboard", str(logs), "--jobs", jobs]) == 0
    assert sorted(one.name for one in logs.iterdir()) == ["population_4-1", "population_5-1"]
    for folder in logs.iterdir():
        assert [step for step, _ in scalars(folder)["fitness/best_so_far"]] == [0, 1, 2]
    before = sorted(logs.rglob("*"))
    assert command(["sweep", str(file), "--tensorboard", str(logs)]) == 0
    assert sorted(logs.rglob("*")) == before


def test_nothing_begins_without_the_library(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "tensorboardX", None)
    assert command(["sweep", str(file), "--tensorboard", str(file.parent / "logs")]) == 2
    assert "pip install 'swarmwright[tensorboard]'" in capsys.readouterr().err
    assert not (file.parent / "out").exists()
