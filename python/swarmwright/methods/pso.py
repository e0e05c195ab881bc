"""Particle swarm optimization."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.methods._box import Box, BoxOptions


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

    def _begin(self) -> _engine.Search:
        options = self.options
        lower, upper = self.box
        return _engine.Search.swarm(
            self.seed,
            self.kind,
            first=self._first,
            lower=lower,
            upper=upper,
            inertia=options.inertia,
            pulls=(options.own, options.social),
            fastest=options.fastest,
            adaptive=options.adaptive,
            perturb=options.perturb,
        )
