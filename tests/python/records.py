"""A small run to look at, and comparing what runs left behind."""

import sqlite3
from pathlib import Path

from swarmwright import Experiment, Run
from swarmwright.store import FILE

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


def without_digests(folder: Path) -> None:
    """Make of a run what versions before there were digests have written."""
    store = sqlite3.connect(folder / FILE)
    with store:
        store.execute("DELETE FROM fact WHERE name = 'digest'")
        for column in ("digest", "evaluations_digest"):
            store.execute(f"ALTER TABLE generation DROP COLUMN {column}")
    store.close()
