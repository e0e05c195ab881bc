"""Methods by the library `pymoo`: what they share."""

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from swarmwright.methods._base import Method, MethodOptions
from swarmwright.methods._numbers import DISCRETE, center_and_reach, costs, one_thread, rounded
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness, Genomes, Limits


class PymooOptions(MethodOptions):
    """Options of methods that search a box."""

    population: int
    reach: float = Field(default=5.0, ge=1, le=1e6)
    """Genes without bounds stay within so many times their initial range around its middle."""


class Pymoo(Method):
    """The library proposes candidates; this gives it a box, a first generation and costs.

    The box is made of the genes' bounds and, where there are none, of their initial range times `reach`. The
    first generation are random genomes of the representation, as with every method here, not points of the
    whole box. The library is told minus the fitness, for the points that it asked for, not their rounding to
    binary32. It compares these numbers and does not compute with them; that of a failed candidate is worse
    than all others.
    """

    options: PymooOptions
    options_model: ClassVar[type[PymooOptions]]
    keeps_members = True
    start_as = "members"
    libraries = ("pymoo", "scipy")
    extra = "methods"
    generational_because = "the library pymoo replaces whole generations"

    def __init__(self, options: PymooOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._algorithm: Any = None
        self._problem: Any = None
        self._points: Any = None
        self._members: Fitness = np.empty(0)

    @classmethod
    def unsuitable(cls, representation: Representation) -> str | None:
        """Refuse genes that are not numbers to compute with."""
        return None if representation.continuous else DISCRETE

    @property
    def budget(self) -> int:
        """Number of evaluations of the whole run."""
        return self.options.population * self.options.generations

    @property
    def population_fitness(self) -> Fitness:
        """Fitness of the members, which stay until something better replaces them."""
        return self._members

    @property
    def box(self) -> Limits:
        """Where genes are searched: the lowest and highest value of each."""
        center, reach = center_and_reach(self.representation)
        lower, upper = self.representation.bounds
        wide = self.options.reach * reach
        return (
            np.where(np.isfinite(lower), lower, np.minimum(center - wide, upper)),
            np.where(np.isfinite(upper), upper, np.maximum(center + wide, lower)),
        )

    @abstractmethod
    def _new_algorithm(self, first: Genomes) -> Any:  # noqa: ANN401 - the library has no types
        """Return pymoo's algorithm, which begins with the genomes `first`."""

    def _ask(self) -> Genomes:
        if self._algorithm is None:
            self._begin()
        with one_thread():
            self._points = self._algorithm.ask()
        return rounded(self._points.get("X").astype(np.float64), self.representation)

    def _begin(self) -> None:
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        lower, upper = self.box
        self._problem = Problem(n_var=self.representation.genome_size, n_obj=1, xl=lower, xu=upper)
        self._algorithm = self._new_algorithm(self.initials(range(self.options.population)))
        self._algorithm.setup(self._problem, seed=self.seed, termination=NoTermination())

    def kept(self) -> Genomes:
        """Return the members that those asked for compete with, from the second generation on."""
        if not self._algorithm.is_initialized:
            return super().kept()
        return rounded(self._algorithm.pop.get("X").astype(np.float64), self.representation)

    def _rescore(self, fitness: Fitness) -> None:
        for member, value, cost in zip(self._algorithm.pop, fitness.tolist(), costs(fitness), strict=True):
            member.set("F", np.array([cost]))
            member.set("fitness", value)

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:  # noqa: ARG002 - the library keeps them
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        values = costs(fitness)[:, np.newaxis]
        Evaluator().eval(StaticProblem(self._problem, F=values), self._points)
        for point, value in zip(self._points, fitness.tolist(), strict=True):
            point.set("fitness", value)  # costs of very large values are not the fitness any more
        # The swarm's state is a quotient of distances, which overflows where all particles are equally far.
        with one_thread(), np.errstate(over="ignore"):
            self._algorithm.tell(infills=self._points)
        self._members = np.array([point.get("fitness") for point in self._algorithm.pop])
