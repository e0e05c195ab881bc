"""Damage to a store is noticed: no record is read that is not the one that was written."""

import hashlib
import json
import random
import shutil
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmwright import InputError, Run, optimize, resume
from swarmwright.cli import run as program
from swarmwright.store import FILE
from tests.python.records import EXPERIMENT, without_digests

FLIPS = 300


def changed(folder: Path, *statements: str) -> None:
    store = sqlite3.connect(folder / FILE)
    with store:
        for statement in statements:
            assert store.execute(statement).rowcount > 0
    store.close()


def read(folder: Path) -> tuple[str | None, str]:
    """The record's digest, or why it is refused."""
    try:
        return Run.open(folder).digest, ""
    except InputError as error:
        return None, str(error)


@pytest.fixture(scope="module")
def longer(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run of several pages and generations of several blocks of rows."""
    experiment = EXPERIMENT.replace(method={"population": 300, "generations": 3})
    return optimize(experiment, out=tmp_path_factory.mktemp("longer") / "run")


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


DAMAGES = [
    ("UPDATE evaluation SET fitness = fitness + 1 WHERE number = 13", "evaluation", 1),
    ("UPDATE evaluation SET genome = zeroblob(length(genome)) WHERE number = 13", "evaluation", 1),
    ("UPDATE evaluation SET episodes = zeroblob(length(episodes)) WHERE number = 2", "evaluation", 0),
    ("UPDATE evaluation SET candidate = 99 WHERE number = 13", "evaluation", 1),
    ("UPDATE evaluation SET fitness = 'x' WHERE number = 13", "evaluation", 1),
    ("UPDATE generation SET best = best + 1 WHERE generation = 2", "generation", 2),
    ("UPDATE generation SET seeds = '[5, 6]' WHERE generation = 0", "generation", 0),
    ("UPDATE generation SET leader = leader + 1 WHERE generation = 3", "generation", 3),
    ("UPDATE generation SET digest = upper(digest) WHERE generation = 1", "generation", 1),
    ("UPDATE generation SET evaluations_digest = NULL WHERE generation = 1", "generation", 1),
]


@pytest.mark.parametrize(("damage", "table", "generation"), DAMAGES)
def test_the_generation_and_the_table_are_named(
    copy: Path, damage: str, table: str, generation: int, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(copy, damage)
    with pytest.raises(
        InputError, match=f"generation {generation}: the table {table} disagrees with its digest"
    ):
        _ = Run.open(copy).digest
    assert program(["runs", "verify", str(copy), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    (problem,) = found["problems"]
    assert problem == {
        "what": f"the table {table} disagrees with its digest",
        "generations": [generation],
    }
    assert found["good_generations"] == [one for one in range(4) if one != generation]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("DELETE FROM generation WHERE generation = 3", "evaluations from 26 to 32 belong to no generation"),
        (
            "DELETE FROM generation WHERE generation = 1",
            "generation 1: it is missing in the table generation",
        ),
        ("DELETE FROM evaluation WHERE number = 32", "generation 3: 1 evaluations are missing"),
        ("UPDATE fact SET value = '{}' WHERE name = 'experiment'", "the table fact, with the experiment"),
        ("UPDATE fact SET name = 'digesu' WHERE name = 'digest'", "the digest of the table fact is missing"),
        ("DELETE FROM fact WHERE name = 'ended'", "the table fact, with the experiment"),
    ],
)
def test_what_is_missing_is_named(
    copy: Path, damage: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(copy, damage)
    with pytest.raises(InputError, match=words):
        _ = Run.open(copy).digest
    assert program(["runs", "verify", str(copy)]) == 1
    assert words in capsys.readouterr().out


READERS: list[Callable[[Run], object]] = [
    lambda run: run.record,
    lambda run: run.digest,
    lambda run: run.evaluation(1, 1),
    lambda run: run.evaluation(None, 1),
    lambda run: run.evaluation(13),
    lambda run: run.plot(),
    lambda run: list(run.store.generations()),
    lambda run: list(run.store.one_generation(1)),
    lambda run: resume(run, generations=9),
]


@pytest.mark.parametrize("reader", range(len(READERS)))
def test_whoever_reads_a_damaged_evaluation_is_told(copy: Path, reader: int) -> None:
    changed(copy, DAMAGES[0][0])
    with pytest.raises(InputError, match="generation 1: the table evaluation disagrees with its digest"):
        READERS[reader](Run.open(copy))
    assert Run.open(copy).evaluation(None, 0).generation == 0, "other generations can be read"


def test_a_damaged_leader_is_not_taken_for_the_best(copy: Path) -> None:
    leader = Run.open(copy).evaluation().number
    changed(copy, f"UPDATE evaluation SET genome = zeroblob(length(genome)) WHERE number = {leader}")
    with pytest.raises(InputError, match="the table evaluation disagrees with its digest"):
        _ = Run.open(copy).best


def test_half_a_record_is_not_left_behind(copy: Path, tmp_path: Path) -> None:
    changed(copy, DAMAGES[0][0])
    for name in ("x.csv", "x.parquet"):
        with pytest.raises(InputError, match="generation 1: the table evaluation disagrees"):
            Run.open(copy).export(tmp_path / name)
        assert not (tmp_path / name).exists()


def test_the_bytes_are_those_that_the_documentation_names(finished: Run) -> None:
    store = sqlite3.connect(finished.path / FILE)

    def number(value: float | None) -> float:
        return float("nan") if value is None else value

    before = ""
    for row in store.execute(
        "SELECT generation, first, evaluations, failed, leader, best, mean, best_so_far, lower_quartile, "
        "median, upper_quartile, seeds, evaluations_digest, digest FROM generation ORDER BY generation"
    ):
        total = hashlib.sha256()
        for line in store.execute("SELECT * FROM evaluation WHERE generation = ? ORDER BY number", row[:1]):
            total.update(struct.pack("<3qd3q", *line[:3], number(line[3]), *map(len, line[4:])))
            total.update(b"".join(line[4:]))
        assert total.hexdigest() == row[12]
        numbers = struct.pack("<5q6d", *row[:5], *map(number, row[5:11]))
        before = hashlib.sha256(
            b"".join((before.encode(), numbers, row[11].encode(), row[12].encode()))
        ).hexdigest()
        assert before == row[13]
    facts = [list(fact) for fact in store.execute("SELECT name, value FROM fact ORDER BY name")]
    sealed = dict(facts)["digest"]
    others = json.dumps([fact for fact in facts if fact[0] != "digest"])
    assert hashlib.sha256(others.encode()).hexdigest() == sealed
    store.close()


def test_a_run_of_an_earlier_version_can_be_read_and_gets_digests_when_it_goes_on(
    copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without_digests(copy)
    assert Run.open(copy).record.fitness.shape == (33,)
    assert program(["runs", "verify", str(copy)]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{copy}: nothing found, 4 generations, 33 evaluations; it has no digests")
    resume(copy, generations=6)
    whole = optimize(EXPERIMENT.replace(method={"generations": 6}), out=tmp_path / "whole")
    assert chain(copy) == chain(whole.path)
    assert None not in chain(copy)
    assert program(["runs", "verify", str(copy)]) == 0
    assert capsys.readouterr().out.startswith(f"{copy}: ok, 6 generations, ")


def chain(folder: Path) -> list[str | None]:
    store = sqlite3.connect(folder / FILE)
    found = [digest for (digest,) in store.execute("SELECT digest FROM generation ORDER BY generation")]
    store.close()
    return found


def test_verify_takes_several_runs_and_leaves_files_out(
    finished: Run, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(copy, DAMAGES[0][0])
    assert program(["runs", "verify", str(finished.path), str(copy), __file__]) == 1
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        f"{finished.path}: ok, 4 generations, 33 evaluations",
        f"{copy}: damaged: generation 1: the table evaluation disagrees with its digest",
        f"{copy}: good are the generations 0, 2 to 3",
    ]
    assert "left out" in said.err
    assert program(["runs", "verify", str(copy.parent)]) == 2
    assert "is not a run folder" in capsys.readouterr().err
