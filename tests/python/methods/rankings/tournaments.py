"""Tournaments whose matches are decided by a function."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from swarmwright.methods.rankings.pairings import PAIRINGS, PairingOptions, Pairs, Results


class Tournament(NamedTuple):
    """What was played."""

    pairs: Pairs
    results: Results
    rounds: list[Pairs]


def play(
    pairing: str,
    candidates: int,
    decide: Callable[[Pairs], Results],
    seed: int = 0,
    /,
    **options: float | None,
) -> Tournament:
    """Play all rounds; `decide` returns the fitness of both of (matches, 2)."""
    rounds: list[Pairs] = []
    results: list[Results] = []
    under_way = PAIRINGS[pairing].rounds(
        candidates,
        PairingOptions(**options),  # type: ignore[arg-type]
        np.random.default_rng(seed),
    )
    try:
        pairs = next(under_way)
        while True:
            rounds.append(pairs)
            results.append(decide(pairs))
            pairs = under_way.send(results[-1])
    except StopIteration:
        pass
    return Tournament(
        np.concatenate([np.empty((0, 2), np.intp), *rounds]),
        np.concatenate([np.empty((0, 2)), *results]),
        rounds,
    )


def decide_by(strengths: Results) -> Callable[[Pairs], Results]:
    """The fitness of each is its strength."""
    return lambda pairs: np.asarray(strengths[pairs], dtype=np.float64)


def decide_by_chance(strengths: Results, random: np.random.Generator) -> Callable[[Pairs], Results]:
    """Players of Bradley and Terry; strengths are logarithms."""

    def decide(pairs: Pairs) -> Results:
        firsts, seconds = strengths[pairs].T
        wins = (random.random(len(pairs)) < 1.0 / (1.0 + np.exp(seconds - firsts))).astype(np.float64)
        return np.column_stack([wins, 1.0 - wins])

    return decide
