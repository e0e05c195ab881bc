"""A generation whose ranking is a race: evaluated in rounds, of which each has fewer candidates."""

from collections.abc import Callable, Sequence

import numpy as np

from swarmwright.methods.rankings.race import Race
from swarmwright.servers.evaluation.base import Backend, Controllers, OnResults, Progress, Results
from swarmwright.servers.rows import Journal


def race(
    ranking: Race,
    backend: Backend,
    controllers: Controllers,
    seeds: Sequence[int],
    on_progress: Progress,
    meanwhile: Callable[[], None] | None,
    on_results: OnResults | None = None,
) -> Results:
    """Evaluate a generation; NaN where an episode failed, or the candidate did not go through it.

    Arguments as those of `Backend.evaluate`.
    """
    count = len(controllers.weights)
    fitness = np.full((count, len(seeds)), np.nan)
    metrics = np.full((count, len(seeds), len(backend.metrics)), np.nan)
    journal = Journal()
    rounds = ranking.rounds(count)
    who, which = next(rounds)
    while True:
        whole = len(who) == count
        part = Controllers(
            controllers.architecture,
            controllers.weights if whole else np.ascontiguousarray(controllers.weights[who]),
            controllers.sample if whole else None,
        )
        before = which.start * count

        def progress(done: int, total: int, waiting_for: str, before: int = before) -> None:  # noqa: ARG001
            on_progress(before + done, count * len(seeds), waiting_for)

        results = backend.evaluate(part, seeds[which], progress, meanwhile, on_results)
        meanwhile = on_results = None
        fitness[who, which] = results.fitness
        metrics[who, which] = results.metrics
        extend(journal, results.journal, who.tolist(), which.start)
        try:
            who, which = rounds.send(results.fitness)
        except StopIteration:
            on_progress(count * len(seeds), count * len(seeds), "")
            return Results(fitness, metrics, journal)


def extend(journal: Journal, part: Journal, who: list[int], first: int) -> None:
    """Add what was done for some candidates, in episodes that are counted from `first` on."""
    for attempt in part.attempts:
        place, episode = who[attempt.candidate], first + attempt.episode
        journal.attempts.append(attempt._replace(candidate=place, episode=episode))
    for warning in part.warnings:
        candidate = None if warning.candidate is None else who[warning.candidate]
        journal.warnings.append(warning.moved(candidate, first))
