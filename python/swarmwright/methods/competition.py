"""Competitions: one or several populations whose candidates meet in matches.

Each population has a method, which proposes its candidates. They meet in rounds of matches, whose results are
their fitness. Survivors compete again, since their earlier results were against other opponents. At the end
of each generation, the champions of all sides meet, and become possible opponents of later generations.

Sources: Rosin and Belew, "New methods for competitive coevolution", Evolutionary Computation 5(1), 1997, for
the hall of fame; Potter and De Jong, "Cooperative coevolution: an architecture for evolving coadapted
subcomponents", Evolutionary Computation 8(1), 2000, for populations with a common fitness, whose partners are
the best or random ones; see `pareto_archive` for its source.
"""

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Fitness, Genome, Genomes
from swarmwright.common.errors import InputError
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers import Representation
from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods.pareto_archive import ParetoArchive
from swarmwright.methods.rankings.match_scores import score_matches
from swarmwright.methods.rankings.pairings import DEFAULT_ROUNDS, PAIRINGS, PairingOptions
from swarmwright.methods.rankings.tournament import AGAINST_CHAMPIONS, ONLY_OPPONENTS, TournamentOptions

Indices = NDArray[np.intp]

FIRST_OPPONENT = -2_000_000_000
"""Index of the first external opponent, below those of all champions; that of opponent k is this - k."""

LARGEST_ARCHIVE = 100
"""Largest number of champions in the archive of `pareto_archive`."""


@dataclass(frozen=True)
class Matches:
    """Matches to play at the same time, and the candidates of each side."""

    candidates: Indices
    """(matches, sides): the candidate's index in its population, survivors after new ones; -1 - k is the
    champion of generation k, FIRST_OPPONENT - k the external opponent k."""
    genomes: Genomes
    """(matches, genome_size): the genomes of all sides, joined."""


Rounds = Generator[Matches, NDArray[np.float64], None]
"""Yields matches; receives the fitness of each side, (matches, sides), NaN where a match failed."""


@dataclass(frozen=True)
class Population:
    """A population of a competition."""

    name: str
    method: Method
    sides: tuple[int, ...]
    """Sides that its candidates play; several only if there is one population."""


