"""Particle swarm optimization."""

from typing import Any, ClassVar, Literal

from pydantic import Field

from swarmwright.methods._pymoo import Pymoo, PymooOptions
from swarmwright.typing import Genomes


class PsoOptions(PymooOptions):
    """Particle swarm optimization of the library `pymoo` with its defaults."""

    kind: Literal["pso"] = "pso"
    population: int = Field(default=25, ge=3, le=1_000_000)
    """Particles."""
    inertia: float = Field(default=0.9, ge=0, le=2)
    """w: share of a particle's velocity that it keeps."""
    own: float = Field(default=2.0, ge=0, le=10)
    """c1: pull of the best place where a particle has been."""
    social: float = Field(default=2.0, ge=0, le=10)
    """c2: pull of the best place where any particle has been."""
    adaptive: bool = True
    """Whether inertia and pulls follow the state of the swarm."""
    fastest: float = Field(default=0.2, gt=0, le=1)
    """Largest velocity, as a share of the range that is searched."""
    perturb: bool = True
    """Whether the best particle is mutated instead of moved."""


class Pso(Pymoo):
    """Particles fly, pulled by the best place each has seen and the best that all have seen.

    Source: Kennedy and Eberhart, "Particle swarm optimization", ICNN 1995; adaptive as in Zhan, Zhang, Li and
    Chung, "Adaptive particle swarm optimization", IEEE Transactions on Systems, Man and Cybernetics B 39(6),
    2009; library `pymoo` (Blank and Deb, IEEE Access 8, 2020, doi:10.1109/ACCESS.2020.2990567).
    """

    kind: ClassVar[str] = "pso"
    options_model = PsoOptions
    options: PsoOptions

    def _new_algorithm(self, first: Genomes) -> Any:  # noqa: ANN401 - the library has no types
        from pymoo.algorithms.soo.nonconvex.pso import PSO

        options = self.options
        return PSO(
            pop_size=options.population,
            sampling=first.astype(float),
            w=options.inertia,
            c1=options.own,
            c2=options.social,
            adaptive=options.adaptive,
            max_velocity_rate=options.fastest,
            pertube_best=options.perturb,
        )
