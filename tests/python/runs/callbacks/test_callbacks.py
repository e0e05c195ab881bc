"""Other programs are told how it goes, and what they are told is what the run says."""

import math
import shutil
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, Generation, InputError, Run, RunError, callbacks, optimize
from swarmwright.common.values import flatten

EXPERIMENT = Experiment.from_mapping(
    {
        "simulation": "minisim",
        "parameters": {"maxSteps": 5},
        "method": {"population": 12, "generations": 5},
        "servers": "local",
    }
)


def scalars(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """The curves in an event file: records of length, check, data, check."""
    from tensorboardX.proto.event_pb2 import Event

    found: dict[str, list[tuple[int, float]]] = {}
    (file,) = folder.iterdir()
    data, at = file.read_bytes(), 0
    while at < len(data):
        (length,) = struct.unpack_from("<Q", data, at)
        event = Event.FromString(data[at + 12 : at + 12 + length])
        at += length + 16
        for value in event.summary.value:
            if value.HasField("simple_value"):
                found.setdefault(value.tag, []).append((event.step, value.simple_value))
    return found


def test_tensorboard_has_the_curves(tmp_path: Path) -> None:
    with callbacks.TensorBoard(tmp_path / "logs", EXPERIMENT) as board:
        run = optimize(EXPERIMENT, board, out=tmp_path / "run")
        board.conclude(run)
    found = scalars(tmp_path / "logs")
    best = found["fitness/best_so_far"]
    assert [step for step, _ in best] == [0, 1, 2, 3, 4]
    assert [value for _, value in best] == pytest.approx([one.best_so_far for one in run.history], rel=1e-6)
    assert found["evaluations/total"][-1] == (4, run.evaluations)


NOISY = EXPERIMENT.replace(
    parameters={"placement": "random", "numAgents": 3}, validate={"episodes": 20, "candidates": 1}
)


def held_out(run: Run) -> dict[str, float]:
    assert run.unseen is not None
    fitness = run.unseen.fitness
    assert fitness.low is not None
    assert fitness.high is not None
    names = ("fitness/held_out", "fitness/held_out_low", "fitness/held_out_high")
    return dict(zip(names, (fitness.mean, fitness.low, fitness.high), strict=True))


def test_tensorboard_has_the_fitness_on_held_out_seeds(tmp_path: Path) -> None:
    with callbacks.TensorBoard(tmp_path / "logs", NOISY) as board:
        run = optimize(NOISY, board, out=tmp_path / "run")
        board.conclude(run)
    found = scalars(tmp_path / "logs")
    for name, value in held_out(run).items():
        ((step, sent),) = found[name]
        assert step == 4
        assert sent == pytest.approx(value, rel=1e-6)


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """MLflow's database without runs: making its tables takes seconds."""
    from mlflow import MlflowClient

    file = tmp_path_factory.mktemp("mlflow") / "mlflow.db"
    MlflowClient(tracking_uri=f"sqlite:///{file}").search_experiments()
    return file


@pytest.fixture
def uri(empty: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A tracking database in the current folder, which is a new one."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(empty, tmp_path / "mlflow.db")
    return "sqlite:///mlflow.db"


@pytest.mark.slow
def test_a_run_that_goes_on_is_named_by_its_folder(uri: str, tmp_path: Path) -> None:
    from mlflow import MlflowClient

    run = optimize(EXPERIMENT.replace(method={"generations": 1}), out=tmp_path / "swarm-7")
    EXPERIMENT.save(tmp_path / "mine.yaml")
    names = []
    for experiment in (run.experiment, Experiment.load(tmp_path / "mine.yaml"), EXPERIMENT):
        with callbacks.MLflow(uri, experiment) as told:
            names.append(MlflowClient(tracking_uri=uri).get_run(told.run_id).info.run_name)
    assert names[:2] == ["swarm-7", "mine"]


@pytest.mark.slow
@pytest.mark.usefixtures("plots")
def test_mlflow_has_the_run(uri: str, tmp_path: Path) -> None:
    from mlflow import MlflowClient

    with callbacks.MLflow(uri, EXPERIMENT, group="swarms") as told:
        run = optimize(EXPERIMENT, told, out=tmp_path / "run")
        told.conclude(run)
    client = MlflowClient(tracking_uri=uri)
    found = client.get_run(told.run_id)
    assert found.info.status == "FINISHED"
    assert found.data.params["method.population"] == "12"
    assert found.data.tags["record"] == run.digest
    curve = client.get_metric_history(told.run_id, "fitness/best_so_far")
    assert [(point.step, point.value) for point in curve] == [
        (one.generation, one.best_so_far) for one in run.history
    ]
    assert {file.path for file in client.list_artifacts(told.run_id)} == {
        "best.json",
        "experiment.yaml",
        "fitness.png",
    }


def test_mlflow_has_the_fitness_on_held_out_seeds(uri: str, tmp_path: Path) -> None:
    from mlflow import MlflowClient

    with callbacks.MLflow(uri, NOISY) as told:
        run = optimize(NOISY, told, out=tmp_path / "run")
        told.conclude(run)
    sent = MlflowClient(tracking_uri=uri).get_run(told.run_id).data.metrics
    assert {name: sent[name] for name in held_out(run)} == held_out(run)


def test_a_run_that_fails_has_failed_there_too(uri: str) -> None:
    from mlflow import MlflowClient

    told = callbacks.MLflow(uri)
    told(generation(0))
    with pytest.raises(ZeroDivisionError), told:
        raise ZeroDivisionError
    assert MlflowClient(tracking_uri=uri).get_run(told.run_id).info.status == "FAILED"


def test_a_tracking_server_that_is_not_there(unused_port: int) -> None:
    with pytest.raises(RunError, match=f"MLflow at http://127.0.0.1:{unused_port}: "):
        callbacks.MLflow(f"http://127.0.0.1:{unused_port}")


def generation(number: int, **changes: Any) -> Generation:
    values: dict[str, Any] = {
        "generation": number,
        "generations": 3,
        "best": 1.0,
        "mean": math.nan,
        "best_so_far": 2.0,
        "failed": 0,
        "failed_so_far": 0,
        "evaluations": 10,
        "seconds": 1.0,
        "evaluations_per_second": 10.0,
        "seconds_left": 0.0,
        "waiting_for": "",
    }
    return Generation(**(values | changes))


def test_callbacks_are_joined() -> None:
    seen: list[str] = []

    def first(_: Generation) -> bool:
        seen.append("first")
        return False

    def second(_: Generation) -> None:
        seen.append("second")

    assert callbacks.together(first, second)(generation(0)) is False
    assert callbacks.together(second, second)(generation(0)) is True
    assert seen == ["first", "second", "second", "second"]
    returns: list[tuple[Any, bool]] = [(np.False_, False), (np.True_, True), (None, True)]
    for returned, goes_on in returns:
        call: Callable[[Generation], Any] = lambda _: returned  # noqa: B023, E731
        assert callbacks.together(call)(generation(0)) is goes_on


def test_nested_values_become_flat() -> None:
    assert flatten({"a": {"b": {"c": 1}, "d": [1, 2]}, "e": "x"}) == {"a.b.c": 1, "a.d": [1, 2], "e": "x"}


@pytest.mark.slow
def test_options_of_the_program(program: Any, uri: str, tmp_path: Path) -> None:
    EXPERIMENT.save(tmp_path / "x.yaml")
    result = program(*("optimize", "x.yaml", "--out", "run", "--tensorboard", "board", "--mlflow", uri))
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "board").is_dir()
    store = sqlite3.connect(tmp_path / "mlflow.db")
    assert store.execute("SELECT status FROM runs").fetchall() == [("FINISHED",)]
    store.close()
    run = Run.open(tmp_path / "run")
    assert run.state == "done"


def test_a_folder_that_is_a_path_of_another_class(tmp_path: Path) -> None:
    class Other:
        def __fspath__(self) -> str:
            return str(tmp_path / "logs")

    with callbacks.TensorBoard(Other()):
        pass
    assert list((tmp_path / "logs").iterdir())


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        callbacks.TensorBoard(tmp_path / "file" / "logs")


def test_stores_of_tensorboard_that_need_other_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def unavailable(folder: str) -> None:
        raise ImportError(f"boto3 must be installed for {folder}")

    monkeypatch.setattr("tensorboardX.SummaryWriter", unavailable)
    with pytest.raises(InputError, match=r"^s3://bucket/x: cannot be written: boto3 must be installed"):
        callbacks.TensorBoard("s3://bucket/x")
