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
    """A candidate and its scores."""

    genome: Genome
    spread: float = 1.0
    """Standard deviation of samples around it, relative to the initial one."""
    fresh: float = 1.0
    """Probability that choices are drawn anew in samples around it."""
    scores: dict[int, float] = field(default_factory=dict)
    """Scores by instance."""
    parent: "Entrant | None" = None
    """The elite around which it was sampled; None for initial candidates and elites."""
    evaluation: int = -1
    """Number of its last evaluation in the run."""

    @property
    def mean(self) -> float:
        """Mean score over its instances; NaN before the first."""
        return mean(list(self.scores.values()))


@dataclass(frozen=True)
class Rules:
    """Rules of a race."""

    test: Test
    level: float
    first_test: int
    each_test: int
    patience: int
    """Consecutive tests without drops until a race ends; 0 for no limit."""
    survivors: int
    """A race ends when at most this many candidates remain."""


class Race:
    """A race: `find_missing` returns the candidates to evaluate on `instance`, `tell` takes their scores.

    Elites of former races keep their scores. They are not dropped before the race has passed all instances on
    which they were evaluated, so that they are compared with the others on all of them.

    Args:
        entrants: candidates of the race.
        instances: numbers of the first instances, in order, followed by those from `unseen` on.
        unseen: the lowest number of an unused instance outside `instances`.
        budget: evaluations after which there is no further test.
        rules: rules of the race.
    """

    def __init__(
        self, entrants: Sequence[Entrant], instances: Sequence[int], unseen: int, budget: int, rules: Rules
    ) -> None:
        self._instances = list(instances)
        self._unseen = unseen
        self._budget = budget
        self._make_rules = rules
        self._protected = {entrant: len(entrant.scores) for entrant in entrants if entrant.scores}
        self._quiet = 0  # tests in a row that dropped none
        self._used = 0
        self._position = 0
        self.alive = list(entrants)
        """The remaining candidates, in their order."""

    @property
    def instance(self) -> int:
        """The number of the current instance."""
        return self._get_instance(self._position)

    @property
    def unseen(self) -> int:
        """The lowest number of an instance not yet used."""
        done = [self._get_instance(position) for position in range(self._position)]
        return max([self._unseen, *(number + 1 for number in done)])

    def _get_instance(self, position: int) -> int:
        count = len(self._instances)
        return self._instances[position] if position < count else self._unseen + position - count

    def find_missing(self, remaining: int) -> list[Entrant] | None:
        """Return the candidates to evaluate on `instance`, at least one; None if the race is over.

        left: remaining evaluations of the run.
        """
        while self.alive:
            missing = [entrant for entrant in self.alive if self.instance not in entrant.scores]
            if missing:
                over = len(missing) > remaining or (self._covers_instances() and self._is_over(len(missing)))
                return None if over else missing
            self._pass(missing)
        return None

    def _covers_instances(self) -> bool:
        """Return whether the remaining candidates cover every instance of former races."""
        covered: set[int] = set()
        for entrant in self.alive:
            covered.update(entrant.scores)
            if covered.issuperset(self._instances):
                return True
        return False

    def _is_over(self, missing: int) -> bool:
        rules = self._make_rules
        if len(self.alive) <= rules.survivors:
            return True
        tested = self._position >= rules.first_test and self._position % rules.each_test == 0
        if tested and self._used + missing * rules.each_test > self._budget:
            return True
        return 0 < rules.patience <= self._quiet

    def tell(self, missing: Sequence[Entrant], scores: Fitness) -> None:
        """Accept the scores of the missing candidates, in order; failed ones (NaN) are dropped at once."""
        failed = set()
        for entrant, score in zip(missing, scores.tolist(), strict=True):
            if math.isfinite(score):
                entrant.scores[self.instance] = score
            else:
                failed.add(entrant)
        self._used += len(missing)
        self.alive = [entrant for entrant in self.alive if entrant not in failed]
        for entrant in failed:
            self._protected.pop(entrant, None)
        self._pass(missing)
        self._test()

    def _pass(self, missing: Sequence[Entrant]) -> None:
        """Advance to the next instance."""
        evaluated = set(missing)
        for entrant in [entrant for entrant in self._protected if entrant not in evaluated]:
            self._protected[entrant] -= 1
            if not self._protected[entrant]:
                del self._protected[entrant]
        self._position += 1

    def _test(self) -> None:
        rules, before = self._make_rules, len(self.alive)
        if self._position < rules.first_test or self._position % rules.each_test:
            return
        if before > 1:
            instances = [self._get_instance(position) for position in range(self._position)]
            scores = np.array([[entrant.scores[number] for entrant in self.alive] for number in instances])
            good = survivors(scores, rules.test, rules.level).tolist()
            decisions = zip(self.alive, good, strict=True)
            self.alive = [survivor for survivor, stays in decisions if stays or survivor in self._protected]
        if not self._protected and self._position > rules.first_test:
            self._quiet = self._quiet + 1 if len(self.alive) == before else 0

    def rank(self) -> list[Entrant]:
        """Return the remaining candidates, the best first.

        Candidates are ordered by the number of instances, then by the sum of ranks on common instances, or by
        the mean if a t-test is used.
        """
        ranking: list[Entrant] = []
        for count in sorted({len(entrant.scores) for entrant in self.alive}, reverse=True):
            ranking += self._sort_entrants(
                [entrant for entrant in self.alive if len(entrant.scores) == count]
            )
        return ranking

    def find_best(self) -> Entrant | None:
        """Return the best remaining candidate, or None."""
        most = max((len(entrant.scores) for entrant in self.alive), default=0)
        ranking = self._sort_entrants([entrant for entrant in self.alive if len(entrant.scores) == most])
        return ranking[0] if ranking else None

    def _sort_entrants(self, entrants: list[Entrant]) -> list[Entrant]:
        common = set.intersection(*(set(entrant.scores) for entrant in entrants)) if entrants else set()
        if not common or len(entrants) == 1:
            return entrants
        scores = np.array([[entrant.scores[number] for entrant in entrants] for number in sorted(common)])
        if self._make_rules.test == "friedman":
            badness = ranks_of(scores).sum(axis=0)
        else:
            badness = -np.array([entrant.mean for entrant in entrants])
        return [entrants[index] for index in np.argsort(badness, kind="stable").tolist()]


