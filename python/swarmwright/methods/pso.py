"""Particle swarm optimization."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.methods._box import Box, BoxOptions


class PsoOptions(BoxOptions):
    """Particle swarm optimization, with Trelea's coefficients."""

    kind: Literal["pso"] = "pso"
    population: int = Field(default=30, ge=3, le=1_000_000)
    """Particles."""
    inertia: float = Field(default=0.6, ge=0, le=2)
    """w: weight of a particle's previous velocity."""
    own: float = Field(default=1.7, ge=0, le=10)
    """c1: attraction of a particle's best position."""
    social: float = Field(default=1.7, ge=0, le=10)
    """c2: attraction of the swarm's best position."""
    adaptive: bool = False
    """Whether inertia and attractions adapt to the state of the swarm; takes time quadratic in the
    population."""
    fastest: float = Field(default=0.2, gt=0, le=1)
    """Maximum velocity, as a share of the search range."""
    perturb: bool = False
    """Whether the best particle is mutated instead of moved."""


class Pso(Box):
    """Particle swarm optimization: particles are attracted by their own and the swarm's best positions.

    The members are the best positions of the particles. A move that leaves the box is drawn again, up to 20
    times; then it ends at a random point between the bound and its start.

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
