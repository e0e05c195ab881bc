"""Run folders: written, read back, repeated."""

import csv
import pickle
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from pyarrow import parquet

from swarmwright import Experiment, InputError, Run, optimize, repeat, resume
from swarmwright.common.revision import revision
from swarmwright.common.statistics import quantile
from swarmwright.runs import picture
from swarmwright.runs.folders import default_folder
from tests.python.records import EXPERIMENT, change_numbers, seal


@pytest.mark.slow
@pytest.mark.usefixtures("plots")
def test_all_files_are_there(tmp_path: Path) -> None:
    run = optimize(EXPERIMENT, out=tmp_path / "run")
    picture.wait()
    assert sorted(file.name for file in run.path.iterdir()) == [
        "best.json",
        "experiment.yaml",
        "fitness.png",
        "run.sqlite",
    ]


def test_a_run_is_read_back_as_it_was(finished: Run) -> None:
    opened = Run.open(finished.path)
    assert opened.experiment == EXPERIMENT
    assert opened.best == finished.best
    assert (opened.generations, opened.evaluations) == (4, finished.evaluations)
    assert opened.seconds == finished.seconds > 0
    assert not opened.interrupted


def test_the_record_is_a_table_for_other_tools(finished: Run, tmp_path: Path) -> None:
    finished.export(tmp_path / "record.csv")
    with (tmp_path / "record.csv").open(newline="") as file:
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
    before = sorted(finished.path.iterdir())
    assert len(finished.plot().axes) == 2
    assert sorted(finished.path.iterdir()) == before, "without a path nothing is written"
    figure = finished.plot(tmp_path / "again.png", x="generations")
    assert figure.axes[1].get_xlabel() == "generation (from 0)"
    data = (tmp_path / "again.png").read_bytes()
    assert data.startswith(b"\x89PNG")
    width, height = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    assert width >= 1000
    assert height >= 600
    with pytest.raises(InputError, match="does not exist; create it first"):
        finished.plot(tmp_path / "none" / "x.png")


def test_the_class_opens_a_folder_by_its_name(finished: Run, tmp_path: Path) -> None:
    run = Run(str(finished.path))
    assert run.path == finished.path
    assert run.best.fitness == finished.best.fitness
    with pytest.raises(InputError, match="does not exist"):
        Run(tmp_path / "none")


def test_exporting(finished: Run, tmp_path: Path) -> None:
    finished.export(tmp_path / "out.csv")
    lines = (tmp_path / "out.csv").read_text().splitlines()
    assert len(lines) == 1 + finished.evaluations
    for path, words in (
        (tmp_path / "none" / "out.csv", "cannot be written"),
        (tmp_path / "none" / "out.parquet", "cannot be written"),
        (
            tmp_path / "out.xlsx",
            r"unknown table format; choose a file name that ends with \.csv or \.parquet",
        ),
    ):
        with pytest.raises(InputError, match=words):
            finished.export(path)


def test_exporting_to_parquet(finished: Run, tmp_path: Path) -> None:
    finished.export(tmp_path / "out.parquet")
    table = parquet.read_table(tmp_path / "out.parquet")
    record = finished.record
    assert table.column_names == ["generation", "candidate", "fitness", "episodes", "genome"]
    assert table["fitness"].to_pylist() == record.fitness.tolist()
    assert table["episodes"].to_pylist() == record.episodes.tolist()
    assert np.array(table["genome"].to_pylist(), dtype=np.float32).tobytes() == record.genomes.tobytes()


def test_it_is_told_how_it_went(finished: Run) -> None:
    (session,) = finished.sessions
    assert session.outcome == "done"
    assert session.place == "in this process"
    assert {"swarmwright", "python", "numpy"} <= session.versions.keys()
    assert session.versions.get("swarmwright commit") == revision()
    assert session.seconds == finished.seconds
    assert finished.state == "done"
    assert list(finished.events()) == []


def test_columns_of_the_record_by_name(tmp_path: Path) -> None:
    run = optimize(EXPERIMENT.replace(fitness="-distance", ranking={"episodes": 2}), out=tmp_path / "run")
    record = Run.open(run.path).record
    assert record.metric_names == ("distance",) == tuple(run.metrics)
    assert record.get("distance_1") is record["distance_1"]
    assert record["distance_1"].tolist() == record.metrics[:, 1, 0].tolist()
    assert record.get("distance") is None
    assert record.get("distance", 5) == 5
    known = "generation, candidate, fitness, episode_0 .. episode_1, distance_0 .. distance_1, g0 .. g"
    with pytest.raises(
        KeyError, match=f"no column 'distance'; did you mean 'distance_0'. available: {known}"
    ):
        _ = record["distance"]


def test_arrays_of_the_record_cannot_be_changed(finished: Run) -> None:
    run = Run.open(finished.path)
    record = run.record
    arrays: list[NDArray[Any]] = [record.fitness, record.genomes, record.metrics, *record.values()]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    frame = pd.DataFrame(record)
    frame["fitness"] -= frame["fitness"].max()
    assert record.fitness.max() == run.best.fitness
    copied = record.fitness.copy()
    copied[:] = 0.0


def test_the_seeds_are_recorded(finished: Run) -> None:
    assert finished.seeds(3) == [0, 1]
    with pytest.raises(InputError, match="has generations 0 to 3, but no generation 4"):
        finished.seeds(4)


