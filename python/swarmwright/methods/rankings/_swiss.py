"""Swiss tournaments: who has won as often as another meets them."""

from collections import Counter
from collections.abc import Callable, Generator

import numpy as np

from swarmwright.methods.rankings._matching import improve_matching
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


class Swiss(Pairing):
    """Candidates with the same points meet.

    The first round is drawn at random. From then on candidates are ordered by their points, then by the sum
    of their opponents' points (Buchholz's score), then by the draw; each, from the best on, meets the next
    that it has not met. Where that leaves candidates at the end who have all met, earlier pairs are changed.
    Candidates meet twice only if there is no other way.

    Of an odd number, the lowest of those with the fewest byes has a bye, which counts as a win for the order
    of the rounds to come. Who has played the first side less often plays it.

    By default, as many rounds as a knock-out tournament: the binary logarithm of the candidates, rounded up.
    """

    def most_matches(self, candidates: int, options: PairingOptions) -> int:
        """Return the number of rounds."""
        return _count_rounds(candidates, options)

    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:
        """Pair by points."""
        if candidates < 2:
            return
        table = _Table(random.permutation(candidates).tolist(), options)
        for _ in range(_count_rounds(candidates, options)):
            pairs = table.pair()
            table.record(pairs, (yield as_pairs(pairs)))


class MultiSwiss(Pairing):
    """Several Swiss tournaments with draws of their own, side by side.

    Their matches give more even scores than one tournament with as many rounds, since early opponents, whom
    chance decides, differ.
    """

    def most_matches(self, candidates: int, options: PairingOptions) -> int:
        """Return the rounds of all tournaments together."""
        return options.sessions * _count_rounds(candidates, options)

    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:
        """Pair in all tournaments at once: round r has the matches of round r of each."""
        swiss = Swiss()
        draws = [swiss.rounds(candidates, options, random) for _ in range(options.sessions)]
        yield from play_side_by_side(draws)


def play_side_by_side(tournaments: list[Rounds]) -> Generator[Pairs, Results, None]:
    """Join tournaments with the same number of rounds, round by round."""
    rounds = [pairs for tournament in tournaments if (pairs := next(tournament, None)) is not None]
    while rounds:
        results = yield np.concatenate(rounds)
        ends = np.cumsum([len(pairs) for pairs in rounds])[:-1]
        rounds = [
            pairs
            for tournament, part in zip(tournaments, np.split(results, ends), strict=True)
            if (pairs := _send(tournament, part)) is not None
        ]


def _send(tournament: Rounds, results: Results) -> Pairs | None:
    """Return the next matches, or None after the last round."""
    try:
        return tournament.send(results)
    except StopIteration:
        return None


def _count_rounds(candidates: int, options: PairingOptions) -> int:
    if candidates < 2:
        return 0
    return count_swiss_rounds(candidates) if options.rounds is None else options.rounds


class _Table:
    """Points, opponents, sides and byes of a tournament so far.

    Args:
        draw: all candidates, in the order of the draw.
        options: points.
    """

    def __init__(self, draw: list[int], options: PairingOptions) -> None:
        self._options = options
        self._draw = draw
        self._points = [0.0] * len(draw)
        self._opponents: list[list[int]] = [[] for _ in draw]
        self._byes = [0] * len(draw)
        self._firsts = [0] * len(draw)
        self._meetings: Counter[tuple[int, int]] = Counter()

    def pair(self) -> list[tuple[int, int]]:
        """Return the next round, and give a bye to one candidate of an odd number."""
        points = self._points
        buchholz = [sum(points[other] for other in others) for others in self._opponents]
        standing = sorted(self._draw, key=lambda candidate: (-points[candidate], -buchholz[candidate]))
        if len(standing) % 2:
            fewest = min(self._byes)
            lowest = next(candidate for candidate in reversed(standing) if self._byes[candidate] == fewest)
            standing.remove(lowest)
            self._byes[lowest] += 1
            self._points[lowest] += self._options.win
        return [self._choose_sides(*pair) for pair in self._match(standing)]

    def record(self, pairs: list[tuple[int, int]], results: Results) -> None:
        """Add a round."""
        points = np.nan_to_num(points_of(results, self._options.win, self._options.draw)).tolist()
        for (first, second), (first_points, second_points) in zip(pairs, points, strict=True):
            self._points[first] += first_points
            self._points[second] += second_points
            self._opponents[first].append(second)
            self._opponents[second].append(first)
            self._firsts[first] += 1
            self._meetings[min(first, second), max(first, second)] += 1

    def _match(self, standing: list[int]) -> list[tuple[int, int]]:
        """Pair neighbours in the standing that have met least often."""
        partners = [-1] * len(standing)
        most = 0
        while True:

            def may_meet(first: int, other: int, most: int = most) -> bool:
                return self._count_meetings(standing[first], standing[other]) <= most

            if most == 0:
                _pair_neighbours(partners, may_meet)
            improve_matching(partners, may_meet)
            if -1 not in partners:
                break
            most += 1
        return [(standing[index], standing[other]) for index, other in enumerate(partners) if index < other]

    def _count_meetings(self, first: int, second: int) -> int:
        return self._meetings[min(first, second), max(first, second)]

    def _choose_sides(self, better: int, worse: int) -> tuple[int, int]:
        if self._firsts[worse] < self._firsts[better]:
            return worse, better
        return better, worse


def _pair_neighbours(partners: list[int], may_meet: Callable[[int, int], bool]) -> None:
    """Pair each, from the best on, with the next that it may meet."""
    for index in range(len(partners)):
        if partners[index] < 0:
            for other in range(index + 1, len(partners)):
                if partners[other] < 0 and may_meet(index, other):
                    partners[index], partners[other] = other, index
                    break
