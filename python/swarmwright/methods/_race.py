"""A race: candidates are evaluated on one instance after the other, and those that are worse are dropped."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from swarmwright.common.statistics import mean
from swarmwright.common.typing import Fitness, Genome
from swarmwright.methods.rankings.race_tests import Test, ranks_of, survivors


@dataclass(eq=False)
class Entrant:
    """A candidate, with what is known of it."""

    genome: Genome
    spread: float = 1.0
    """Standard deviation with which numbers are sampled around it, as a share of that at the start."""
    fresh: float = 1.0
    """Probability with which choices are drawn anew in what is sampled around it."""
    scores: dict[int, float] = field(default_factory=dict)
    """By instance."""
    parent: "Entrant | None" = None
    """The elite that it was sampled around; None of the first ones, and of elites."""
    evaluation: int = -1
    """Number of its last evaluation in the whole run."""

    @property
    def mean(self) -> float:
        """Mean score over its instances; NaN before the first."""
        return mean(list(self.scores.values()))


@dataclass(frozen=True)
class Rules:
    """How races are run."""

    test: Test
    level: float
    first_test: int
    each_test: int
    patience: int
    """Tests that drop no candidate after which a race ends; 0: any number."""
    survivors: int
    """A race ends when no more than so many are left."""


class Race:
    """A conversation: `missing` says who is to be evaluated on `instance`, `tell` takes their scores.

    Those that come with scores, the elites of former races, are not evaluated again where they have been; and
    none of them is dropped before the race has come through all the instances that it was evaluated on, so
    that it is compared with the others on all of them.

    Args:
        entrants: those that race.
        instances: numbers of the first instances, in order; after them come those from `unseen` on.
        unseen: the lowest number of an instance that was never used, those in `instances` left out.
        budget: evaluations, after which there is no further test.
        rules: of the race.
    """

    def __init__(
        self, entrants: Sequence[Entrant], instances: Sequence[int], unseen: int, budget: int, rules: Rules
    ) -> None:
        self._instances = list(instances)
        self._unseen = unseen
        self._budget = budget
        self._rules = rules
        self._protected = {entrant: len(entrant.scores) for entrant in entrants if entrant.scores}
        self._quiet = 0  # tests in a row that dropped none
        self._used = 0
        self._place = 0
        self.alive = list(entrants)
        """Those that are left, in their order."""

    @property
    def instance(self) -> int:
        """The number of the instance that the race is at."""
        return self._at(self._place)

    @property
    def unseen(self) -> int:
        """The lowest number of an instance that was not used in this race or before."""
        done = [self._at(place) for place in range(self._place)]
        return max([self._unseen, *(number + 1 for number in done)])

    def _at(self, place: int) -> int:
        listed = len(self._instances)
        return self._instances[place] if place < listed else self._unseen + place - listed

    def missing(self, left: int) -> list[Entrant] | None:
        """Return who is to be evaluated on `instance`, at least one; None when the race is over.

        left: evaluations left of the whole run.
        """
        while self.alive:
            missing = [one for one in self.alive if self.instance not in one.scores]
            if missing:
                over = len(missing) > left or (self._all_seen() and self._is_over(len(missing)))
                return None if over else missing
            self._pass(missing)
        return None

    def _all_seen(self) -> bool:
        """Return whether every instance of former races has been seen by any of those left."""
        seen: set[int] = set()
        for one in self.alive:
            seen.update(one.scores)
            if seen.issuperset(self._instances):
                return True
        return False

    def _is_over(self, missing: int) -> bool:
        rules = self._rules
        if len(self.alive) <= rules.survivors:
            return True
        tested = self._place >= rules.first_test and self._place % rules.each_test == 0
        if tested and self._used + missing * rules.each_test > self._budget:
            return True
        return 0 < rules.patience <= self._quiet

    def tell(self, missing: Sequence[Entrant], scores: Fitness) -> None:
        """Take scores of those that were missing, in order; one that failed (NaN) is dropped at once."""
        failed = set()
        for one, score in zip(missing, scores.tolist(), strict=True):
            if math.isfinite(score):
                one.scores[self.instance] = score
            else:
                failed.add(one)
        self._used += len(missing)
        self.alive = [one for one in self.alive if one not in failed]
        for one in failed:
            self._protected.pop(one, None)
        self._pass(missing)
        self._test()

    def _pass(self, missing: Sequence[Entrant]) -> None:
        """Go on to the next instance."""
        evaluated = set(missing)
        for one in [one for one in self._protected if one not in evaluated]:
            self._protected[one] -= 1
            if not self._protected[one]:
                del self._protected[one]
        self._place += 1

    def _test(self) -> None:
        rules, before = self._rules, len(self.alive)
        if self._place < rules.first_test or self._place % rules.each_test:
            return
        if before > 1:
            instances = [self._at(place) for place in range(self._place)]
            scores = np.array([[one.scores[number] for one in self.alive] for number in instances])
            good = survivors(scores, rules.test, rules.level).tolist()
            kept = zip(self.alive, good, strict=True)
            self.alive = [one for one, stays in kept if stays or one in self._protected]
        if not self._protected and self._place > rules.first_test:
            self._quiet = self._quiet + 1 if len(self.alive) == before else 0

    def ranked(self) -> list[Entrant]:
        """Return those left, the best first.

        One that was evaluated on more instances is better; of equally many the one with the smaller sum of
        ranks on their common instances, or with the better mean where a t-test decides.
        """
        found: list[Entrant] = []
        for count in sorted({len(one.scores) for one in self.alive}, reverse=True):
            found += self._in_order([one for one in self.alive if len(one.scores) == count])
        return found

    def best(self) -> Entrant | None:
        """Return the first of `ranked`; None when none is left."""
        most = max((len(one.scores) for one in self.alive), default=0)
        found = self._in_order([one for one in self.alive if len(one.scores) == most])
        return found[0] if found else None

    def _in_order(self, entrants: list[Entrant]) -> list[Entrant]:
        common = set.intersection(*(set(one.scores) for one in entrants)) if entrants else set()
        if not common or len(entrants) == 1:
            return entrants
        scores = np.array([[one.scores[number] for one in entrants] for number in sorted(common)])
        if self._rules.test == "friedman":
            badness = ranks_of(scores).sum(axis=0)
        else:
            badness = -np.array([one.mean for one in entrants])
        return [entrants[index] for index in np.argsort(badness, kind="stable").tolist()]