_SAME_SHARE = 1e-4
"""Candidates are practically equal if no number differs by more than this share of its range."""
_LARGEST_COPY_RATE = 0.2
"""Maximum probability that a candidate with only choices equals its parent."""


class RacingOptions(MethodOptions):
    """Iterated racing with irace's defaults. An instance is a set of ranking.episodes seeds."""

    kind: Literal["racing"] = "racing"
    generations: int = Field(default=NO_LIMIT, ge=1, le=NO_LIMIT)
    """Number of instances, one per generation. Default: no limit."""
    evaluations: int = Field(default=10_000, ge=1, le=10**15)
    """Evaluations of candidates on instances, distributed over the races; a run cannot be prolonged."""
    races: int | None = Field(default=None, ge=1, le=10_000)
    """Races over which the evaluations are distributed; the remainder is used for more races. Default:
    2 + log2(genes), rounded down."""
    candidates: int = Field(default=1024, ge=2, le=100_000)
    """Maximum number of candidates at the start of a race."""
    survivors: int | None = Field(default=None, ge=1, le=10_000)
    """A race ends when this many candidates remain; they are the elites of the next race, around which
    candidates are sampled. Default: 2 + log2(genes), rounded down."""
    first_test: int = Field(default=5, ge=2, le=100_000)
    """Instances before the first test of a race."""
    each_test: int = Field(default=1, ge=1, le=100_000)
    """Instances between two tests."""
    test: Test = "friedman"
    """friedman: Friedman's test and Conover's comparisons with the best, by ranks. t, t_holm, t_bonferroni:
    paired t-tests against the best mean, without or with correction.
    """
    level: float = Field(default=0.05, gt=0, lt=1)
    """Significance level of each test."""
    new_instances: int = Field(default=1, ge=0, le=100_000)
    """Unseen instances at the start of a race, before those of former races."""
    patience: int = Field(default=2, ge=0, le=100_000)
    """Consecutive tests without drops that end a race, counted after the instances of former races; 0 for no
    limit."""
    soft_restart: bool = True
    """Whether to widen the sampling again when candidates are practically equal."""


