"""The pairings of FREVO's rankings, where they differ from what is usual."""

from collections.abc import Sequence

import numpy as np

from swarmwright.methods.rankings._pairing import (
    Pairing,
    PairingOptions,
    Pairs,
    Results,
    Rounds,
    as_pairs,
    count_swiss_rounds,
    points_of,
)
from swarmwright.methods.rankings.match_scores import score_matches


class FrevoFullTournament(Pairing):
    """FREVO's FullTournament: a round robin in which the first of two always plays the first side."""

    def most_matches(self, candidates: int, options: PairingOptions) -> int:  # noqa: ARG002
        """Return the number of other candidates."""
        return candidates - 1

    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:  # noqa: ARG002
        """All matches in a round."""
        if candidates > 1:
            yield np.column_stack(np.triu_indices(candidates, 1)).astype(np.intp)


class FrevoSwissSystem(Pairing):
    """FREVO's SwissSystem, which knows no chance.

    In the first round the first meets the last, the second the last but one, and so on. From then on, groups
    with the same points are gone through from the best on; in a group, after those left over from better
    ones, the first in the order of the population meets the next that it has not met. Who is left over at the
    end may have no match. Of an odd number, the one in the middle has the first bye, and in each later round
    the best that has had none; byes bring no points.
    """

    def most_matches(self, candidates: int, options: PairingOptions) -> int:
        """Return the number of rounds."""
        return _count_rounds(candidates, options)

    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:  # noqa: ARG002
        """Pair by points."""
        points = np.zeros(candidates)
        meetings: set[frozenset[int]] = set()
        had_bye: set[int] = set()
        for number in range(_count_rounds(candidates, options)):
            if number:
                pairs = _pair_groups(points.tolist(), meetings, had_bye)
            else:
                pairs = [(index, candidates - 1 - index) for index in range(candidates // 2)]
                had_bye |= {candidates // 2} if candidates % 2 else set()
            pairs.reverse()  # FREVO plays the last first
            if not pairs:
                continue
            results = yield as_pairs(pairs)
            np.add.at(points, as_pairs(pairs), np.nan_to_num(points_of(results, options.win, options.draw)))
            meetings |= {frozenset(pair) for pair in pairs}


class FrevoMultiSwiss(Pairing):
    """FREVO's MultiSwiss, which knows no chance.

    Neighbours in the standing meet, whether or not they have met before. The standing is that of the scores
    `frevo_multi_swiss`, and at the beginning the order of the population. Of an even number, the last two
    have no match.
    """

    def most_matches(self, candidates: int, options: PairingOptions) -> int:
        """Return the number of rounds."""
        return _count_rounds(candidates, options)

    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:  # noqa: ARG002
        """Pair neighbours."""
        standing = list(range(candidates))
        count = 2 * ((candidates - 1) // 2)
        rounds: list[tuple[Pairs, Results]] = []
        for _ in range(_count_rounds(candidates, options) if count else 0):
            pairs = as_pairs(list(zip(standing[:count:2], standing[1:count:2], strict=True)))
            rounds.append((pairs, (yield pairs)))
            scores = score_matches(
                "frevo_multi_swiss", candidates, *map(np.concatenate, zip(*rounds, strict=True))
            )
            standing.sort(key=scores.__getitem__, reverse=True)


def _pair_groups(
    points: Sequence[float], meetings: set[frozenset[int]], had_bye: set[int]
) -> list[tuple[int, int]]:
    """Return the pairs of a later round; add its bye to `had_bye`."""
    pairs: list[tuple[int, int]] = []
    needs_bye = len(points) % 2 == 1
    over: list[int] = []
    for level in sorted(set(points), reverse=True):
        group = over + [candidate for candidate, own in enumerate(points) if own == level]
        over = []
        while group:
            if needs_bye and group[0] not in had_bye:
                had_bye.add(group.pop(0))
                needs_bye = False
                continue
            first = group.pop(0)
            second, needs_bye = _choose_opponent(first, group, meetings, had_bye, needs_bye=needs_bye)
            if second is None:
                over.append(first)
            else:
                pairs.append((first, second))
    while over:
        first = over.pop(0)
        second, _ = _choose_opponent(first, over, meetings, had_bye, needs_bye=False)
        if second is not None:
            pairs.append((first, second))
    return pairs


def _choose_opponent(
    first: int, group: list[int], meetings: set[frozenset[int]], had_bye: set[int], *, needs_bye: bool
) -> tuple[int | None, bool]:
    """Remove the next that `first` has not met from the group; whoever is passed over may get the bye."""
    for candidate in list(group):
        if needs_bye and candidate not in had_bye:
            had_bye.add(candidate)
            group.remove(candidate)
            needs_bye = False
        elif frozenset((first, candidate)) not in meetings:
            group.remove(candidate)
            return candidate, needs_bye
    return None, needs_bye


def _count_rounds(candidates: int, options: PairingOptions) -> int:
    return count_swiss_rounds(candidates) if options.rounds is None else options.rounds
