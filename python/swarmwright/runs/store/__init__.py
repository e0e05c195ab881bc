"""The store of a run: an SQLite file with all evaluations and their history.

Any program can read it; docs/reference/run-folder.md describes its tables. The record (candidates, seeds and
results, in order) is identical for the same experiment and seed. Sessions, attempts and events describe how
the run went, and have their own tables.
"""

from swarmwright.runs.store.blocks import Record
from swarmwright.runs.store.database import FILE, FORMAT
from swarmwright.runs.store.lookup import Best, Evaluation
from swarmwright.runs.store.reader import StoreReader
from swarmwright.runs.store.writer import StoreWriter

__all__ = [
    "FILE",
    "FORMAT",
    "Best",
    "Evaluation",
    "Record",
    "StoreReader",
    "StoreWriter",
]