class Racing(Method):
    """Races over instances, and sampling around the elites that survive them.

    A generation is an instance with its own seeds, regardless of `ranking.seeds`. All remaining candidates of
    a race without a score on it are evaluated. From `first_test` instances on, candidates that are
    significantly worse than the best are dropped; the survivors are the elites. The next race has the elites
    and new candidates. It begins with an unseen instance, followed by those of former races in random order,
    on which elites keep their scores; elites are not dropped before they were compared on all of them.

    A new candidate is sampled around an elite, drawn with a probability that falls linearly with rank.
    Numbers are drawn from a truncated normal distribution, whose deviation starts at half of the initial
    range and is multiplied by (1 / n) ** (1 / genes) before each race with n new candidates. Choices are
    drawn anew with a probability that starts at 1 and is multiplied by 1 - (j - 1) / races before race j. The
    representation's `perturbations` applies both. If two candidates of a race are practically equal, the
    distributions of their parents are widened to about those of two races before, and all new candidates are
    sampled again.

    Evaluations that are too few for another race are spent on unseen instances for all elites.

    A candidate's recorded fitness is the mean of its scores on all instances so far. The best candidate is
    the one with the most instances, then with the smallest sum of ranks.

    Source: López-Ibáñez, Dubois-Lacoste, Pérez Cáceres, Birattari and Stützle, "The irace package: iterated
    racing for automatic algorithm configuration", Operations Research Perspectives 3, 2016. Differences:
    initial candidates are random genomes of the representation, not a Sobol sequence; choices keep no
    probabilities of former ancestors; a race whose share of the budget is too small may use all that remains;
    and the elites get the remainder.
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
        self._races = self._plan_races(options, representation)
        self._make_rules = _make_rules(options, representation)
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
        """Return the options that are invalid for this representation: option -> reason."""
        invalid = super().problems(options, representation)
        if representation is None or invalid or not isinstance(options, RacingOptions):
            return invalid
        rules = _make_rules(options, representation)
        least = (rules.survivors + 1) * (rules.first_test + rules.each_test)
        if options.evaluations < least:
            invalid["evaluations"] = (
                f"{options.evaluations} are too few for a race, which takes at least {least}: "
                f"{rules.survivors + 1} candidates on {rules.first_test + rules.each_test} instances; "
                "increase it, or decrease survivors or first_test"
            )
        elif options.candidates <= rules.survivors:
            invalid["candidates"] = (
                f"{options.candidates} are too few for a race that ends with {rules.survivors}; increase it, "
                "or decrease survivors"
            )
        return invalid

    @classmethod
    def no_start(cls, options: MethodOptions, count: int) -> str | None:
        """Return why the method cannot start from `count` controllers, or None."""
        most = options.candidates if isinstance(options, RacingOptions) else count
        if count > most:
            return f"{count} controllers exceed the {most} candidates of a race"
        return super().no_start(options, count)

    @classmethod
    def first_generation(cls, options: MethodOptions, representation: Representation | None) -> int | None:
        """Return the number of candidates of the first race."""
        if representation is None or not isinstance(options, RacingOptions):
            return super().first_generation(options, representation)
        race = cls(options, representation, seed=0)
        size = race._find_next_size(1, options.evaluations)
        return None if size is None else size[1]

    @staticmethod
    def _plan_races(options: RacingOptions, representation: Representation) -> int:
        """Return the number of races over which the budget is distributed."""
        rules = _make_rules(options, representation)
        races = options.races or _logarithm(representation)
        while races > 1:
            if options.evaluations // races // (rules.first_test + rules.each_test) > rules.survivors:
                break
            races -= 1
        return races

    @property
    def budget(self) -> int:
        """Upper bound of evaluations."""
        return self.options.evaluations

    @property
    def population_fitness(self) -> Fitness:
        """Mean scores of the remaining candidates; NaN without any."""
        alive = [] if self._race is None else self._race.alive
        return np.array([entrant.mean for entrant in alive]) if alive else np.full(1, np.nan)

    @property
    def instance(self) -> int:
        """Number of the current instance."""
        return 0 if self._race is None else self._race.instance

    @property
    def contenders(self) -> int:
        """Number of remaining candidates in the race."""
        return 0 if self._race is None else len(self._race.alive)

    @property
    def instance_means(self) -> Fitness:
        """Mean scores of the candidates of the last `tell`, in order; NaN for failed ones."""
        return self._means

    @property
    def incumbent(self) -> Incumbent | None:
        """The best candidate."""
        best = None if self._race is None else self._race.find_best()
        return None if best is None else Incumbent(best.evaluation, best.mean)

    @property
    def race(self) -> int:
        """Number of the race, from 1; 0 before the first."""
        return self._number

    @property
    def widened(self) -> int:
        """How often sampling was widened."""
        return self._widened

    def _ask(self) -> Genomes:
        if self._race is None:
            self._advance(0)
        assert self._missing is not None, "a race that is asked for has candidates to evaluate"
        return np.array([entrant.genome for entrant in self._missing], dtype=np.float32)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:  # noqa: ARG002 - the race knows them
        assert self._race is not None
        assert self._missing is not None
        entrants = self._missing
        for row, entrant in enumerate(entrants):
            entrant.evaluation = self.evaluations + row
        self._race.tell(entrants, fitness)
        means = [entrant.mean for entrant in entrants]
        self._means = np.where(np.isfinite(fitness), means, np.nan)

    def count_generation(self, values: Fitness) -> None:
        """Count an instance and advance to the next one."""
        super().count_generation(values)
        if not self.done:
            self._advance(self.evaluations)
            self.done = self._missing is None

    def _reaches(self, values: Fitness, target: float) -> bool:  # noqa: ARG002 - one instance says little
        best = None if self._race is None else self._race.find_best()
        return best is not None and len(best.scores) >= self.options.first_test and best.mean >= target

    def _advance(self, used: int) -> None:
        """Find the next candidates to evaluate, in this race or the next; none if the budget is used."""
        remaining = self.options.evaluations - used
        self._missing = None
        while self._missing is None:
            if self._race is not None:
                self._missing = self._race.find_missing(remaining)
            if self._missing is None and (self._is_last or not self._begin_race(remaining)):
                return

    def _begin_race(self, remaining: int) -> bool:
        """Begin the next race; return whether the budget allows one."""
        if self._race is not None:
            self._elites = self._race.rank()[: self._make_rules.survivors]
            for elite in self._elites:
                elite.parent = None
            self._unseen = self._race.unseen
        number = self._number + 1
        self._races = max(self._races, number)
        size = self._find_next_size(number, remaining)
        if size is None:
            return self._use_remainder(remaining)
        budget, count, new_instances = size
        self._number = number
        entrants = [*self._elites, *self._create_entrants(count - len(self._elites))]
        fresh = range(self._unseen, self._unseen + new_instances)
        old = sorted({instance for elite in self._elites for instance in elite.scores})
        order = Stream(self.seed, "racing.order", number)
        for last in range(len(old) - 1, 0, -1):
            partner = order.integer(last + 1)
            old[last], old[partner] = old[partner], old[last]
        unseen = self._unseen + new_instances
        self._race = Race(entrants, [*fresh, *old], unseen, budget, self._make_rules)
        return True

    def _use_remainder(self, remaining: int) -> bool:
        """Evaluate the elites on unseen instances without tests; return whether the budget allows it."""
        self._is_last = True
        if not 0 < len(self._elites) <= remaining:
            return False
        untested = replace(self._make_rules, survivors=0, patience=0, first_test=remaining + 1)
        self._race = Race(self._elites, [], self._unseen, remaining, untested)
        return True

    def _find_next_size(self, number: int, remaining: int) -> tuple[int, int, int] | None:
        """Return the size of a race with its share of the remaining evaluations, else with all of them."""
        return self._find_size(number, remaining // (self._races - number + 1)) or self._find_size(
            number, remaining
        )

    def _find_size(self, number: int, budget: int) -> tuple[int, int, int] | None:
        """Return evaluations, candidates and new instances of a race; None if the budget is too small."""
        rules, elites = self._make_rules, len(self._elites)
        past = len({instance for elite in self._elites for instance in elite.scores})
        new = self.options.new_instances if elites else 0
        # If the budget is short: no new instance, then the shortest possible race.
        for first, growth, unseen in (
            (rules.first_test, min(5, number), new),
            (rules.first_test, min(5, number), 0),
            (1, 1, 0),
        ):
            length = max(first + rules.each_test * growth, _round_up(past + unseen, rules.each_test))
            count = min((budget + elites * past) // length, self.options.candidates)
            if count > rules.survivors and count > elites:
                needed = (count - elites) * rules.first_test + elites * min(unseen, rules.first_test)
                return (budget, count, unseen) if needed <= budget else None
        return None

    def _create_entrants(self, count: int) -> list[Entrant]:
        """Create new candidates, at random or around the elites."""
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
        new = self._sample_entrants("racing.sample", count)
        if self.options.soft_restart and self._widen(new):
            new = self._sample_entrants("racing.again", count)
        return new

    def _streams(self, purpose: str, count: int) -> Streams:
        return Streams(self.seed, purpose, self._number, range(count))

    def _sample_entrants(self, purpose: str, count: int) -> list[Entrant]:
        """Sample candidates around the elites, around better ones more often."""
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
        """Widen the sampling around elites if they or their descendants are practically equal."""
        entrants = [*self._elites, *new]
        rows = self.representation.likeness(
            np.array([entrant.genome for entrant in entrants], dtype=np.float32)
        )
        same = find_near_equals(rows)
        if not len(same):
            return False
        genes, count = self.representation.genome_size, len(new)
        chosen = {entrants[index].parent or entrants[index] for index in same.tolist()}
        for parent in chosen:
            parent.spread = min(parent.spread * count ** (2 / genes), (1 / count) ** (1 / genes))
            parent.fresh = 0.9 * parent.fresh + 0.1
        self._widened += 1
        return True


def find_near_equals(rows: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows that are practically equal to another row, (n, numbers) in units of their ranges."""
    if len(rows) < 2 or not rows.shape[1]:
        return np.empty(0, dtype=np.intp)
    # Equal rows have close sums. Unlike sum(), accumulate adds in a fixed order.
    sums = np.add.accumulate(rows, axis=1)[:, -1]
    order = np.argsort(sums, kind="stable")
    reach = _SAME_SHARE * rows.shape[1] * (1 + 1e-9)
    near_equals: set[int] = set()
    ends = np.searchsorted(sums[order], sums[order] + reach, side="right")
    for position, end in enumerate(ends.tolist()):
        following = order[position + 1 : end]
        equal = following[(np.abs(rows[following] - rows[order[position]]) <= _SAME_SHARE).all(axis=1)]
        if len(equal):
            near_equals.update([int(order[position]), *equal.tolist()])
    return np.array(sorted(near_equals), dtype=np.intp)


def _make_rules(options: RacingOptions, representation: Representation) -> Rules:
    return Rules(
        test=options.test,
        level=options.level,
        first_test=options.first_test,
        each_test=options.each_test,
        patience=options.patience,
        survivors=options.survivors or _logarithm(representation),
    )


def _logarithm(representation: Representation) -> int:
    """Return 2 + log2(genes), rounded down."""
    return 2 + math.frexp(representation.genome_size)[1] - 1


def _round_up(value: int, divisor: int) -> int:
    """Round up to a multiple."""
    return -(-value // divisor) * divisor
