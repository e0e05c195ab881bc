"""Run folders: written, read back, opened when broken off."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, RunError, optimize
from swarmwright._record import RecordWriter, default_folder
from swarmwright._statistics import quantile, summarize

EXPERIMENT = Experiment.from_mapping(
    {
        "simulation": "minisim",
        "parameters": {"placement": "random", "maxSteps": 5},
        "method": {"population": 12, "generations": 4},
        "ranking": {"episodes": 2},
        "servers": "local",
    }
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(EXPERIMENT, out=tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture
def copy(finished: Run, tmp_path: Path) -> Path:
    """A run folder to break."""
    shutil.copytree(finished.path, tmp_path / "copy")
    return tmp_path / "copy"


def test_all_files_are_there(finished: Run) -> None:
    assert sorted(file.name for file in finished.path.iterdir()) == [
        "best.json",
        "experiment.yaml",
        "fitness.png",
        "generations.csv",
        "journal.jsonl",
        "record.csv",
    ]


def test_a_run_is_read_back_as_it_was(finished: Run) -> None:
    opened = Run.open(finished.path)
    assert opened.experiment == EXPERIMENT
    assert opened.best == finished.best
    assert (opened.generations, opened.evaluations) == (4, finished.evaluations)
    assert opened.seconds == finished.seconds > 0
    assert not opened.interrupted


def test_the_record_is_a_table_for_other_tools(finished: Run) -> None:
    with (finished.path / "record.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:6] == ["generation", "candidate", "fitness", "episode_0", "episode_1", "g0"]
    assert len(rows[0]) == 5 + 49
    order = [(int(row["generation"]), int(row["candidate"])) for row in rows]
    assert order == sorted(order)
    assert len(order) == len(set(order)) == finished.evaluations
    for row in rows:
        mean = (float(row["episode_0"]) + float(row["episode_1"])) / 2
        assert float(row["fitness"]) == mean
        # Shortest decimals: reading and writing again changes nothing.
        assert repr(float(row["fitness"])) == row["fitness"]
        assert str(np.float32(row["g0"])) == row["g0"]


def test_the_best_is_the_first_of_the_best(finished: Run) -> None:
    record = finished.record
    index = int(np.argmax(record.fitness))
    assert finished.best.fitness == record.fitness.max()
    assert (finished.best.generation, finished.best.candidate) == (
        record.generation[index],
        record.candidate[index],
    )
    assert finished.best.specification["weights"] == [float(str(gene)) for gene in record.genomes[index]]
    assert finished.best.controller(np.zeros(4)).shape == (1,)


def test_the_figures_of_a_generation_describe_its_population(finished: Run) -> None:
    first = finished.history[0]
    fitness = np.sort(finished.record.fitness[finished.record.generation == 0])
    assert first.best == fitness[-1]
    assert first.mean == pytest.approx(fitness.mean(), rel=1e-12)
    assert first.median == pytest.approx(np.median(fitness), rel=1e-12)
    assert first.lower_quartile == pytest.approx(np.quantile(fitness, 0.25), rel=1e-12)
    best = [one.best_so_far for one in finished.history]
    assert best == sorted(best)
    assert finished.history[-1].evaluations == finished.evaluations == len(finished.record.fitness)


def test_the_record_can_be_evaluated_again(finished: Run) -> None:
    from swarmwright import evaluate

    again = evaluate(finished.experiment, finished.record.genomes)
    assert again.tobytes() == finished.record.fitness.tobytes()


def test_the_plot_is_a_png_of_a_good_size(finished: Run, tmp_path: Path) -> None:
    path = finished.plot(tmp_path / "again.png")
    data = path.read_bytes()
    assert data.startswith(b"\x89PNG")
    width, height = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    assert width >= 1000
    assert height >= 600
    with pytest.raises(InputError, match="cannot be written"):
        finished.plot(tmp_path / "none" / "x.png")


def test_exporting(finished: Run, tmp_path: Path) -> None:
    finished.export(tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_bytes() == (finished.path / "record.csv").read_bytes()
    with pytest.raises(InputError, match="cannot be written"):
        finished.export(tmp_path / "none" / "out.csv")


def test_the_journal_tells_how_it_went(finished: Run) -> None:
    entries = list(finished.journal())
    assert entries[0]["event"] == "start"
    assert {"time", "swarmwright", "python", "host"} <= set(entries[0])
    assert entries[-1]["event"] == "end"
    assert entries[-1]["evaluations"] == finished.evaluations


@pytest.mark.parametrize("cut", [1, 10, 200, 3000])
def test_a_run_that_was_killed_keeps_its_finished_generations(cut: int, copy: Path, finished: Run) -> None:
    # Killed while the fourth generation was written: its line in generations.csv is missing or cut off.
    generations = (copy / "generations.csv").read_bytes().splitlines(keepends=True)
    (copy / "generations.csv").write_bytes(b"".join(generations[:4]) + generations[4][: cut % 30])
    record = (copy / "record.csv").read_bytes()
    (copy / "record.csv").write_bytes(record[:-cut])
    journal = (copy / "journal.jsonl").read_bytes()
    (copy / "journal.jsonl").write_bytes(journal[:-60])
    opened = Run.open(copy)
    assert opened.generations == 3
    assert opened.interrupted
    expected = finished.record.generation < 3
    assert opened.record.genomes.tobytes() == finished.record.genomes[expected].tobytes()
    assert opened.best.fitness == finished.history[2].best_so_far
    opened.export(copy / "export.csv")
    assert len((copy / "export.csv").read_text().splitlines()) == 1 + opened.evaluations


def test_a_best_file_that_is_behind_is_not_believed(copy: Path, finished: Run) -> None:
    old = json.loads((copy / "best.json").read_text()) | {"fitness": -100.0, "generation": 0, "candidate": 0}
    (copy / "best.json").write_text(json.dumps(old))
    assert Run.open(copy).best == finished.best


@pytest.mark.parametrize(
    ("name", "words"),
    [("record.csv", "missing"), ("experiment.yaml", "missing"), ("generations.csv", "missing")],
)
def test_folders_that_are_no_runs(name: str, words: str, copy: Path) -> None:
    (copy / name).unlink()
    with pytest.raises(InputError, match=rf"is no run folder: {name} {words}"):
        Run.open(copy)
    with pytest.raises(InputError, match="there is no such folder"):
        Run.open(copy / "none")


def test_damaged_files_are_named(copy: Path) -> None:
    (copy / "generations.csv").write_text("generation,best\n0,x\n")
    with pytest.raises(InputError, match=r"generations\.csv: is damaged"):
        Run.open(copy)


def test_a_record_with_lines_missing_is_damaged(copy: Path) -> None:
    record = (copy / "record.csv").read_bytes().splitlines(keepends=True)
    (copy / "record.csv").write_bytes(b"".join(record[:-3]))
    with pytest.raises(InputError, match=r"record\.csv: is damaged: 3 of 33 evaluations are missing"):
        _ = Run.open(copy).record


def test_a_run_without_a_generation_has_no_best(copy: Path) -> None:
    header = (copy / "generations.csv").read_text().splitlines()[0]
    (copy / "generations.csv").write_text(f"{header}\n")
    opened = Run.open(copy)
    assert (opened.generations, opened.evaluations, len(opened.record.fitness)) == (0, 0, 0)
    with pytest.raises(RunError, match="no finished generation"):
        _ = opened.best
    with pytest.raises(InputError, match="no finished generation"):
        opened.plot()


def test_a_generation_under_way_is_taken_back(tmp_path: Path) -> None:
    genomes, fitness = np.zeros((2, 3), dtype=np.float32), np.array([1.0, np.nan])
    summary = summarize(fitness, generation=0, evaluations=2, best_so_far=1.0, failed=1)
    best = {"fitness": 1.0, "generation": 0, "candidate": 0, "controller": {"kind": "x"}}
    with RecordWriter(tmp_path / "run", EXPERIMENT, 3) as record:
        record.generation(summary, genomes, fitness, fitness[:, None], best)
        record._write("record.csv", ["1,0,half"])
    lines = (tmp_path / "run" / "record.csv").read_text().splitlines()
    assert lines[1:] == ["0,0,1.0,1.0,0.0,0.0,0.0", "0,1,nan,nan,0.0,0.0,0.0"]
    assert json.loads((tmp_path / "run" / "best.json").read_text())["fitness"] == 1.0


def test_results_are_never_written_over(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("precious")
    with pytest.raises(InputError, match="is not empty, and results are never written over"):
        optimize(EXPERIMENT, out=tmp_path / "full")
    with pytest.raises(InputError, match="is a file"):
        optimize(EXPERIMENT, out=tmp_path / "full" / "thesis.txt")
    assert [file.name for file in (tmp_path / "full").iterdir()] == ["thesis.txt"]
    (tmp_path / "empty").mkdir()
    assert optimize(EXPERIMENT, lambda _: False, out=tmp_path / "empty").generations == 1


def test_default_folders_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert default_folder(EXPERIMENT) == Path("runs/minisim-1")
    Path("runs/minisim-1").mkdir(parents=True)
    assert default_folder(EXPERIMENT) == Path("runs/minisim-1-2")
    EXPERIMENT.save("my first.yaml")
    assert default_folder(Experiment.load("my first.yaml").replace(seed=7)) == Path("runs/my_first-7")
    strange = Experiment.from_mapping({"simulation": "../../etc"})
    assert default_folder(strange).parent == Path("runs")


def test_quantiles() -> None:
    assert quantile([1, 2, 3, 4, 5], 0.5) == 3
    assert quantile([1, 2], 0.25) == 1.25
    assert quantile([7], 0.75) == 7
    assert np.isnan(quantile([], 0.5))