def test_an_evaluation_is_found_by_both_its_numbers(finished: Run) -> None:
    record = finished.record
    for number in (0, 12, 20, finished.evaluations - 1):
        one = finished.evaluation(number)
        assert (one.generation, one.candidate) == (record.generation[number], record.candidate[number])
        assert one.genome.tobytes() == record.genomes[number].tobytes()
        assert one.episodes.tolist() == record.episodes[number].tolist()
        assert one.fitness == record.fitness[number]
        again = finished.evaluation(one.candidate, one.generation)
        assert again.number == number
    of_generation = finished.evaluation(generation=2)
    among = record.generation == 2
    assert (of_generation.generation, of_generation.fitness) == (2, record.fitness[among].max())
    assert of_generation.candidate == record.fitness[among].argmax()
    assert finished.evaluation(np.int64(12)).number == 12
    assert finished.evaluation(np.uint32(0), np.int32(2)).number == int(among.argmax())
    best = finished.evaluation()
    assert (best.generation, best.candidate) == (finished.best.generation, finished.best.candidate)
    with pytest.raises(InputError, match=r"generation 1 has candidates 0 to \d+, but no candidate 400"):
        finished.evaluation(400, 1)
    with pytest.raises(InputError, match=r"has evaluations 0 to \d+, but no evaluation 4000"):
        finished.evaluation(4000)


@pytest.mark.slow
def test_any_evaluation_can_be_repeated(finished: Run, copy: Path) -> None:
    assert repeat(finished).same
    for number in (0, 17):
        again = repeat(finished, number, servers=1)
        assert again.same
        assert again.recorded.tolist() == again.repeated.tolist() == finished.record.episodes[number].tolist()
    evaluation = finished.evaluation(17)
    change_numbers(copy, "episodes", slice(evaluation.candidate, None), 0.0, generation=evaluation.generation)
    seal(copy)
    assert not repeat(Run.open(copy), 17).same


def test_results_are_never_written_over(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("precious")
    with pytest.raises(InputError, match="is not empty, and results are never overwritten"):
        optimize(EXPERIMENT, out=tmp_path / "full")
    with pytest.raises(InputError, match="is a file"):
        optimize(EXPERIMENT, out=tmp_path / "full" / "thesis.txt")
    assert [file.name for file in (tmp_path / "full").iterdir()] == ["thesis.txt"]
    (tmp_path / "of a run").mkdir()
    assert optimize(EXPERIMENT, lambda _: False, out=tmp_path / "of a run").generations == 1
    with pytest.raises(InputError, match=r"resume that run: swarmwright resume '.*of a run'$"):
        optimize(EXPERIMENT, out=tmp_path / "of a run")


def test_the_best_controller_can_be_pickled(finished: Run) -> None:
    controller = finished.best.controller
    again = pickle.loads(pickle.dumps(controller))
    assert again([0.9, 0.0, 0.5, 0.1]).tobytes() == controller([0.9, 0.0, 0.5, 0.1]).tobytes()


def test_a_run_in_a_relative_folder_outlives_another_working_folder(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(copy.parent)
    run = Run.open("copy")
    assert (run.path, run._store.file) == (Path("copy"), Path("copy/run.sqlite"))
    with pytest.raises(InputError, match=r"^copy: has generations 0 to \d+, but no generation 99$"):
        run.seeds(99)
    monkeypatch.chdir("/")
    assert (run.path, run._store.file) == (copy, copy / "run.sqlite")
    assert len(run.record.fitness) == run.evaluations
    assert run.best.controller.sensors == 4
    assert repeat(run).same
    assert run.replay().fitness == run.evaluation().episodes[0]
    run.export(copy / "table.csv")
    with pytest.raises(InputError, match=rf"^{re.escape(str(copy))}: has generations"):
        run.seeds(99)
    assert resume(run, generations=run.generations + 1).generations == run.generations + 1
    monkeypatch.chdir(copy.parent)
    assert run.path == Path("copy")


def test_default_folders_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert default_folder(EXPERIMENT) == Path("runs/minisim-1")
    assert default_folder(EXPERIMENT) == Path("runs/minisim-1-2")
    EXPERIMENT.save("my first.yaml")
    assert default_folder(Experiment.load("my first.yaml").replace(seed=7)) == Path("runs/my_first-7")
    strange = Experiment.from_mapping({"simulation": "../../etc"})
    assert default_folder(strange).parent == Path("runs")


def test_default_folders_are_made_by_one_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    together = Barrier(8, timeout=60)

    def take(_: int) -> list[Path]:
        together.wait()
        return [default_folder(EXPERIMENT) for _ in range(20)]

    with ThreadPoolExecutor(8) as pool:
        folders = [folder for taken in pool.map(take, range(8)) for folder in taken]
    assert len(set(folders)) == 160
    assert all(folder.is_dir() for folder in folders)


def test_optimizations_at_once_have_their_own_default_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    together = Barrier(4, timeout=60)

    def evolve(_: int) -> Run:
        together.wait()
        return optimize(EXPERIMENT)

    with ThreadPoolExecutor(4) as pool:
        runs = list(pool.map(evolve, range(4)))
    assert len({run.path for run in runs}) == 4
    assert len({run.digest for run in runs}) == 1


def test_default_folders_that_cannot_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("runs").write_text("a file")
    with pytest.raises(InputError, match=r"^runs: cannot be created: File exists$"):
        optimize(EXPERIMENT)


def test_quantiles() -> None:
    assert quantile([1, 2, 3, 4, 5], 0.5) == 3
    assert quantile([1, 2], 0.25) == 1.25
    assert quantile([7], 0.75) == 7
    assert np.isnan(quantile([], 0.5))


def test_what_a_run_has_is_on_its_reference_page(finished: Run, root: Path) -> None:
    """All else is internal, and begins with _."""
    text = (root / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    page = text.partition("\n## Run\n")[2].partition("\n## ")[0]
    names = [name for name in dir(finished) if not name.startswith("_")]
    assert {"best", "export", "record"} <= set(names)
    assert [name for name in names if not re.search(rf"`(Run\.)?{name}\b", page)] == []
