"""Inserting generations, attempts and events into a store's tables, within a transaction of the caller."""

import json
import sqlite3

from swarmwright import _engine
from swarmwright.common.arrays import Genomes
from swarmwright.runs.store.blocks import EvaluationsDigest, Sample, encoded, of_columns
from swarmwright.runs.store.digests import of_generation
from swarmwright.runs.store.provenance import timestamp
from swarmwright.servers.rows import GenerationResult, Journal

_BLOCK = "INSERT INTO block VALUES (?, ?, ?, ?, ?, ?, ?)"
_SAMPLE = "INSERT INTO sample VALUES (?, ?, ?)"
_GENERATION = "INSERT INTO generation VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
_ATTEMPT = "INSERT INTO attempt VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
_EVENT = "INSERT INTO event VALUES (?, ?, ?, ?, ?)"


class SeedsText:
    """The last seeds as JSON: those of many generations are the same."""

    def __init__(self) -> None:
        self._last: tuple[list[int], str] = ([], "[]")

    def of(self, seeds: list[int]) -> str:
        """Return seeds as JSON."""
        if seeds != self._last[0]:
            self._last = seeds, json.dumps(seeds)
        return self._last[1]


def insert_generation(
    connection: sqlite3.Connection,
    session: int,
    result: GenerationResult,
    seconds: float,
    previous: str,
    texts: SeedsText,
) -> str:
    """Insert a generation, with its attempts and warnings.

    Args:
        connection: to the store, within a transaction.
        session: in which it was evaluated, from 1.
        result: what is inserted.
        seconds: from the beginning of the session to the end of this generation.
        previous: digest of the generation before it, empty for the first one.
        texts: remembers the text of the last seeds.

    Returns the generation's digest, which goes on from the previous one's.
    """
    summary, number, journal = result.summary, result.generation, result.journal
    first = summary.evaluations - len(result.genomes)
    seeds = texts.of(result.seeds)
    if journal.attempts or journal.warnings:
        insert_journal(connection, session, number, journal)
    sample = _sample(result.genomes)
    if sample is not None:
        connection.execute(_SAMPLE, (number, *sample))
    total = EvaluationsDigest(sample) if result.digests is None else None
    for block in encoded(result, first):
        if total is not None:
            total.add(block)
        connection.execute(_BLOCK, block)
    known = result.digests or total
    assert known is not None
    digest = of_columns(known.columns(), first, number, len(result.genomes))
    leader, failed = result.leader, summary.failed
    whole = (number, first, summary.evaluations, failed, leader)
    figures = (
        *(summary.best, summary.mean, summary.best_so_far),
        *(summary.lower_quartile, summary.median, summary.upper_quartile),
    )
    after = of_generation(previous, whole, figures, seeds, digest)
    row = (number, first, seeds, summary.evaluations, *figures)
    connection.execute(_GENERATION, (*row, failed, leader, session, seconds, digest, after))
    return after


def insert_journal(connection: sqlite3.Connection, session: int, generation: int, journal: Journal) -> None:
    """Insert the attempts at evaluations of a generation, and the warnings meanwhile."""
    place = (session, generation)
    connection.executemany(_ATTEMPT, (place + entry for entry in journal.attempts))
    for entry in journal.warnings:
        whose = "" if entry.candidate is None else f"candidate {entry.candidate}, "
        event = (*place, timestamp(entry.time), "warning", whose + entry.text)
        connection.execute(_EVENT, event)


def insert_event(connection: sqlite3.Connection, session: int, kind: str, text: str) -> None:
    """Insert what happened just now in a session, in no particular generation."""
    connection.execute(_EVENT, (session, None, timestamp(), kind, text))


def _sample(genomes: Genomes | _engine.Sample) -> Sample | None:
    """Return what the genomes are made from, as it is stored."""
    return (genomes.address, genomes.numbers) if isinstance(genomes, _engine.Sample) else None
