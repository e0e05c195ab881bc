"""Damage to a store is noticed: no record is read that is not the one that was written."""

import hashlib
import json
import random
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from swarmwright import InputError, Run, _engine, optimize, resume
from swarmwright.cli import run as program
from swarmwright.runs.store import FILE
from tests.python.records import (
    EXPERIMENT,
    change,
    change_numbers,
    digest_facts,
    of_evaluations,
    of_generations,
    same_record,
)

FLIPS = 300


def read(folder: Path) -> tuple[str | None, str]:
    """The record's digest, or why it is refused."""
    try:
        run = Run.open(folder)
        _ = run.record  # which compares every evaluation
        return run.digest, ""
    except InputError as error:
        return None, str(error)


@pytest.fixture(scope="module")
def longer(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run of several pages and generations of several blocks of rows."""
    experiment = EXPERIMENT.replace(method={"population": 300, "generations": 3})
    return optimize(experiment, out=tmp_path_factory.mktemp("longer") / "run")


@pytest.mark.slow
@pytest.mark.timeout(180)
@pytest.mark.parametrize("which", ["finished", "longer"])
def test_a_flipped_bit_changes_nothing_or_is_told_of(
    which: str, request: pytest.FixtureRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run: Run = request.getfixturevalue(which)
    folder = tmp_path / "run"
    shutil.copytree(run.path, folder)
    whole, good = (folder / FILE).read_bytes(), run.digest
    bits = random.Random(7)
    told = 0
    for _ in range(FLIPS if which == "finished" else FLIPS // 5):
        at = bits.randrange(8 * len(whole))
        damaged = bytearray(whole)
        damaged[at // 8] ^= 1 << at % 8
        (folder / FILE).write_bytes(damaged)
        digest, words = read(folder)
        assert digest in (good, None), at
        if digest is None:
            told += 1
            assert words.startswith(f"{folder / FILE}: "), at
            assert program(["runs", "verify", str(folder)]) == 1, at
            assert f"{folder}: damaged: " in capsys.readouterr().out
    assert told > FLIPS // 20


DAMAGES: list[tuple[str | tuple[str, slice, float], str, int]] = [
    (("fitness", slice(3, 4), 1.0), "block", 1),
    (("genomes", slice(3, 4), 0.0), "block", 1),
    (("episodes", slice(2, 3), 0.0), "block", 0),
    ("UPDATE block SET first = first + 1 WHERE generation = 1", "missing", 1),
    ("UPDATE block SET generation = 99 WHERE generation = 1", "missing", 1),
    ("UPDATE block SET evaluations = evaluations - 1 WHERE generation = 1", "block", 1),
    ("UPDATE block SET fitness = 'x' WHERE generation = 1", "block", 1),
    ("UPDATE block SET episodes = x'00' WHERE generation = 1", "block", 1),
    ("UPDATE generation SET best = best + 1 WHERE generation = 2", "generation", 2),
    ("UPDATE generation SET seeds = '[5, 6]' WHERE generation = 0", "generation", 0),
    ("UPDATE generation SET leader = leader + 1 WHERE generation = 3", "generation", 3),
    ("UPDATE generation SET digest = upper(digest) WHERE generation = 1", "generation", 1),
    ("UPDATE generation SET evaluations_digest = '' WHERE generation = 1", "generation", 1),
]


def damage(folder: Path, which: int = 0) -> None:
    what, _, generation = DAMAGES[which]
    if isinstance(what, str):
        change(folder, what)
    else:
        change_numbers(folder, *what, generation=generation)


@pytest.mark.parametrize("which", range(len(DAMAGES)))
def test_the_generation_and_the_table_are_named(
    copy: Path, which: int, capsys: pytest.CaptureFixture[str]
) -> None:
    damage(copy, which)
    _, table, generation = DAMAGES[which]
    what = "evaluations are missing" if table == "missing" else f"the table {table} does not match its digest"
    with pytest.raises(InputError, match=rf"generation {generation}: (\d+ )?{what}"):
        _ = Run.open(copy).record
    assert program(["runs", "verify", str(copy), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    (problem,) = found["problems"]
    assert problem["what"].endswith(what)
    assert problem["generations"] == [generation]
    assert found["good_generations"] == [one for one in range(4) if one != generation]


@pytest.mark.parametrize(
    ("change_", "words"),
    [
        ("DELETE FROM generation WHERE generation = 3", "evaluations from 26 to 32 belong to no generation"),
        (
            "DELETE FROM generation WHERE generation = 1",
            "generation 1: it is missing in the table generation",
        ),
        ("DELETE FROM block WHERE generation = 3", "generation 3: 7 evaluations are missing"),
        (
            "UPDATE fact SET value = '{}' WHERE name = 'experiment'",
            "the table fact, which holds the experiment",
        ),
        ("UPDATE fact SET name = 'digesu' WHERE name = 'digest'", "the digest of the table fact is missing"),
        ("DELETE FROM fact WHERE name = 'ended'", "the table fact, which holds the experiment"),
    ],
)
def test_what_is_missing_is_named(
    copy: Path, change_: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    change(copy, change_)
    with pytest.raises(InputError, match=words):
        _ = Run.open(copy).record
    assert program(["runs", "verify", str(copy)]) == 1
    assert words in capsys.readouterr().out


READERS: list[Callable[[Run], object]] = [
    lambda run: run.record,
    lambda run: run.evaluation(1, 1),
    lambda run: run.evaluation(None, 1),
    lambda run: run.evaluation(13),
    lambda run: run.plot(),
    lambda run: list(run._store.generations()),
    lambda run: list(run._store.read_generation(1)),
    lambda run: resume(run, generations=9),
]


@pytest.mark.parametrize("reader", range(len(READERS)))
def test_whoever_reads_a_damaged_evaluation_is_told(copy: Path, reader: int) -> None:
    damage(copy)
    with pytest.raises(InputError, match="generation 1: the table block does not match its digest"):
        READERS[reader](Run.open(copy))
    assert Run.open(copy).evaluation(None, 0).generation == 0, "other generations can be read"


def test_a_damaged_leader_is_not_taken_for_the_best(copy: Path) -> None:
    leader = Run.open(copy).evaluation()
    change_numbers(
        copy, "genomes", slice(leader.candidate, leader.candidate + 1), 0, generation=leader.generation
    )
    with pytest.raises(InputError, match="the table block does not match its digest"):
        _ = Run.open(copy).best


def test_half_a_record_is_not_left_behind(copy: Path, tmp_path: Path) -> None:
    damage(copy)
    for name in ("x.csv", "x.parquet"):
        with pytest.raises(InputError, match="generation 1: the table block does not match"):
            Run.open(copy).export(tmp_path / name)
        assert not (tmp_path / name).exists()


def test_the_bytes_are_those_that_the_documentation_names(finished: Run) -> None:
    store = sqlite3.connect(finished.path / FILE)
    rows = store.execute("SELECT generation, evaluations_digest, digest FROM generation").fetchall()
    assert {generation: digest for generation, digest, _ in rows} == of_evaluations(store)
    assert {generation: digest for generation, _, digest in rows} == of_generations(store)
    assert store.execute("SELECT value FROM fact WHERE name = 'digest'").fetchone()[0] == digest_facts(store)
    store.close()


def test_the_digests_do_not_depend_on_the_size_of_blocks(
    finished: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmwright.runs.store.blocks._BLOCK_BYTES", 700)
    split = optimize(EXPERIMENT, out=tmp_path / "run")
    same_record(split, finished)
    assert chain(split.path) == chain(finished.path)
    store = sqlite3.connect(split.path / FILE)
    blocks = [count for (count,) in store.execute("SELECT evaluations FROM block ORDER BY first")]
    store.close()
    assert sum(blocks) == 33
    assert len(blocks) > 8
    assert max(blocks) > 1
    for number in range(33):
        one, other = split.evaluation(number), finished.evaluation(number)
        assert (one.number, one.generation, one.candidate) == (number, other.generation, other.candidate)
        assert one.genome.tobytes() == other.genome.tobytes()
        assert one.episodes.tobytes() == other.episodes.tobytes()
    assert split.evaluation(None, 1).candidate == finished.evaluation(None, 1).candidate
    assert resume(split, generations=6).generations == 6


def chain(folder: Path) -> list[str]:
    store = sqlite3.connect(folder / FILE)
    found = [digest for (digest,) in store.execute("SELECT digest FROM generation ORDER BY generation")]
    store.close()
    return found


def test_verify_takes_several_runs_and_leaves_files_out(
    finished: Run, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damage(copy)
    assert program(["runs", "verify", str(finished.path), str(copy), __file__]) == 1
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        f"{finished.path}: ok, 4 generations, 33 evaluations",
        f"{copy}: damaged: generation 1: the table block does not match its digest",
        f"{copy}: generations 0, 2 to 3 are intact",
    ]
    assert "left out" in said.err
    assert program(["runs", "verify", str(copy.parent)]) == 2
    assert "is not a run folder" in capsys.readouterr().err


def test_digests_of_columns_are_those_of_their_bytes() -> None:
    random_numbers = np.random.default_rng(1)
    odd = np.array([0x7FF8_0000_0000_0001, 0xFFF8_0000_0000_0000], dtype=np.uint64).view(np.float64)
    fitness = np.concatenate([random_numbers.normal(size=1500), odd, [-0.0]])
    columns = (
        random_numbers.normal(size=(len(fitness), 3)),
        random_numbers.normal(size=(len(fitness), 3, 2)),
        random_numbers.normal(size=(len(fitness), 7)).astype(np.float32),
    )
    digests = _engine.Digests(fitness, *columns)
    plain = np.concatenate([fitness[:1500], [np.nan, np.nan, 0.0]])  # one NaN and one zero
    expected = [hashlib.sha256(column.tobytes()).digest() for column in (plain, *columns)]
    assert digests.columns() == expected
    assert digests.columns() == expected, "also a second time"
    none = _engine.Digests(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 0)), np.zeros((0, 7), np.float32))
    assert none.columns() == [hashlib.sha256(b"").digest()] * 4
