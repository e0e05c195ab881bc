"""Generations whose genomes are made from a sample: what the store keeps of them, and what is read."""

import json
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, RunError, _engine, optimize, resume
from swarmwright.cli import run as program
from swarmwright.runs.optimization.ahead import Ahead
from swarmwright.runs.store import FILE
from tests.protocol.samples import ROWS, genomes
from tests.python.records import change, of_evaluations, of_generations, same_record, seal

SAMPLED: tuple[dict[str, Any], ...] = (
    {"kind": "openai_es", "population": 40, "generations": 5},
    {"kind": "pgpe", "population": 40, "generations": 5},
    {"kind": "snes", "population": 31, "generations": 5},
    {"kind": "snes", "population": 20, "generations": 60, "step": 0.05, "rate": 0.5, "restart": "ipop"},
)


def experiment(method: dict[str, Any], **other: Any) -> Experiment:
    controller = {"kind": "layered", "hidden": [3]}
    values = {"simulation": "minisim", "controller": controller, "method": method, "seed": 4}
    return Experiment.from_mapping({"servers": "in-process", **values, **other})


@pytest.fixture(scope="module")
def sampled(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run of openai_es, not to be changed."""
    return optimize(experiment(SAMPLED[0]), out=tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture
def copied(sampled: Run, tmp_path: Path) -> Path:
    """One to break."""
    shutil.copytree(sampled.path, tmp_path / "copied")
    return tmp_path / "copied"


def rows(folder: Path, query: str) -> list[Any]:
    store = sqlite3.connect(folder / FILE)
    found = store.execute(query).fetchall()
    store.close()
    return found


@pytest.mark.parametrize("method", SAMPLED, ids=lambda method: f"{method['kind']}-{method['generations']}")
def test_genomes_are_what_the_reference_makes_of_the_table(method: dict[str, Any], tmp_path: Path) -> None:
    run = optimize(experiment(method), out=tmp_path / "run")
    assert rows(run.path, "SELECT DISTINCT length(genomes) FROM block") == [(0,)]
    record = run.record
    kept = rows(run.path, "SELECT generation, address, numbers FROM sample ORDER BY generation")
    assert [generation for generation, _, _ in kept] == list(range(method["generations"]))
    for generation, address, numbers in (kept[0], kept[-1]):
        names = np.frombuffer(numbers, "<f8").reshape(len(ROWS), -1)
        sample = json.loads(address) | {"first": 0} | dict(zip(ROWS, names, strict=True))
        made = record.genomes[record.generation == generation]
        assert sample["count"] == len(made)
        assert genomes(sample).tobytes() == made.tobytes()
    store = sqlite3.connect(run.path / FILE)
    stored = store.execute("SELECT generation, evaluations_digest, digest FROM generation").fetchall()
    assert {generation: digest for generation, digest, _ in stored} == of_evaluations(store)
    assert {generation: digest for generation, _, digest in stored} == of_generations(store)
    store.close()


@pytest.mark.parametrize("method", SAMPLED[:3], ids=lambda method: str(method["kind"]))
def test_the_ordinary_loop_keeps_the_same(
    method: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = optimize(experiment(method), out=tmp_path / "run")
    monkeypatch.setattr(Ahead, "of", classmethod(lambda *_, **__: None))
    ordinary = optimize(experiment(method), out=tmp_path / "ordinary")
    same_record(ordinary, run)
    query = "SELECT * FROM sample ORDER BY generation"
    assert rows(ordinary.path, query) == rows(run.path, query)
    monkeypatch.setattr("swarmwright.runs.store.blocks._BLOCK_BYTES", 100)  # many blocks in each generation
    split = optimize(experiment(method), out=tmp_path / "split")
    same_record(split, run)
    assert len(rows(split.path, "SELECT 1 FROM block")) > len(rows(run.path, "SELECT 1 FROM block"))
    assert split.record.genomes.tobytes() == run.record.genomes.tobytes()
    for folder in (split, run):
        folder.export(folder.path / "record.csv")
    assert (split.path / "record.csv").read_bytes() == (run.path / "record.csv").read_bytes()


@pytest.mark.parametrize("method", SAMPLED, ids=lambda method: f"{method['kind']}-{method['generations']}")
def test_a_run_goes_on_from_samples(method: dict[str, Any], tmp_path: Path) -> None:
    whole = optimize(experiment(method), out=tmp_path / "whole")
    for last in (0, method["generations"] - 2):  # with new starts of snes behind the second
        part = optimize(experiment(method), lambda now: now.generation < last, out=tmp_path / str(last))  # noqa: B023
        assert part.generations == last + 1
        same_record(resume(part), whole)


def test_few_candidates_are_kept_as_genomes(tmp_path: Path) -> None:
    for population in (12, 14):
        method = {"kind": "openai_es", "population": population, "generations": 2}
        run = optimize(experiment(method), out=tmp_path / str(population))
        assert len(rows(run.path, "SELECT 1 FROM sample")) == (2 if population > 12 else 0)
        assert run.record.genomes.shape == (
            2 * population,
            experiment(method).representation(4, 1).genome_size,
        )


def test_one_evaluation_is_that_of_the_record(sampled: Run) -> None:
    record = sampled.record
    for number in (0, 39, 40, 57, 199):
        one = sampled.evaluation(number)
        assert one.genome.tobytes() == record.genomes[number].tobytes()
        assert (one.generation, one.candidate) == divmod(number, 40)
    best = sampled.evaluation()
    assert best.genome.tobytes() == record.genomes[best.number].tobytes()
    for generation in sampled._store.generations():
        begin = generation.generation * 40
        assert generation.expand_genomes().tobytes() == record.genomes[begin : begin + 40].tobytes()


def as_long(value: int) -> Callable[[Path], None]:
    """Change the number of candidates of a sample."""

    def changed(folder: Path) -> None:
        change(folder, f"UPDATE sample SET address = replace(address, '40', '{value}') WHERE generation = 1")

    return changed


@pytest.mark.parametrize(
    "damage",
    [
        as_long(41),
        as_long(10**18),
        lambda folder: change(folder, "UPDATE sample SET address = '{' WHERE generation = 1"),
        lambda folder: change(folder, "UPDATE sample SET address = x'00' WHERE generation = 1"),
        lambda folder: change(folder, "UPDATE sample SET numbers = 'x' WHERE generation = 1"),
        lambda folder: change(folder, "UPDATE sample SET numbers = x'00' WHERE generation = 1"),
        lambda folder: change(
            folder, "UPDATE sample SET numbers = zeroblob(length(numbers)) WHERE generation = 1"
        ),
        lambda folder: change(folder, "UPDATE block SET genomes = x'00000000' WHERE generation = 1"),
        lambda folder: change(folder, "DELETE FROM sample WHERE generation = 1"),
    ],
    ids=["count", "large", "JSON", "bytes", "text", "short", "zeros", "genomes", "deleted"],
)
def test_a_damaged_sample_is_named(
    damage: Callable[[Path], None], copied: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damage(copied)
    for read in (
        lambda: Run.open(copied).record,
        lambda: Run.open(copied).evaluation(3, 1),
        lambda: resume(copied, generations=9),
    ):
        with pytest.raises(
            InputError, match=r"generation 1: the tables? block .*do(es)? not match (its|their) digest"
        ):
            read()
    assert Run.open(copied).evaluation(3, 2).candidate == 3, "other generations can be read"
    assert program(["runs", "verify", str(copied)]) == 1
    assert "generations 0, 2 to 4 are intact" in capsys.readouterr().out


def test_a_sample_of_another_run_does_not_go_on(copied: Path) -> None:
    change(
        copied, "UPDATE sample SET address = replace(address, '\"seed\":', '\"seed\":1') WHERE generation = 1"
    )
    seal(copied)
    assert Run.open(copied).generations == 5
    with pytest.raises(RunError, match="generation 1 is not reproducible here"):
        resume(copied, generations=9)


def test_a_sample_says_what_is_wrong_with_it(sampled: Run) -> None:
    ((address, numbers),) = rows(sampled.path, "SELECT address, numbers FROM sample WHERE generation = 0")
    sample = _engine.Sample.read(address, numbers)
    assert (sample.address, sample.numbers, len(sample)) == (address, numbers, 40)
    assert sample.genomes(7, 2).tobytes() == sample.genomes(0, 40)[7:9].tobytes()
    assert sample.genomes(40, 0).shape == (0, sample.genes)
    for first, count in ((40, 1), (0, 41), (2**64 - 1, 2)):
        with pytest.raises(
            _engine.InputError, match=rf"candidates: {count} from {first} on requested, but there are 40"
        ):
            sample.genomes(first, count)
    with pytest.raises(_engine.InputError, match="unknown; expected normal"):
        _engine.Sample.read(address.replace("normal", "cauchy"), numbers)
    with pytest.raises(_engine.InputError, match="bytes are not 6 rows"):
        _engine.Sample.read(address, numbers[:-8])
    with pytest.raises(_engine.InputError, match=r"sample\.center"):
        _engine.Sample.read(address, np.full(6, np.nan).tobytes())
