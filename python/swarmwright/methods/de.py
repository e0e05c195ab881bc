"""Differential evolution."""

from typing import ClassVar, Literal

from pydantic import Field

from swarmwright import _engine
from swarmwright.methods._box import Box, BoxOptions


class DeOptions(BoxOptions):
    """Differential evolution, with pymoo's defaults except for the population."""

    kind: Literal["de"] = "de"
    population: int = Field(default=40, ge=5, le=1_000_000)
    """Members, each of which competes with one trial vector per generation."""
    base: Literal["best", "rand", "target-to-best"] = "best"
    """Base of mutants: the best member, a random one, or the member itself plus the difference between the
    best and another member, as in pymoo.
    """
    crossover: Literal["bin", "exp", "hypercube", "line"] = "bin"
    """Mixing of member and mutant. `bin`: gene by gene. `exp`: a run of genes from the mutant. `hypercube`:
    each gene between the two, by its own share. `line`: all genes by the same share."""
    factor: float = Field(default=0.5, gt=0, le=2)
    """F: weight of differences."""
    rate: float = Field(default=0.2, ge=0, le=1)
    """CR. `bin`: probability of a gene of the mutant (at least one). `exp`: probability that the run of the
    mutant's genes continues. `hypercube`, `line`: upper limit of the share of the way to the mutant."""
    mutate: float = Field(default=0.1, ge=0, le=1)
    """Probability of a subsequent polynomial mutation."""


class De(Box):
    """Differential evolution, whose steps are differences between members and adapt with the population.

    Each member competes with a challenger: a base plus `factor` times a difference of two members, crossed
    with the member. The better of the two survives. Genes beyond the box are set to a random value between
    the bound and the base.

    Source: Storn and Price, "Differential evolution", Journal of Global Optimization 11, 1997; the subsequent
    mutation as in the library `pymoo` (Blank and Deb, IEEE Access 8, 2020, doi:10.1109/ACCESS.2020.2990567).
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
