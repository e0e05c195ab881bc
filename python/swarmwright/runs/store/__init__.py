"""The store of a run: one SQLite file that holds every evaluation, and how each came about.

The file is plain SQLite (docs/reference/run-folder.md has its tables), so that any program reads it. What
belongs to the record (what was evaluated, with which seeds, what came out, in order) is the same for the same
experiment and seed; sessions, attempts and events, which describe how the run went, are kept apart.
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
