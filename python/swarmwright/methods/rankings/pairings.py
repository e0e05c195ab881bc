"""Pairings of tournaments: who meets whom."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from swarmwright.methods.rankings._frevo_pairings import (
    FrevoFullTournament,
    FrevoMultiSwiss,
    FrevoSwissSystem,
)
from swarmwright.methods.rankings._merging import MergeSort
from swarmwright.methods.rankings._pairing import Pairing, PairingOptions, Pairs, Results, Rounds, as_pairs
from swarmwright.methods.rankings._swiss import MultiSwiss, Swiss

__all__ = ["PAIRINGS", "Pairing", "PairingOptions", "Pairs", "Results", "Rounds"]

DEFAULT_ROUNDS: Final = 10
"""Matches of a candidate where a pairing has no number by itself; FREVO's MultiSort has as many."""


class RoundRobin(Pairing):
    """Everybody meets everybody, or as many others as `rounds` says.

    Pairs are those of the circle method, by which each candidate meets another in every round, all but one if
    their number is odd. No round depends on the results of another, so all are played at once. With more
    rounds than there are others, candidates meet again with exchanged sides. A candidate plays the first side
    in about half of its matches.
    """

    def most_matches(self, candidates: int, options: PairingOptions) -> int:
        """Return the number of rounds."""
        return _count_circle_rounds(candidates) if options.rounds is None else options.rounds

    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:  # noqa: ARG002
        """All matches at once."""
        if candidates < 2:
            return
        circle = _count_circle_rounds(candidates)  # odd; of an odd number, who meets `circle` has a bye
        places = np.arange(1, (circle + 1) // 2)
        pairs = []
        for number in range(self.most_matches(candidates, options)):
            firsts = np.concatenate([[number % circle], (number + places) % circle])
            seconds = np.concatenate([[circle], (number - places) % circle])
            exchanged = (firsts > seconds) ^ ((firsts + seconds) % 2 == 0) ^ bool(number // circle % 2)
            matches = np.column_stack([firsts, seconds])
            matches[exchanged] = matches[exchanged, ::-1]
            pairs.append(matches[(matches < candidates).all(axis=1)])
        yield np.concatenate(pairs).astype(np.intp)


class Random(Pairing):
    """Each candidate meets as many others as there are rounds, drawn anew for each round.

    Two can meet several times. Of an odd number, one has a bye in each round. All rounds are played at once.
    FREVO's MultiSort does this for two players, and adds up their fitness.
    """

    def most_matches(self, candidates: int, options: PairingOptions) -> int:  # noqa: ARG002
        """Return the number of rounds."""
        return _count_rounds(options)

    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:
        """All matches at once."""
        if candidates > 1:
            yield as_pairs(_draw_rounds(candidates, _count_rounds(options), random))


def _count_rounds(options: PairingOptions) -> int:
    return DEFAULT_ROUNDS if options.rounds is None else options.rounds


def _count_circle_rounds(candidates: int) -> int:
    """Return the number of rounds in which all meet."""
    return candidates - 1 + candidates % 2


def _draw_rounds(candidates: int, rounds: int, random: np.random.Generator) -> list[tuple[int, int]]:
    """Draw perfect matchings, as FREVO does: who is drawn next meets who is drawn after that."""
    pairs: list[tuple[int, int]] = []
    if candidates < 2:
        return pairs
    for _ in range(rounds):
        draws = random.integers(np.arange(candidates, 0, -1)).tolist()
        rest = list(range(candidates))
        order = [rest.pop(draw) for draw in draws]
        pairs += zip(order[::2], order[1::2], strict=False)
    return pairs


PAIRINGS: Mapping[str, Pairing] = {
    "round_robin": RoundRobin(),
    "swiss": Swiss(),
    "multi_swiss": MultiSwiss(),
    "merge_sort": MergeSort(),
    "random": Random(),
    "frevo_full_tournament": FrevoFullTournament(),
    "frevo_swiss_system": FrevoSwissSystem(),
    "frevo_multi_swiss": FrevoMultiSwiss(),
}
"""Pairings of candidates with each other; `hall_of_fame` and `best` have opponents of earlier generations."""