class Competition(Method):
    """The method of a competition: the methods of its populations, and their matches.

    Call `matches` in place of `ask`, and `finish` in place of `tell`.

    Args:
        options: the experiment's method, whose limits are those of the run.
        representation: of the joined genomes of all sides.
        populations: the populations; their methods have no limits of their own.
        opponents: genomes of external opponents that play each side, by their number; candidates of other
            sides meet them in every generation. A side without a population is played by them alone.
        sizes: number of genes of each side, in the order of the joined genome.
        tournament: options of the ranking.
        seed: seed of the experiment.
    """

    kind = "competition"

    def __init__(
        self,
        options: MethodOptions,
        representation: Representation,
        *,
        populations: Sequence[Population],
        opponents: Sequence[Mapping[int, Genome]],
        sizes: Sequence[int],
        tournament: TournamentOptions,
        seed: int,
    ) -> None:
        super().__init__(options, representation, seed=seed)
        self.populations = tuple(populations)
        used = (name for population in populations for name in population.method.libraries)
        self.libraries = tuple(dict.fromkeys(used))  # type: ignore[misc] # differs
        self._population_of_side: list[int | None] = [None] * len(sizes)
        for number, population in enumerate(populations):
            for side in population.sides:
                self._population_of_side[side] = number
        self._ends = np.cumsum(sizes).tolist()
        self._starts = [end - size for end, size in zip(self._ends, sizes, strict=True)]
        self._tournament = tournament
        self._opponents = opponents
        self._archives: list[list[NDArray[np.float32]]] = [[] for _ in populations]
        self._pareto: list[ParetoArchive] = []
        if tournament.pairing == "pareto_archive":
            largest = min(self._rounds, LARGEST_ARCHIVE)
            self._pareto = [ParetoArchive(largest) for _ in populations]
        self._met: list[tuple[Indices, NDArray[np.float64]]] = []
        self._members: list[Genomes] = []
        self._new: list[int] = []
        self._scores: list[Fitness] = []
        self._champions: list[int] = []
        self._played = 0

    @property
    def sides(self) -> int:
        """Number of sides of a match."""
        return len(self._population_of_side)

    @property
    def budget(self) -> int:
        """Number of matches of a run whose generations all have as many as the first."""
        return self.options.generations * max(self.most_matches, 1)

    @property
    def most_matches(self) -> int:
        """Upper bound of the matches of the next generation; 0 if a method cannot tell its size."""
        sizes = self._sizes()
        legs = 2 if self._is_mirrored and self._tournament.both_sides else 1
        last = 1 + legs * sum(len(archive.learners) for archive in self._pareto)
        if self._is_mirrored:
            return last + legs * self._count_pairs(sizes[0]) + sizes[0] * len(self._choose_outside())
        opponents = self._count_opponents(sizes)
        return last + sum(size * each for size, each in zip(sizes, opponents, strict=True))

    @property
    def population_fitness(self) -> Fitness:
        """Scores of the first population after the last generation."""
        return self._scores[0] if self._scores else np.empty(0)

    def scores_of(self, matches: Matches) -> NDArray[np.float64]:
        """Return the scores of this generation's candidates, (matches, sides); NaN for earlier champions."""
        scores = np.full(matches.candidates.shape, np.nan)
        for side, number in enumerate(self._population_of_side):
            column = matches.candidates[:, side]
            present = column >= 0
            if number is not None:
                scores[present, side] = self._scores[number][column[present]]
        return scores

    def matches(self) -> Rounds:
        """Play a generation: yield its matches, last those of the champions alone; see `Rounds`."""
        self._members, self._new, self._met, self._played = [], [], [], 0
        for population in self.populations:
            new = population.method.ask()
            survivors = population.method.survivors()
            self._members.append(np.concatenate([new, survivors]))
            self._new.append(len(new))
        play = self._play_mirrored() if self._is_mirrored else self._play_populations()
        self._scores = yield from self._remember(play)
        self._champions = [_best(scores) for scores in self._scores]
        row = [
            FIRST_OPPONENT - min(self._opponents[side]) if number is None else self._champions[number]
            for side, number in enumerate(self._population_of_side)
        ]
        rows = [*self._meet_learners(row), row]
        matches = self._join(np.array(rows, dtype=np.intp))
        self._met.append((matches.candidates, (yield matches)))

    def finish(self) -> None:
        """Tell the methods the scores of the generation whose matches are over.

        It counts matches as evaluations.
        """
        for number, pareto in enumerate(self._pareto):
            pareto.update(self.generation, self._collect_outcomes(number))
        values = zip(self.populations, self._members, self._new, self._scores, strict=True)
        for (population, members, new, scores), champion, archive in zip(
            values, self._champions, self._archives, strict=True
        ):
            archive.append(members[champion].copy())
            survivors = scores[new:] if len(scores) > new else None
            population.method.tell(scores[:new], survivors)
        target = self.options.target
        self.reached = target is not None and bool((self._scores[0] >= target).any())
        self.evaluations += self._played
        self.done = self.reached or self._is_exhausted()
        if not self.done:
            self.generation += 1

    @property
    def _is_mirrored(self) -> bool:
        """Whether one population plays all sides."""
        return len(self.populations[0].sides) > 1

    def _remember(
        self, play: Generator[Matches, NDArray[np.float64], list[Fitness]]
    ) -> Generator[Matches, NDArray[np.float64], list[Fitness]]:
        """Yield the same matches, and record their candidates and results."""
        try:
            matches = next(play)
            while True:
                fitness = yield matches
                self._met.append((matches.candidates, fitness))
                matches = play.send(fitness)
        except StopIteration as end:
            scores: list[Fitness] = end.value
            return scores

    # Archives of Pareto coevolution.

    def _meet_learners(self, champions: Sequence[int]) -> list[list[int]]:
        """Return the matches of the learners in each archive against this generation's champions.

        champions: one for each side.
        """
        rows = []
        for archive, population in zip(self._pareto, self.populations, strict=False):
            both = self._tournament.both_sides
            for learner in archive.learners:
                sides = population.sides if both else [population.sides[learner % len(population.sides)]]
                for side in sides:
                    row = [*champions]
                    row[side] = -1 - learner
                    rows.append(row)
        return rows

    def _collect_outcomes(self, number: int) -> dict[tuple[int, int], float]:
        """Return the outcomes of a population's champions against those of others, by both generations."""
        sums: dict[tuple[int, int], list[float]] = {}
        for candidates, fitness in self._met:
            generations = np.full(candidates.shape, -1, dtype=np.intp)
            for side, other in enumerate(self._population_of_side):
                column = candidates[:, side]
                earlier = (column < 0) & (column > FIRST_OPPONENT)
                generations[earlier, side] = -1 - column[earlier]
                if other is not None:
                    generations[column == self._champions[other], side] = self.generation
            for side in self.populations[number].sides:
                others = np.delete(generations, side, axis=1)
                same = (others == others[:, :1]).all(axis=1) & (generations >= 0).all(axis=1)
                values = self._values(fitness, side)
                for row in np.flatnonzero(same & np.isfinite(values)).tolist():
                    key = int(generations[row, side]), int(others[row, 0])
                    sums.setdefault(key, []).append(float(values[row]))
        return {key: sum(values) / len(values) for key, values in sums.items()}

    def _sizes(self) -> list[int]:
        """Candidates of each population in the next generation, including survivors, as far as known."""
        if self._members:
            return [len(members) for members in self._members]
        sizes = []
        for population in self.populations:
            method = population.method
            sizes.append(method.first_generation(method.options, method.representation) or 0)
        return sizes

    def _stream(self, purpose: str, number: int = 0) -> Stream:
        return Stream(self.seed, f"competition.{purpose}", self.generation, number)

    # One population against itself.

    def _play_mirrored(self) -> Generator[Matches, NDArray[np.float64], list[Fitness]]:
        count, options = len(self._members[0]), self._tournament
        pairs: list[Indices] = []
        results: list[NDArray[np.float64]] = []
        outside = self._meet_outside(count)
        outside_results = np.empty((0, 2))
        rounds = self._pairs(count, results)
        first: Indices | None = next(rounds, outside[:0])
        while first is not None:
            legs = [first, first[:, ::-1]] if options.both_sides else [first]
            rows = np.concatenate([*legs, outside[len(outside_results) :]])
            fitness = (yield self._join(rows)) if len(rows) else np.empty((0, 2))
            pairs += [first] * len(legs)
            results.append(fitness[: len(first)])
            if options.both_sides:
                results.append(fitness[len(first) : 2 * len(first), ::-1])
            # External opponents play at the same time as the first round.
            outside_results = np.concatenate([outside_results, fitness[len(legs) * len(first) :]])
            first = next(rounds, None)
        met = np.concatenate([*pairs, outside])
        outcome = np.concatenate([*results, outside_results])
        generations = len(self._archives[0])
        players = np.where(met < 0, count - 1 - met, met)  # champions come after the candidates
        players = np.where(met <= FIRST_OPPONENT, count + generations + FIRST_OPPONENT - met, players)
        scores = score_matches(
            options.score_or_default, count, players, outcome, win=options.win, draw=options.draw
        )
        return [scores + 0.0]

    def _choose_outside(self) -> list[tuple[int, int]]:
        """Return side and number of the external opponents that all candidates of one population meet."""
        first, second = self._opponents
        if self._tournament.both_sides:
            return [(side, number) for side in (0, 1) for number in self._opponents[side]]
        chosen = []
        for number in sorted({*first, *second}):
            sides = [side for side in (0, 1) if number in self._opponents[side]]
            chosen.append((sides[(self.generation + number) % len(sides)], number))
        return chosen

    def _meet_outside(self, count: int) -> Indices:
        """Return the matches of one population against external opponents, (matches, 2)."""
        chosen = self._choose_outside()
        rows = np.tile(np.arange(count, dtype=np.intp)[:, np.newaxis], (len(chosen), 2))
        for block, (side, number) in enumerate(chosen):
            rows[block * count : (block + 1) * count, side] = FIRST_OPPONENT - number
        return rows

    def _pairs(self, count: int, results: list[NDArray[np.float64]]) -> Iterator[Indices]:
        """Yield the pairs of each round; `results` has those of the rounds so far, a block or two each."""
        options, archive = self._tournament, self._archives[0]
        if options.pairing == ONLY_OPPONENTS:
            return
        if options.pairing in AGAINST_CHAMPIONS and archive:
            everybody = np.arange(count, dtype=np.intp)
            for number, opponent in enumerate(self._choose_champions(0, len(archive))):
                pairs = np.stack([everybody, np.full(count, -1 - opponent)], axis=1)
                # Candidates play each side against half of the opponents, also with one in each generation.
                yield pairs[:, ::-1] if (self.generation + number) % 2 else pairs
            return
        kind = "random" if options.pairing in AGAINST_CHAMPIONS else options.pairing
        random = np.random.Generator(np.random.PCG64(self._stream("pairs").raw(4).tolist()))
        rounds = PAIRINGS[kind].rounds(count, self._pairing_options, random)
        blocks = 2 if options.both_sides else 1
        try:
            pairs = next(rounds)
            while True:
                yield pairs
                pairs = rounds.send(np.mean(results[-blocks:], axis=0))
        except StopIteration:
            return

    @property
    def _pairing_options(self) -> PairingOptions:
        options = self._tournament
        return PairingOptions(
            rounds=options.rounds, sessions=options.tournaments, win=options.win, draw=options.draw
        )

    @property
    def _rounds(self) -> int:
        """Opponents of a candidate where the number does not follow from the pairing."""
        if self._tournament.pairing == "best":
            return 1
        return self._tournament.rounds or DEFAULT_ROUNDS

    def _count_pairs(self, count: int) -> int:
        pairing = self._tournament.pairing
        if pairing == ONLY_OPPONENTS:
            return 0
        if self._pareto and self._archives[0]:
            return count * len(self._choose_champions(0, len(self._archives[0])))
        if pairing in AGAINST_CHAMPIONS:
            return count * self._rounds
        matches = PAIRINGS[pairing].most_matches(count, self._pairing_options)
        return -(-count * matches // 2)

    # Several populations.

    def _play_populations(self) -> Generator[Matches, NDArray[np.float64], list[Fitness]]:
        sums = [np.zeros(len(members)) for members in self._members]
        played = [np.zeros(len(members)) for members in self._members]
        common = np.empty((0, self.sides), dtype=np.intp)
        if self._tournament.pairing == "round_robin":
            common = _combinations([len(members) for members in self._members])
        blocks = [self._opponents_of(number) for number in range(len(self.populations))]
        fitness = yield self._join(np.concatenate([common, *blocks]))
        for number, population in enumerate(self.populations):
            side = population.sides[0]
            self._add(
                sums[number], played[number], common[:, side], self._values(fitness[: len(common)], side)
            )
        first = len(common)
        for number, block in enumerate(blocks):
            part = fitness[first : first + len(block)]
            side = self.populations[number].sides[0]
            self._add(sums[number], played[number], block[:, side], self._values(part, side))
            first += len(block)
        if self._tournament.score_or_default == "points":
            return [np.where(count > 0, total, np.nan) for total, count in zip(sums, played, strict=True)]
        with np.errstate(invalid="ignore"):
            return [total / count for total, count in zip(sums, played, strict=True)]

    def _values(self, fitness: NDArray[np.float64], side: int) -> NDArray[np.float64]:
        """Return the results of a side, (matches,): its fitness or its points."""
        own = fitness[:, side]
        if self._tournament.score_or_default == "fitness":
            return own
        others = np.delete(fitness, side, axis=1)
        best = others.max(axis=1)
        points = np.where(own > best, self._tournament.win, np.where(own == best, self._tournament.draw, 0.0))
        return np.where(np.isfinite(own) & np.isfinite(best), points, np.nan)

    @staticmethod
    def _add(
        sums: NDArray[np.float64],
        played: NDArray[np.float64],
        candidates: Indices,
        values: NDArray[np.float64],
    ) -> None:
        finished = np.isfinite(values)
        np.add.at(sums, candidates[finished], values[finished])
        np.add.at(played, candidates[finished], 1.0)

    def _opponents_of(self, number: int) -> Indices:
        """Return the matches that count for a population's candidates alone, (matches, sides).

        In a generation, all candidates of a population meet the same opponents.
        """
        count, own = len(self._members[number]), self.populations[number].sides[0]
        rounds = self._choose_opponents(number)
        outside = [
            (side, opponent)
            for side, opponents in enumerate(self._opponents)
            if side != own
            for opponent in opponents
        ]
        partners = np.stack([self._draw(number, side, len(outside)) for side in range(self.sides)], axis=1)
        for row, (side, opponent) in enumerate(outside):
            partners[row, side] = FIRST_OPPONENT - opponent
        rows = np.repeat(np.concatenate([rounds, partners]), count, axis=0)
        rows[:, own] = np.tile(np.arange(count, dtype=np.intp), len(rounds) + len(partners))
        return rows

    def _choose_opponents(self, number: int) -> Indices:
        """Return the opponents of a population's candidates by the pairing, (rounds, sides)."""
        pairing, rounds = self._tournament.pairing, self._count_rounds(number)
        if pairing in {"round_robin", ONLY_OPPONENTS}:
            return np.empty((0, self.sides), dtype=np.intp)
        columns = []
        for side, other in enumerate(self._population_of_side):
            generations = len(self._archives[0])
            has_champions = generations and other not in {None, number}
            if has_champions and pairing in AGAINST_CHAMPIONS:
                assert other is not None
                chosen = self._choose_champions(other, generations, number)
                chosen = [*chosen, *(generations - 1 for _ in range(rounds - len(chosen)))]
                columns.append(-1 - np.array(chosen, dtype=np.intp))
            else:
                columns.append(self._draw(number, side, rounds))
        return np.stack(columns, axis=1)

    def _draw(self, number: int, side: int, count: int) -> Indices:
        """Draw candidates of a side as opponents of a population, (count,); zeros for its own side."""
        other = self._population_of_side[side]
        if other in {None, number} or not count:
            return np.zeros(count, dtype=np.intp)
        drawn = self._stream("opponents", number * self.sides + side).integers(
            len(self._members[other]), count
        )
        return np.array(drawn, dtype=np.intp)

    def _choose_champions(self, other: int, generations: int, number: int = 0) -> list[int]:
        """Return the generations whose champions are opponents: the last, and earlier ones."""
        last = generations - 1
        if self._tournament.pairing == "best":
            return [last]
        if self._pareto:
            tests = [test for test in self._pareto[number].tests if test != last]
            return [last, *tests[max(len(tests) - self._rounds + 1, 0) :]]
        order = np.argsort(
            self._stream("hall_of_fame", number * self.sides + other).unit(generations - 1), kind="stable"
        )
        return [generations - 1, *order[: self._rounds - 1].tolist()]

    def _count_opponents(self, sizes: Sequence[int]) -> list[int]:
        """Return the matches of each candidate of each population that count for it alone."""
        pairing = self._tournament.pairing
        counts = [
            sum(
                len(opponents)
                for side, opponents in enumerate(self._opponents)
                if side not in population.sides
            )
            for population in self.populations
        ]
        if pairing == "round_robin":
            return [counts[0] + int(np.prod(sizes[1:])), *counts[1:]]
        if pairing == ONLY_OPPONENTS:
            return counts
        return [self._count_rounds(number) + count for number, count in enumerate(counts)]

    def _count_rounds(self, number: int) -> int:
        """Return the opponents of each candidate of a population by the pairing."""
        if self._pareto and self._archives[0]:
            return len(self._choose_champions(number, len(self._archives[0]), number))
        return self._rounds

    def _join(self, candidates: Indices) -> Matches:
        """Return matches with the joined genomes of all sides."""
        self._played += len(candidates)
        joined = np.empty((len(candidates), self._ends[-1]), dtype=np.float32)
        for side, number in enumerate(self._population_of_side):
            column, part = candidates[:, side], joined[:, self._starts[side] : self._ends[side]]
            present = column >= 0
            if number is not None:
                part[present] = self._members[number][column[present]]
            for row in np.flatnonzero(~present).tolist():
                part[row] = self._genes_of(side, int(column[row]))
        return Matches(candidates, joined)

    def _genes_of(self, side: int, index: int) -> Genome:
        """Return the genes of an earlier champion or of an external opponent, see `Matches`."""
        if index <= FIRST_OPPONENT:
            return self._opponents[side][FIRST_OPPONENT - index]
        number = self._population_of_side[side]
        assert number is not None
        return self._archives[number][-1 - index]

    def _ask(self) -> Genomes:
        raise InputError("a competition has matches in place of genomes: call matches() and finish()")

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        """Not reached, as `_ask` refuses."""


def _best(scores: Fitness) -> int:
    """Return the index of the best candidate, the first if none has a score."""
    return int(np.argmax(np.where(np.isfinite(scores), scores, -np.inf)))


def _combinations(sizes: Sequence[int]) -> Indices:
    """Return all combinations of a candidate of each population, (combinations, populations)."""
    grids = np.meshgrid(*(np.arange(size) for size in sizes), indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=1).astype(np.intp)
