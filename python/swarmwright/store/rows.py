"""The rows of a store's tables."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import UnionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.core.statistics import Summary
from swarmwright.typing import Fitness, Genomes


@dataclass(frozen=True, kw_only=True)
class Evaluated:
    """A generation as it was evaluated: what counts for the record."""

    generation: int
    seeds: list[int]
    """Simulation seed of each episode."""
    genomes: Genomes
    """(candidates, genome_size)"""
    episodes: NDArray[np.float64]
    """(candidates, episodes) fitness, NaN where an episode failed."""
    metrics: NDArray[np.float64]
    """(candidates, episodes, metrics), what the experiment's fitness is made of; (.., 0) without."""
    fitness: Fitness
    """(candidates,), as the ranking made it, NaN where a candidate failed."""
    summary: Summary
    """Figures of the population after this generation."""
    leader: int
    """Number, counted over the whole run from 0, of the evaluation that is best after this generation."""


@dataclass(frozen=True, kw_only=True)
class Session:
    """A process that worked on the run: the first one, then one for each time that it was resumed."""

    session: int
    """From 1 on."""
    started: str
    """ISO 8601, UTC."""
    place: str
    """Where the evaluations were made: servers on which broker, or this process."""
    host: str
    machine: str
    """Operating system and processor."""
    versions: dict[str, str]
    """Of Swarmwright, Python, NumPy and the libraries that were used."""
    seconds: float | None
    """Duration; up to the last generation when it was killed; None when it is not known."""
    outcome: str | None
    """done, interrupted, stopped (by a callback), or why it failed; None when it was killed or goes on."""
    code: int | None = None
    """Version of the copy of the source that was used; None where there is none."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One attempt at a batch of evaluations, on one server."""

    session: int
    generation: int
    mode: str
    candidate: int
    """Index of the first candidate, of `candidates` in a row."""
    candidates: int
    episode: int
    """Index of the first episode, of `episodes` in a row."""
    episodes: int
    server: int
    attempt: int
    """1 for the first try."""
    steps: int | None
    """Steps that the server took, where it takes them one by one."""
    started: float
    """Seconds since 1970."""
    seconds: float
    error: str | None
    """Why it failed, if it did."""
    stack: str | None = None
    """Where in the simulation's code, where that is known: the first attempt with this error has it."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """An event worth noting: a warning of the pool, a result that was refused."""

    session: int
    generation: int | None
    time: str
    """ISO 8601, UTC."""
    kind: str
    text: str


def journal_line(kind: type[Any], values: Mapping[str, Any]) -> Any:  # noqa: ANN401 - one of the kinds above
    """Return a line of the journal. Raises TypeError for values that none was written with: it is damaged."""
    for field in fields(kind):
        value = values.get(field.name)
        if (
            field.name in values
            and isinstance(field.type, type | UnionType)
            and not isinstance(value, field.type)
        ):
            raise TypeError(f"{kind.__name__.lower()}: {field.name} is {value!r}")
    return kind(**values)


def attempt_row(session: int, generation: int, entry: dict[str, Any]) -> tuple[Any, ...]:
    """Return the pool's journal entry as a row of the table."""
    return (
        session,
        generation,
        entry["mode"],
        entry["candidate"],
        entry["candidates"],
        entry["episode"],
        entry["episodes"],
        entry["server"],
        entry["attempt"],
        entry.get("steps"),
        entry["started"],
        entry["seconds"],
        entry.get("error"),
        entry.get("stack"),
    )
