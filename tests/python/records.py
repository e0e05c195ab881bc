"""A small run to look at, and comparing what runs left behind."""

import hashlib
import json
import sqlite3
import struct
from pathlib import Path

import numpy as np

from swarmwright import Experiment, Run
from swarmwright.runs.store import FILE

EXPERIMENT = Experiment.from_mapping(
    {
        "simulation": "minisim",
        "parameters": {"placement": "random", "maxSteps": 5},
        "method": {"population": 12, "generations": 4},
        "ranking": {"episodes": 2},
        "servers": "local",
    }
)


def same_record(run: Run, expected: Run) -> None:
    """Two runs have the same record, figures and best controller, byte for byte."""
    assert run.digest == expected.digest
    assert run.history == expected.history
    assert (run.path / "best.json").read_bytes() == (expected.path / "best.json").read_bytes()


def change(folder: Path, *statements: str) -> None:
    """Change a store by SQL, as damage would: its digests stay."""
    store = sqlite3.connect(folder / FILE)
    with store:
        for statement in statements:
            assert store.execute(statement).rowcount > 0
    store.close()


def change_numbers(
    folder: Path, column: str, candidates: slice, values: float, *, generation: int | None = None
) -> None:
    """Write other numbers into a column of blocks (of one generation, or of all), as damage would."""
    store = sqlite3.connect(folder / FILE)
    where = "" if generation is None else f"WHERE generation = {generation}"
    with store:
        blocks = store.execute(f"SELECT first, evaluations, {column} FROM block {where}").fetchall()
        assert blocks
        for first, evaluations, data in blocks:
            numbers = np.frombuffer(data, dtype="<f4" if column == "genomes" else "<f8").copy()
            numbers.reshape(evaluations, -1)[candidates] = values
            store.execute(f"UPDATE block SET {column} = ? WHERE first = ?", (numbers.tobytes(), first))
    store.close()


ATTEMPTS: list[tuple[int, int, int, int, float, float, str, str | None]] = [
    # generation, candidates, episodes, server, started, seconds, outcome, error
    (0, 4, 2, 7, 0.0, 10.0, "done", None),
    (0, 4, 2, 7, 5.0, 10.0, "done", None),  # overlaps: at work from 0 to 15
    (0, 4, 2, 9, 0.0, 40.0, "done", None),
    (1, 1, 2, 9, 60.0, 5.0, "failed", "out of fuel"),
    (1, 1, 2, 9, 61.0, 4.0, "failed", "out of fuel"),
    (1, 4, 2, 7, 90.0, 10.0, "done", None),
]


def write_attempts(folder: Path) -> None:
    """Write a session of 100 s from 1,000,000 s on with `ATTEMPTS`, each from candidate 3 on."""
    store = sqlite3.connect(folder / FILE)
    with store:
        store.execute("DELETE FROM attempt")
        store.execute("UPDATE session SET started = '1970-01-12T13:46:40+00:00', seconds = 100")
        store.execute("UPDATE generation SET seconds = 25.0 * (generation + 1)")
        store.executemany(
            "INSERT INTO attempt (session, generation, mode, candidate, candidates, episode, episodes, "
            "server, attempt, started, seconds, outcome, error) "
            "VALUES (1, ?, 'offloaded', 3, ?, 0, ?, ?, 1, 1000000 + ?, ?, ?, ?)",
            ATTEMPTS,
        )
    store.close()


def seal(folder: Path) -> None:
    """Write all digests anew, as documented, as a program that changes a store deliberately would."""
    store = sqlite3.connect(folder / FILE)
    with store:
        for generation, digest in of_evaluations(store).items():
            store.execute(
                "UPDATE generation SET evaluations_digest = ? WHERE generation = ?", (digest, generation)
            )
        for generation, digest in of_generations(store).items():
            store.execute("UPDATE generation SET digest = ? WHERE generation = ?", (digest, generation))
        store.execute("UPDATE fact SET value = ? WHERE name = 'digest'", (digest_facts(store),))
    store.close()


def of_evaluations(store: sqlite3.Connection) -> dict[int, str]:
    """The digest of each generation's evaluations, as docs/reference/run-folder.md says."""
    digests = {}
    for generation, first, count in store.execute(
        "SELECT generation, first, evaluations - first FROM generation"
    ).fetchall():
        whole = hashlib.sha256(struct.pack("<3q", first, generation, count))
        for column in ("fitness", "episodes", "metrics", "genomes"):
            blocks = store.execute(
                f"SELECT {column} FROM block WHERE generation = ? ORDER BY first",
                (generation,),
            )
            content = b"".join(data for (data,) in blocks)
            if column == "genomes":
                content = sample(store, generation) + content
            whole.update(hashlib.sha256(content).digest())
        digests[generation] = whole.hexdigest()
    return digests


def sample(store: sqlite3.Connection, generation: int) -> bytes:
    """What the genomes of a generation are made from; nothing where its blocks have them."""
    rows = store.execute("SELECT address, numbers FROM sample WHERE generation = ?", (generation,))
    return b"".join(address.encode() + numbers for address, numbers in rows)


def of_generations(store: sqlite3.Connection) -> dict[int, str]:
    """The digest of each generation and all before it, as docs/reference/run-folder.md says."""
    digests, before = {}, ""
    for *whole, seeds, evaluations in store.execute(
        "SELECT generation, first, evaluations, failed, leader, best, mean, best_so_far, lower_quartile, "
        "median, upper_quartile, seeds, evaluations_digest FROM generation ORDER BY generation"
    ):
        numbers = struct.pack("<5q6d", *(float("nan") if one is None else one for one in whole))
        content = b"".join((before.encode(), numbers, str(seeds).encode(), evaluations.encode()))
        before = digests[whole[0]] = hashlib.sha256(content).hexdigest()
    return digests


def digest_facts(store: sqlite3.Connection) -> str:
    """The digest of the facts, as docs/reference/run-folder.md says."""
    facts = store.execute("SELECT name, value FROM fact WHERE name != 'digest' ORDER BY name")
    return hashlib.sha256(json.dumps([list(fact) for fact in facts]).encode()).hexdigest()
