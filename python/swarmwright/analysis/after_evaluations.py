"""The best fitness of a run after a number of evaluations."""

import math

import numpy as np

from swarmwright.runs.instances import by_instance
from swarmwright.runs.run import Run


def fitness_at(run: Run, evaluations: int | None = None) -> tuple[float, int]:
    """Return the best fitness after so many evaluations, NaN if there was none, and after how many it is.

    These are fewer where the run has fewer, or where only finished generations count, see `by_generation`.
    evaluations: None: at the run's end.
    """
    history = run.history
    if evaluations is not None:
        history = [one for one in history if one.evaluations <= evaluations]
    done, best = (history[-1].evaluations, history[-1].best_so_far) if history else (0, math.nan)
    if evaluations is not None and done < min(evaluations, run.evaluations) and not by_generation(run):
        # Within a generation, the record has evaluations in the order in which the method asked for them.
        end = min(evaluations, run.evaluations)
        best, done = float(np.fmax(best, run._store.best_fitness(done, end))), end
    return best if math.isfinite(best) else math.nan, done


def by_generation(run: Run) -> bool:
    """Whether the best of a run is known at the end of generations only: its fitness may become another."""
    return run.experiment.ranking.reevaluate or by_instance(run.experiment)
