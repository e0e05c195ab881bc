"""The optimization loop: ask, evaluate, rank, tell, record."""

import dataclasses
import platform
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright._backend import Backend, Crews, Progress, Results, Servers, open_backend
from swarmwright._errors import RunError
from swarmwright._experiment import Experiment
from swarmwright._plot import prepare
from swarmwright._record import FORMAT, RecordWriter, check_folder, default_folder
from swarmwright._run import Run
from swarmwright._statistics import Summary, summarize
from swarmwright.methods import Method
from swarmwright.rankings._base import Fitness, Ranking, best_first
from swarmwright.representations import Representation
from swarmwright.representations._base import Genomes


@dataclass(frozen=True, kw_only=True)
class Generation:
    """How far an optimization is, after a generation."""

    generation: int
    """Index of the generation, from 0."""
    generations: int
    """Generations of the whole run."""
    best: float
    """Best fitness in the population."""
    mean: float
    """Mean fitness of the population."""
    best_so_far: float
    """Best fitness since the start."""
    failed: int
    """Candidates of this generation whose evaluation failed."""
    evaluations: int
    """Candidates evaluated since the start."""
    seconds: float
    """Since the start."""
    evaluations_per_second: float
    """In this generation."""
    seconds_left: float
    """Estimate for the rest of the budget."""
    waiting_for: str
    """What the evaluation waited for last; empty when it waited for nothing."""


def optimize(
    experiment: Experiment,
    on_generation: Callable[[Generation], bool | None] | None = None,
    *,
    on_progress: Progress | None = None,
    broker: str | None = None,
    servers: Servers | None = None,
    seed: int | None = None,
    out: str | Path | None = None,
) -> Run:
    """Evolve a controller; return the run, whose folder holds everything.

    Without a broker (here or in the experiment) an embedded one is started, with servers; with one, the
    servers found there are used. Ctrl-C ends the run early: the results of all finished generations are kept,
    and the run that is returned has `interrupted` set. Before the first generation is finished there is
    nothing to keep: KeyboardInterrupt is raised.

    Args:
        experiment: what to do.
        on_generation: called after each generation; returning False ends the run.
        on_progress: called about ten times a second with (episodes done, episodes of this generation, what is
            waited for).
        broker: URL of a broker, instead of the experiment's.
        servers: instead of the experiment's: a number, "auto" or "local". A number given together with a
            broker is started on that broker.
        seed: instead of the experiment's.
        out: folder for the results, new or empty; default runs/<name>-<seed>, with a number behind it if that
            exists.

    Raises:
        InputError: the experiment cannot be run as it is, or the folder holds something.
        RunError: no broker, no fitting server, or every candidate of a generation failed.
    """
    if seed is not None:
        experiment = experiment.replace(seed=seed)
    if out is not None:
        check_folder(Path(out))
    first_seed = experiment.first_seed
    with open_backend(experiment, broker=broker, servers=servers) as backend:
        representation = experiment.representation(backend.sensors, backend.actuators)
        folder = default_folder(experiment) if out is None else Path(out)
        resolved = dataclasses.replace(experiment, sensors=backend.sensors, actuators=backend.actuators)
        # The plotting library takes a quarter of a second to load: while the simulations run, that is free.
        threading.Thread(target=prepare, daemon=True).start()
        with RecordWriter(folder, resolved, representation.genome_size) as record:
            loop = _Loop(
                method=experiment.new_method(representation),
                ranking=experiment.new_ranking(),
                representation=representation,
                backend=backend,
                record=record,
                seeds=experiment.new_ranking().seeds(first_seed),
            )
            loop.run(on_generation, on_progress)
    run = Run(folder)
    run.plot()
    return run


