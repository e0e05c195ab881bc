"""Iterated racing, as in irace."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.random_numbers import Stream, Streams
from swarmwright.common.statistics import mean
from swarmwright.controllers import Representation
from swarmwright.methods._base import NO_LIMIT, Incumbent, Method, MethodOptions
from swarmwright.methods.rankings.race import Test, ranks_of, survivors


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
            missing = [entrant for entrant in self.alive if self.instance not in entrant.scores]
            if missing:
                over = len(missing) > left or (self._all_seen() and self._is_over(len(missing)))
                return None if over else missing
            self._pass(missing)
        return None

    def _all_seen(self) -> bool:
        """Return whether every instance of former races has been seen by any of those left."""
        seen: set[int] = set()
        for entrant in self.alive:
            seen.update(entrant.scores)
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
        self.alive = [entrant for entrant in self.alive if entrant not in failed]
        for one in failed:
            self._protected.pop(one, None)
        self._pass(missing)
        self._test()

    def _pass(self, missing: Sequence[Entrant]) -> None:
        """Go on to the next instance."""
        evaluated = set(missing)
        for entrant in [entrant for entrant in self._protected if entrant not in evaluated]:
            self._protected[entrant] -= 1
            if not self._protected[entrant]:
                del self._protected[entrant]
        self._place += 1

    def _test(self) -> None:
        rules, before = self._rules, len(self.alive)
        if self._place < rules.first_test or self._place % rules.each_test:
            return
        if before > 1:
            instances = [self._at(place) for place in range(self._place)]
            scores = np.array([[entrant.scores[number] for entrant in self.alive] for number in instances])
            good = survivors(scores, rules.test, rules.level).tolist()
            kept = zip(self.alive, good, strict=True)
            self.alive = [survivor for survivor, stays in kept if stays or survivor in self._protected]
        if not self._protected and self._place > rules.first_test:
            self._quiet = self._quiet + 1 if len(self.alive) == before else 0

    def ranked(self) -> list[Entrant]:
        """Return those left, the best first.

        One that was evaluated on more instances is better; of equally many the one with the smaller sum of
        ranks on their common instances, or with the better mean where a t-test decides.
        """
        found: list[Entrant] = []
        for count in sorted({len(entrant.scores) for entrant in self.alive}, reverse=True):
            found += self._in_order([entrant for entrant in self.alive if len(entrant.scores) == count])
        return found

    def best(self) -> Entrant | None:
        """Return the first of `ranked`; None when none is left."""
        most = max((len(entrant.scores) for entrant in self.alive), default=0)
        found = self._in_order([entrant for entrant in self.alive if len(entrant.scores) == most])
        return found[0] if found else None

    def _in_order(self, entrants: list[Entrant]) -> list[Entrant]:
        common = set.intersection(*(set(entrant.scores) for entrant in entrants)) if entrants else set()
        if not common or len(entrants) == 1:
            return entrants
        scores = np.array([[entrant.scores[number] for entrant in entrants] for number in sorted(common)])
        if self._rules.test == "friedman":
            badness = ranks_of(scores).sum(axis=0)
        else:
            badness = -np.array([entrant.mean for entrant in entrants])
        return [entrants[index] for index in np.argsort(badness, kind="stable").tolist()]


_SAME_SHARE = 1e-4
"""Two candidates are practically the same when no number of theirs differs by more of its range."""
_LARGEST_COPY_RATE = 0.2
"""How often a candidate of choices alone may equal its parent, at most."""


class RacingOptions(MethodOptions):
    """Iterated racing with irace's defaults. An instance is a seed, or ranking.episodes of them."""

    kind: Literal["racing"] = "racing"
    generations: int = Field(default=NO_LIMIT, ge=1, le=NO_LIMIT)
    """Instances on which candidates are evaluated, one in each generation. Default: no limit."""
    evaluations: int = Field(default=10_000, ge=1, le=10**15)
    """Evaluations, each of a candidate on an instance. They are spread over the races, so a run cannot be
    prolonged. If not even one race fits in, the error message names the smallest number with which one
    does."""
    races: int | None = Field(default=None, ge=1, le=10_000)
    """Races over which the evaluations are spread. What is left then is used for more of them. Default: the
    whole part of 2 + log2(genes)."""
    candidates: int = Field(default=1024, ge=2, le=100_000)
    """Candidates that a race begins with, at most."""
    survivors: int | None = Field(default=None, ge=1, le=10_000)
    """A race ends when this many candidates are left. As many of the best are the elites, which take part in
    the next race and have candidates sampled around them. Default: the whole part of 2 + log2(genes)."""
    first_test: int = Field(default=5, ge=2, le=100_000)
    """Instances before the first test of a race."""
    each_test: int = Field(default=1, ge=1, le=100_000)
    """Instances between two tests."""
    test: Test = "friedman"
    """friedman: Friedman's test and Conover's comparisons with the best, by ranks. t, t_holm, t_bonferroni:
    paired t-tests with the best mean, without or with a correction for their number; for fitness whose sums
    count more than its order."""
    level: float = Field(default=0.05, gt=0, lt=1)
    """Significance level of each test."""
    new_instances: int = Field(default=1, ge=0, le=100_000)
    """Unseen instances with which a race begins, before those of former races."""
    patience: int = Field(default=2, ge=0, le=100_000)
    """Tests in a row that drop no candidate after which a race ends; counted when it has come through the
    instances of former races. 0: any number."""
    soft_restart: bool = True
    """Whether sampling becomes wider again where candidates are practically the same."""


