"""Insert generations, attempts and events into a store's tables, within the caller's transaction."""

import json
import sqlite3

from swarmwright import _engine
from swarmwright.runs.store.blocks import EvaluationsDigest, combine_digests, encode_blocks
from swarmwright.runs.store.digests import digest_generation
from swarmwright.runs.store.provenance import timestamp
from swarmwright.servers.rows import GenerationResult, Journal

_BLOCK = "INSERT INTO block VALUES (?, ?, ?, ?, ?, ?, ?)"
_SAMPLE = "INSERT INTO sample VALUES (?, ?, ?)"
_GENERATION = "INSERT INTO generation VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
_ATTEMPT = "INSERT INTO attempt VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
_EVENT = "INSERT INTO event VALUES (?, ?, ?, ?, ?)"


class SeedsText:
    """A cache of the last seeds as JSON, since many generations have the same seeds."""

    def __init__(self) -> None:
        self._last: tuple[list[int], str] = ([], "[]")

    def of(self, seeds: list[int]) -> str:
        """Format seeds as JSON."""
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
        session: number of the session in which it was evaluated, from 1.
        result: the generation.
        seconds: from the beginning of the session to the end of this generation.
        previous: digest of the previous generation, empty for the first.
        texts: caches the text of the last seeds.

    Returns the generation's digest.
    """
    summary, number, journal = result.summary, result.generation, result.journal
    first = summary.evaluations - len(result.genomes)
    seeds = texts.of(result.seeds)
    if journal.attempts or journal.warnings:
        insert_journal(connection, session, number, journal)
    genomes = result.genomes
    sample = (genomes.address, genomes.numbers) if isinstance(genomes, _engine.Sample) else None
    if sample is not None:
        connection.execute(_SAMPLE, (number, *sample))
    total = EvaluationsDigest(sample) if result.digests is None else None
    for block in encode_blocks(result, first):
        if total is not None:
            total.add(block)
        connection.execute(_BLOCK, block)
    digests = result.digests or total
    assert digests is not None
    digest = combine_digests(digests.columns(), first, number, len(genomes))
    leader, failed = result.leader, summary.failed
    whole = (number, first, summary.evaluations, failed, leader)
    figures = (
        *(summary.best, summary.mean, summary.best_so_far),
        *(summary.lower_quartile, summary.median, summary.upper_quartile),
    )
    after = digest_generation(previous, whole, figures, seeds, digest)
    row = (number, first, seeds, summary.evaluations, *figures)
    connection.execute(_GENERATION, (*row, failed, leader, session, seconds, digest, after))
    return after


def insert_journal(connection: sqlite3.Connection, session: int, generation: int, journal: Journal) -> None:
    """Insert the attempts and warnings of a generation."""
    key = (session, generation)
    connection.executemany(_ATTEMPT, (key + entry for entry in journal.attempts))
    for entry in journal.warnings:
        prefix = "" if entry.candidate is None else f"candidate {entry.candidate}, "
        event = (*key, timestamp(entry.time), "warning", prefix + entry.text)
        connection.execute(_EVENT, event)


def insert_event(connection: sqlite3.Connection, session: int, kind: str, text: str) -> None:
    """Insert an event of a session that happens now and belongs to no generation."""
    connection.execute(_EVENT, (session, None, timestamp(), kind, text))
