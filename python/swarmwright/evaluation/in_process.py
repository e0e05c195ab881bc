"""Evaluation of a user's simulation in this process."""

from collections.abc import Sequence

from swarmwright import _engine
from swarmwright.evaluation.backend import Crews, LocalBackend, Progress, Results
from swarmwright.experiment.experiment import Experiment
from swarmwright.simulations.host import Host
from swarmwright.simulations.loading import load


class OwnBackend(LocalBackend):
    """Runs one episode after the other, without broker and servers."""

    def __init__(self, experiment: Experiment) -> None:
        super().__init__(experiment)
        self._host = Host(load(experiment.simulation))

    def compute(self, crews: Crews, seeds: Sequence[int], on_progress: Progress) -> Results:
        """Return the results, NaN where the code failed, and why it did. Raises the engine's errors."""
        fitness, metrics, failures = _engine.evaluate_own(
            self._host,
            self.parameters,
            crews.architecture,
            crews.weights,
            list(seeds),
            on_progress,
            metrics=self.metrics,
        )
        journal = [
            {"warning": f"episode {episode} failed: {reason}", "candidate": candidate, "error": reason}
            for candidate, episode, reason, _ in failures
        ]
        return Results(fitness, metrics, journal)