class Racing(Method):
    """Races over instances, and sampling around the elites that survive them.

    A generation is an instance, with seeds of its own, whatever `ranking.seeds` says. All candidates of a
    race that are left and have not been evaluated on it are. From `first_test` instances on, those that are
    significantly worse than the best are dropped. What survives is an elite. The next race has the elites and
    new candidates, and begins with an unseen instance; then come those of former races, in random order,
    where the elites need not be evaluated again, and none is dropped before it was compared on all of them.

    A new candidate is sampled around an elite, which is drawn with a probability that falls linearly with its
    rank. Numbers are drawn from a normal distribution within their bounds, whose deviation is half of the
    initial range at first and is multiplied by (1 / n) ** (1 / genes) before each race with n new candidates.
    Choices are drawn anew with a probability that is 1 at first and multiplied by 1 - (j - 1) / races before
    race j. How a representation applies both: its `perturbations`. Where two candidates of a race are
    practically the same, their parents' distributions become wider, about as they were two races before, and
    all new candidates are sampled anew.

    What is left when no race fits any more is used for unseen instances, on which all elites are evaluated.

    A candidate's recorded fitness is the mean of its scores on all instances so far. The best one is that
    with the most instances; of equals, that with the smallest sum of ranks.

    Source: López-Ibáñez, Dubois-Lacoste, Pérez Cáceres, Birattari and Stützle, "The irace package: iterated
    racing for automatic algorithm configuration", Operations Research Perspectives 3, 2016. Differences: the
    first candidates are random ones of the representation and not a Sobol sequence; a choice keeps no
    probabilities of former ancestors; where a race's share of the budget is too small for one, it may have
    all that is left; and the elites get the rest.
    """

    kind: ClassVar[str] = "racing"
    options_model = RacingOptions
    options: RacingOptions
    start_as = "members"
    by_instance = True
    spreads_evaluations = True
    generational_because = "it tests candidates together"

    def __init__(self, options: RacingOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._races = self._planned_races(options, representation)
        self._rules = _rules(options, representation)
        self._number = 0  # of the race, from 1
        self._elites: list[Entrant] = []
        self._unseen = 0
        self._widened = 0
        self._race: Race | None = None
        self._is_last = False  # whether no race follows
        self._missing: list[Entrant] | None = None
        self._means: Fitness = np.empty(0)

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:
        """Return which options are invalid for this representation: option -> reason."""
        found = super().problems(options, representation)
        if representation is None or found or not isinstance(options, RacingOptions):
            return found
        rules = _rules(options, representation)
        least = (rules.survivors + 1) * (rules.first_test + rules.each_test)
        if options.evaluations < least:
            found["evaluations"] = (
                f"{options.evaluations} are too few for a race: one of {rules.survivors + 1} candidates, of "
                f"which {rules.survivors} survive, on {rules.first_test + rules.each_test} instances takes "
                f"{least}; take as many, or smaller survivors or first_test"
            )
        elif options.candidates <= rules.survivors:
            found["candidates"] = (
                f"{options.candidates} are too few for a race that ends when {rules.survivors} are left; "
                "take more, or smaller survivors"
            )
        return found

    @classmethod
    def no_start(cls, options: MethodOptions, count: int) -> str | None:
        """Return why it cannot start from so many controllers; None if it can."""
        most = options.candidates if isinstance(options, RacingOptions) else count
        if count > most:
            return f"{count} controllers are more than the {most} candidates of a race"
        return super().no_start(options, count)

    @classmethod
    def first_generation(cls, options: MethodOptions, representation: Representation | None) -> int | None:
        """Return how many candidates the first race begins with."""
        if representation is None or not isinstance(options, RacingOptions):
            return super().first_generation(options, representation)
        race = cls(options, representation, seed=0)
        size = race._next_size(1, options.evaluations)
        return None if size is None else size[1]

    @staticmethod
    def _planned_races(options: RacingOptions, representation: Representation) -> int:
        """Return over how many races the budget is spread: fewer where each would have too little."""
        rules = _rules(options, representation)
        races = options.races or _logarithm(representation)
        while races > 1:
            if options.evaluations // races // (rules.first_test + rules.each_test) > rules.survivors:
                break
            races -= 1
        return races

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run, at most."""
        return self.options.evaluations

    @property
    def population_fitness(self) -> Fitness:
        """Mean scores of the candidates that are left in the race; NaN when none is."""
        alive = [] if self._race is None else self._race.alive
        return np.array([entrant.mean for entrant in alive]) if alive else np.full(1, np.nan)

    @property
    def instance(self) -> int:
        """Number of the instance that candidates are asked for, or were last."""
        return 0 if self._race is None else self._race.instance

    @property
    def contenders(self) -> int:
        """Candidates that are left in the race."""
        return 0 if self._race is None else len(self._race.alive)

    @property
    def told_means(self) -> Fitness:
        """Mean scores of the candidates told last, in their order; NaN of those that failed."""
        return self._means

    @property
    def incumbent(self) -> Incumbent | None:
        """The best candidate."""
        best = None if self._race is None else self._race.best()
        return None if best is None else Incumbent(best.evaluation, best.mean)

    @property
    def race(self) -> int:
        """Number of the race, from 1; 0 before the first."""
        return self._number

    @property
    def widened(self) -> int:
        """How often sampling became wider again."""
        return self._widened

    def _ask(self) -> Genomes:
        if self._race is None:
            self._go_on(0)
        assert self._missing is not None, "a race that is asked for has candidates to evaluate"
        return np.array([entrant.genome for entrant in self._missing], dtype=np.float32)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:  # noqa: ARG002 - the race knows them
        assert self._race is not None
        assert self._missing is not None
        told = self._missing
        for row, entrant in enumerate(told):
            entrant.evaluation = self.evaluations + row
        self._race.tell(told, fitness)
        means = [entrant.mean for entrant in told]
        self._means = np.where(np.isfinite(fitness), means, np.nan)

    def passed(self, values: Fitness) -> None:
        """Count an instance, and go on to the next one."""
        super().passed(values)
        if not self.done:
            self._go_on(self.evaluations)
            self.done = self._missing is None

    def _reaches(self, values: Fitness, target: float) -> bool:  # noqa: ARG002 - one instance says little
        best = None if self._race is None else self._race.best()
        return best is not None and len(best.scores) >= self.options.first_test and best.mean >= target

    def _go_on(self, used: int) -> None:
        """Find who is to be evaluated next, in this race or in the next one; none when the budget is used."""
        left = self.options.evaluations - used
        self._missing = None
        while self._missing is None:
            if self._race is not None:
                self._missing = self._race.missing(left)
            if self._missing is None and (self._is_last or not self._begin_race(left)):
                return

    def _begin_race(self, left: int) -> bool:
        """Begin the next race; return whether there is one."""
        if self._race is not None:
            self._elites = self._race.ranked()[: self._rules.survivors]
            for elite in self._elites:
                elite.parent = None
            self._unseen = self._race.unseen
        number = self._number + 1
        self._races = max(self._races, number)
        found = self._next_size(number, left)
        if found is None:
            return self._use_rest(left)
        budget, count, new_instances = found
        self._number = number
        entrants = [*self._elites, *self._new(count - len(self._elites))]
        fresh = range(self._unseen, self._unseen + new_instances)
        old = sorted({instance for elite in self._elites for instance in elite.scores})
        order = Stream(self.seed, "racing.order", number)
        for last in range(len(old) - 1, 0, -1):
            other = order.integer(last + 1)
            old[last], old[other] = old[other], old[last]
        unseen = self._unseen + new_instances
        self._race = Race(entrants, [*fresh, *old], unseen, budget, self._rules)
        return True

    def _use_rest(self, left: int) -> bool:
        """Evaluate the elites on unseen instances, without tests; return whether one fits."""
        self._is_last = True
        if not 0 < len(self._elites) <= left:
            return False
        untested = replace(self._rules, survivors=0, patience=0, first_test=left + 1)
        self._race = Race(self._elites, [], self._unseen, left, untested)
        return True

    def _next_size(self, number: int, left: int) -> tuple[int, int, int] | None:
        """Return the size of a race with its share of the evaluations left, or else with all; see `_size`."""
        return self._size(number, left // (self._races - number + 1)) or self._size(number, left)

    def _size(self, number: int, budget: int) -> tuple[int, int, int] | None:
        """Return evaluations, candidates and new instances of a race; None where too few would race."""
        rules, elites = self._rules, len(self._elites)
        seen = len({instance for elite in self._elites for instance in elite.scores})
        new = self.options.new_instances if elites else 0
        # With less than enough: no new instance, then as short as a race can be.
        for first, growth, unseen in (
            (rules.first_test, min(5, number), new),
            (rules.first_test, min(5, number), 0),
            (1, 1, 0),
        ):
            length = max(first + rules.each_test * growth, _multiple(seen + unseen, rules.each_test))
            count = min((budget + elites * seen) // length, self.options.candidates)
            if count > rules.survivors and count > elites:
                needed = (count - elites) * rules.first_test + elites * min(unseen, rules.first_test)
                return (budget, count, unseen) if needed <= budget else None
        return None

    def _new(self, count: int) -> list[Entrant]:
        """Return new candidates: random ones, or around the elites."""
        if not self._elites:
            if self._number == 1:
                genomes = self.initials(range(count))
            else:  # all have failed
                genomes = self.representation.initials(self._streams("racing.initial", count))
            return [Entrant(genome) for genome in genomes]
        genes = self.representation.genome_size
        for elite in self._elites:
            elite.spread *= (1 / count) ** (1 / genes)
            elite.fresh = max(
                elite.fresh * (1 - (self._number - 1) / self._races), 1 - _LARGEST_COPY_RATE ** (1 / genes)
            )
        new = self._sampled("racing.sample", count)
        if self.options.soft_restart and self._widen(new):
            new = self._sampled("racing.again", count)
        return new

    def _streams(self, purpose: str, count: int) -> Streams:
        return Streams(self.seed, purpose, self._number, range(count))

    def _sampled(self, purpose: str, count: int) -> list[Entrant]:
        """Return candidates around the elites, better ones more often."""
        elites, streams = self._elites, self._streams(purpose, count)
        bounds = np.cumsum(np.arange(len(elites), 0, -1))
        drawn = streams.integers(int(bounds[-1]), 1)[:, 0]
        parents = [elites[index] for index in np.searchsorted(bounds, drawn, side="right").tolist()]
        genomes = self.representation.perturbations(
            np.array([entrant.genome for entrant in parents], dtype=np.float32),
            streams,
            spread=np.array([entrant.spread for entrant in parents]),
            fresh=np.array([entrant.fresh for entrant in parents]),
        )
        pairs = zip(genomes, parents, strict=True)
        return [Entrant(genome, parent.spread, parent.fresh, parent=parent) for genome, parent in pairs]

    def _widen(self, new: list[Entrant]) -> bool:
        """Sample wider around elites whose descendants, or that themselves, are practically the same."""
        entrants = [*self._elites, *new]
        rows = self.representation.likeness(
            np.array([entrant.genome for entrant in entrants], dtype=np.float32)
        )
        same = alike(rows)
        if not len(same):
            return False
        genes, count = self.representation.genome_size, len(new)
        chosen = {entrants[index].parent or entrants[index] for index in same.tolist()}
        for parent in chosen:
            parent.spread = min(parent.spread * count ** (2 / genes), (1 / count) ** (1 / genes))
            parent.fresh = 0.9 * parent.fresh + 0.1
        self._widened += 1
        return True


def alike(rows: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return which rows are practically the same as another one, (n, numbers) in units of their ranges."""
    if len(rows) < 2 or not rows.shape[1]:
        return np.empty(0, dtype=np.intp)
    # Rows that are alike have sums that are near each other. accumulate adds in order, sum() as it likes.
    sums = np.add.accumulate(rows, axis=1)[:, -1]
    order = np.argsort(sums, kind="stable")
    reach = _SAME_SHARE * rows.shape[1] * (1 + 1e-9)
    found: set[int] = set()
    ends = np.searchsorted(sums[order], sums[order] + reach, side="right")
    for place, end in enumerate(ends.tolist()):
        others = order[place + 1 : end]
        near = others[(np.abs(rows[others] - rows[order[place]]) <= _SAME_SHARE).all(axis=1)]
        if len(near):
            found.update([int(order[place]), *near.tolist()])
    return np.array(sorted(found), dtype=np.intp)


def _rules(options: RacingOptions, representation: Representation) -> Rules:
    return Rules(
        test=options.test,
        level=options.level,
        first_test=options.first_test,
        each_test=options.each_test,
        patience=options.patience,
        survivors=options.survivors or _logarithm(representation),
    )


def _logarithm(representation: Representation) -> int:
    """Return the whole part of 2 + log2(genes)."""
    return 2 + math.frexp(representation.genome_size)[1] - 1


def _multiple(value: int, of: int) -> int:
    """Return the next multiple that is not smaller."""
    return -(-value // of) * of
