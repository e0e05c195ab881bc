"""Differential evolution."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.methods._box import Box, BoxOptions


class DeOptions(BoxOptions):
    """Differential evolution, with the defaults of the library `pymoo` but for the population."""

    kind: Literal["de"] = "de"
    population: int = Field(default=40, ge=5, le=1_000_000)
    """Members, each of which competes with one trial vector in each generation."""
    base: Literal["best", "rand", "target-to-best"] = "best"
    """What a difference of two other members is added to: the best member or a random one;
    `target-to-best`: the member itself, to which the difference between the best and another member is
    added, as in pymoo."""
    crossover: Literal["bin", "exp", "hypercube", "line"] = "bin"
    """How member and mutant are mixed: `bin` gene by gene; `exp`: a run of genes is the mutant's;
    `hypercube`: each gene lies between the two by a share of its own; `line`: all genes by the same share."""
    factor: float = Field(default=0.5, gt=0, le=2)
    """F: how much of a difference is added."""
    rate: float = Field(default=0.2, ge=0, le=1)
    """CR. `bin`: probability that a gene is the mutant's, of which there is at least one; `exp`: probability
    that the run of the mutant's genes, which has at least one, has one more; `hypercube` and `line`: the
    largest share of the way from member to mutant, of which a uniform part is taken."""
    mutate: float = Field(default=0.1, ge=0, le=1)
    """Probability of a polynomial mutation after that."""


class De(Box):
    """Differences between members are steps: they shrink and turn with the population by themselves.

    Each member meets a challenger, made of a base plus `factor` times a difference of two members, crossed
    with the member; the better one stays. What leaves the box comes back between the bound and its
    base, at random.

    Source: Storn and Price, "Differential evolution", Journal of Global Optimization 11, 1997; the mutation
    after that as in the library `pymoo` (Blank and Deb, IEEE Access 8, 2020,
    doi:10.1109/ACCESS.2020.2990567).
    """

    kind: ClassVar[str] = "de"
    options_model = DeOptions
    options: DeOptions

    def _begin(self) -> _engine.Search:
        options = self.options
        lower, upper = self.box
        return _engine.Search.differential(
            self.seed,
            self.kind,
            first=self._first,
            lower=lower,
            upper=upper,
            base=options.base,
            crossover=options.crossover,
            factor=options.factor,
            rate=options.rate,
            mutate=options.mutate,
        )
