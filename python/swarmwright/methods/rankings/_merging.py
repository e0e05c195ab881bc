"""A merge sort whose comparisons are matches."""

from dataclasses import dataclass, field

import numpy as np

from swarmwright.methods.rankings._pairing import Pairing, PairingOptions, Rounds, as_pairs


class MergeSort(Pairing):
    """Candidates are sorted by a merge sort, in which a match says who comes first.

    The order at the beginning is random. All merges are under way at once, on all levels: each plays one
    match a round as soon as it knows the next of both of its parts, so that n candidates take about n +
    log2(n) rounds and at most n * log2(n) matches, those of a merge sort. Late rounds have few matches: on
    many processors, a Swiss tournament with as many matches is faster.

    Where a match is a draw or has failed, the part that comes first goes first. Two candidates meet at most
    once. The score `order` is the result of the sort; points are not, since some play more matches than
    others.
    """

    def most_matches(self, candidates: int, options: PairingOptions) -> int:  # noqa: ARG002
        """Return the number of other candidates."""
        return candidates - 1

    def rounds(self, candidates: int, options: PairingOptions, random: np.random.Generator) -> Rounds:  # noqa: ARG002
        """Compare the next candidates of all merges that have them."""
        merges = _plan_merges(random.permutation(candidates).tolist())
        firsts = [0] * candidates
        while True:
            open_merges = [merge for merge in merges if merge.advance()]
            if not open_merges:
                return
            heads = [merge.heads for merge in open_merges]
            turned = [firsts[second] < firsts[first] for first, second in heads]
            pairs = [
                (second, first) if turn else (first, second)
                for (first, second), turn in zip(heads, turned, strict=True)
            ]
            results = yield as_pairs(pairs)
            for first, _ in pairs:
                firsts[first] += 1
            for merge, turn, result in zip(open_merges, turned, results.tolist(), strict=True):
                own, opposing = result[::-1] if turn else result
                merge.take(second=opposing > own and np.isfinite(own) and np.isfinite(opposing))


@dataclass
class _Part:
    """A part of the candidates; `order` has those whose place is certain, from the best on."""

    size: int
    order: list[int] = field(default_factory=list)


@dataclass
class _Merge:
    """Merges two parts, which may be under way themselves."""

    first: _Part
    second: _Part
    into: _Part
    first_place: int = 0
    second_place: int = 0

    @property
    def heads(self) -> tuple[int, int]:
        """The next candidate of each part."""
        return self.first.order[self.first_place], self.second.order[self.second_place]

    def advance(self) -> bool:
        """Move what needs no match; return whether the next candidates of both parts are certain."""
        if self.first_place == self.first.size:
            rest = self.second.order[self.second_place :]
            self.second_place += len(rest)
            self.into.order += rest
            return False
        if self.second_place == self.second.size:
            rest = self.first.order[self.first_place :]
            self.first_place += len(rest)
            self.into.order += rest
            return False
        return self.first_place < len(self.first.order) and self.second_place < len(self.second.order)

    def take(self, *, second: bool) -> None:
        """Move the next candidate of the first or the second part."""
        first_head, second_head = self.heads
        self.into.order.append(second_head if second else first_head)
        if second:
            self.second_place += 1
        else:
            self.first_place += 1


def _plan_merges(draw: list[int]) -> list[_Merge]:
    """Return all merges, parts before what they are merged into."""
    parts = [_Part(1, [candidate]) for candidate in draw]
    merges: list[_Merge] = []
    while len(parts) > 1:
        level = [
            _Merge(first, second, _Part(first.size + second.size))
            for first, second in zip(parts[::2], parts[1::2], strict=False)
        ]
        merges += level
        parts = [merge.into for merge in level] + parts[2 * len(level) :]
    return merges