class _Loop:
    def __init__(
        self,
        *,
        method: Method,
        ranking: Ranking,
        representation: Representation,
        backend: Backend,
        record: RecordWriter,
        seeds: list[int],
    ) -> None:
        self._method = method
        self._ranking = ranking
        self._representation = representation
        self._backend = backend
        self._record = record
        self._seeds = seeds
        self._best_so_far = -np.inf
        self._waiting_for = ""
        self._started = time.monotonic()

    def run(
        self, on_generation: Callable[[Generation], bool | None] | None, on_progress: Progress | None
    ) -> None:
        """Run until the budget is used, the target is reached, a callback says no, or Ctrl-C."""
        interrupted = False
        self._record.journal(
            [{"event": "start", "time": _now(), **_surroundings(), "where": self._backend.description}]
        )
        try:
            while not self._method.done:
                generation = self._generation(on_progress)
                if on_generation is not None and on_generation(generation) is False:
                    break
        except KeyboardInterrupt:
            interrupted = True
            if not self._method.evaluations:
                raise
        except RunError as error:
            done = self._method.generation
            if done == 0:
                raise
            kept = (
                f"the results of {done} generation{'s' if done > 1 else ''} are kept in {self._record.folder}"
            )
            raise RunError(f"{error}; {kept}") from error
        finally:
            ending = {
                "seconds": self._seconds(),
                "interrupted": interrupted,
                "evaluations": self._method.evaluations,
            }
            self._record.journal([{"event": "end", "time": _now(), **ending}])

    def _generation(self, on_progress: Progress | None) -> Generation:
        began = self._seconds()
        number = self._method.generation
        genomes = self._method.ask()
        results = self._evaluate(genomes, on_progress)
        self._record.journal(
            {"event": "warning" if "warning" in entry else "episode", "generation": number, **entry}
            for entry in results.journal
        )
        fitness = self._ranking.score(results.fitness)
        if not np.isfinite(fitness).any():
            raise RunError(_all_failed(number, results.journal))
        self._method.tell(fitness)
        leader = self._lead(genomes, fitness, number)
        summary = summarize(
            self._method.population_fitness,
            generation=number,
            evaluations=self._method.evaluations,
            best_so_far=self._best_so_far,
            failed=int(np.isnan(fitness).sum()),
        )
        self._record.generation(summary, genomes, fitness, results.fitness, leader)
        return self._report(summary, self._seconds() - began, len(genomes))

    def _evaluate(self, genomes: Genomes, on_progress: Progress | None) -> Results:
        def progress(done: int, total: int, waiting_for: str) -> None:
            self._waiting_for = waiting_for if done < total else ""
            if on_progress is not None:
                on_progress(done, total, waiting_for)

        return self._backend.evaluate(Crews.of(self._representation, genomes), self._seeds, progress)

    def _lead(self, genomes: Genomes, fitness: Fitness, generation: int) -> dict[str, Any] | None:
        """Return what best.json holds when a candidate is better than all before."""
        leader = int(best_first(fitness)[0])
        value = float(fitness[leader])
        if not value > self._best_so_far:
            return None
        self._best_so_far = value
        controller = self._representation.specification(genomes[leader])
        return {"fitness": value, "generation": generation, "candidate": leader, "controller": controller}

    def _report(self, summary: Summary, seconds: float, evaluated: int) -> Generation:
        elapsed = self._seconds()
        left = 0 if self._method.done else max(self._method.budget - summary.evaluations, 0)
        return Generation(
            generation=summary.generation,
            generations=self._method.options.generations,
            best=summary.best,
            mean=summary.mean,
            best_so_far=summary.best_so_far,
            failed=summary.failed,
            evaluations=summary.evaluations,
            seconds=elapsed,
            evaluations_per_second=evaluated / max(seconds, 1e-9),
            seconds_left=left * elapsed / summary.evaluations,
            waiting_for=self._waiting_for,
        )

    def _seconds(self) -> float:
        return time.monotonic() - self._started


def _all_failed(generation: int, journal: list[dict[str, Any]]) -> str:
    reasons = [str(entry["error"]) for entry in journal if entry.get("error")]
    why = f"; the last reason: {reasons[-1]}" if reasons else ""
    return f"every candidate of generation {generation} failed{why}"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _surroundings() -> dict[str, Any]:
    from swarmwright import _engine

    return {
        "format": FORMAT,
        "swarmwright": _engine.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "host": socket.gethostname(),
        "machine": platform.platform(),
    }
