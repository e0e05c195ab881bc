"""Particle swarm optimization."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from swarmwright import _engine
from swarmwright.methods._box import Box, BoxOptions
from swarmwright.representations._base import Representation
from swarmwright.typing import Fitness, Genomes


class PsoOptions(BoxOptions):
    """Particle swarm optimization, with the coefficients that Trelea recommends."""

    kind: Literal["pso"] = "pso"
    population: int = Field(default=30, ge=3, le=1_000_000)
    """Particles."""
    inertia: float = Field(default=0.6, ge=0, le=2)
    """w: share of a particle's velocity that it keeps."""
    own: float = Field(default=1.7, ge=0, le=10)
    """c1: pull of the best place where a particle has been."""
    social: float = Field(default=1.7, ge=0, le=10)
    """c2: pull of the best place where any particle has been."""
    adaptive: bool = False
    """Whether inertia and pulls follow the state of the swarm, from the given values on. The time for this
    grows with the square of the population."""
    fastest: float = Field(default=0.2, gt=0, le=1)
    """Largest velocity, as a share of the range that is searched."""
    perturb: bool = False
    """Whether the best particle is mutated instead of moved."""


class Pso(Box):
    """Particles fly, pulled by the best place each has seen and the best that all have seen.

    The members are the best places of the particles. A flight that leaves the box is drawn again, up to 20
    times; then it ends between the bound and where it began, at random.

    Source: Kennedy and Eberhart, "Particle swarm optimization", ICNN 1995; coefficients of Trelea, "The
    particle swarm optimization algorithm: convergence analysis and parameter selection", Information
    Processing Letters 85(6), 2003. Adaptive as in Zhan, Zhang, Li and Chung, "Adaptive particle swarm
    optimization", IEEE Transactions on Systems, Man and Cybernetics B 39(6), 2009, in the form of the library
    `pymoo` (Blank and Deb, IEEE Access 8, 2020, doi:10.1109/ACCESS.2020.2990567).
    """

    kind: ClassVar[str] = "pso"
    options_model = PsoOptions
    options: PsoOptions

    def __init__(self, options: PsoOptions, representation: Representation, *, seed: int) -> None:
        super().__init__(options, representation, seed=seed)
        self._places = self._members
        self._velocities = np.empty((0, representation.genome_size))
        self._inertia, self._pulls = options.inertia, (options.own, options.social)
        lower, upper = self.box
        self._width = upper - lower

    def _candidates(self) -> Genomes:
        lower, upper = self.box
        genomes, self._velocities = _engine.flights(
            self._places,
            self._velocities,
            self._members,
            self._best,
            self._streams(),
            inertia=self._inertia,
            pulls=self._pulls,
            fastest=self.options.fastest * self._width,
            lower=lower,
            upper=upper,
            perturbed=self.options.perturb,
        )
        return genomes

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        first = not len(self._members)
        leader = 0 if first else self._best
        super()._tell(genomes, fitness)
        self._places = genomes
        if first:
            units = self.streams("pso.velocity", range(len(genomes))).units(genomes.shape[1])
            self._velocities = units * (self.options.fastest * self._width)
        elif self.options.adaptive:
            self._adapt(leader)

    def _adapt(self, leader: int) -> None:
        """Set inertia and pulls by how far the best place that all flew to is from the others."""
        spread = _engine.spread(self._members, leader, np.where(self._width > 0, self._width, 1.0))
        change = 0.05 + 0.05 * float(self.stream("pso.change").unit(1)[0])
        own, social = (pull + change * sign for pull, sign in zip(self._pulls, _signs(spread), strict=True))
        own, social = (min(max(pull, 1.5), 2.5) for pull in (own, social))
        if own + social > 4:
            own, social = 4 * own / (own + social), 4 * social / (own + social)
        self._pulls = own, social
        decay = float(_engine.exp(np.array([max(min(-2.6 * spread, 700.0), -700.0)]))[0])
        self._inertia = 1 / (1 + 1.5 * decay)


def _signs(spread: float) -> tuple[float, float]:
    """Return how the pulls of the own and of the common best place change in the most likely state."""
    states = {
        (1.0, -1.0): _trapezoid(spread, 0.4, 0.6, 0.7, 0.8),  # exploration
        (0.5, -0.5): _trapezoid(spread, 0.2, 0.3, 0.4, 0.6),  # exploitation
        (0.5, 0.5): _trapezoid(spread, -np.inf, -np.inf, 0.1, 0.3),  # convergence
        (-1.0, 1.0): _trapezoid(spread, 0.7, 0.9, np.inf, np.inf),  # jumping out
    }
    return max(states, key=states.__getitem__)


def _trapezoid(value: float, start: float, first: float, last: float, end: float) -> float:
    """Return 1 between `first` and `last`, 0 outside of `start` and `end`, and what is between, linearly."""
    if first <= value <= last:
        return 1.0
    if value < first:
        return max((value - start) / (first - start), 0.0)
    return max((end - value) / (end - last), 0.0)
