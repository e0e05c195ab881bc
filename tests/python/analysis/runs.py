"""Runs whose fitness is known, as `Run` shows them; what wrote their folder does not matter here."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from swarmwright import Experiment, Run
from swarmwright.common.processes import StablePath
from swarmwright.common.statistics import Summary, figures_of, summarize
from swarmwright.runs.store import Record
from swarmwright.runs.store.table import RecordTable

BASE: dict[str, Any] = {
    "simulation": "minisim", "servers": "local", "controller": {"kind": "layered", "hidden": [2]},
    "method": {"kind": "nnga", "population": 4, "generations": 3},
}  # fmt: skip


class KnownRun(Run):
    """A run of these generations: a row of fitness values for each, genomes drawn with its seed."""

    def __init__(
        self, path: Path, fitness: Sequence[Sequence[float]], /, *, genomes: Any = None, **changes: Any
    ) -> None:
        self._place = StablePath(path)  # and no store
        self._fitness = [np.array(row, dtype=np.float64) for row in fitness]
        self._experiment = Experiment.from_mapping(BASE).replace(**changes)
        self._genomes = genomes

    @property
    def experiment(self) -> Experiment:
        return self._experiment

    @property
    def _store(self) -> Any:  # type: ignore[override] # no store
        """Return what reads the fitness of some evaluations, and the best one, the same in two episodes."""
        fitness = np.concatenate(self._fitness)
        best = SimpleNamespace(episodes=np.full(2, np.fmax.reduce(fitness)), generation=0)
        return SimpleNamespace(
            best_fitness=lambda first, end: np.fmax.reduce(fitness[first:end]),
            evaluation=lambda *_: best,
            evaluations_of=lambda one: [one],
            finished=len(self._fitness),
        )

    @property
    def code(self) -> dict[int, str]:
        return {}

    @property
    def interrupted(self) -> bool:
        return False

    @property
    def ended_since_opened(self) -> bool:
        return False

    @property
    def seconds(self) -> float:
        return 1.5

    @property
    def digest(self) -> str:
        return "0" * 64

    @property
    def unseen(self) -> None:
        """Return nothing: it has not been validated."""

    @property
    def validation(self) -> None:
        """Return nothing."""

    @property
    def history(self) -> list[Summary]:
        found = []
        so_far, evaluations = -np.inf, 0
        for generation, row in enumerate(self._fitness):
            evaluations += len(row)
            so_far = max([so_far, *row[np.isfinite(row)]])
            failed = int(np.isnan(row).sum())
            found.append(
                summarize(
                    figures_of(row),
                    generation=generation,
                    evaluations=evaluations,
                    best_so_far=so_far,
                    failed=failed,
                )
            )
        return found

    @property
    def record(self) -> RecordTable:
        values = np.concatenate(self._fitness)
        sizes = [len(row) for row in self._fitness]
        genomes = self._genomes
        if genomes is None:
            random = np.random.default_rng(self._experiment.seed)
            genomes = random.standard_normal((len(values), self._experiment.genome_size))
        record = Record(
            generation=np.repeat(np.arange(len(sizes)), sizes),
            candidate=np.concatenate([np.arange(size) for size in sizes]),
            fitness=values,
            episodes=values[:, None],
            metrics=np.empty((len(values), 1, 0)),
            genomes=np.asarray(genomes, dtype=np.float32),
        )
        return RecordTable(record, [])


def runs(path: Path, finals: Sequence[float], **changes: Any) -> list[KnownRun]:
    """A run for each value, with seeds 1, 2, ..: two generations, of which the second has the value."""
    name = "-".join(str(value) for value in changes.values()) or "base"
    safe = "".join(sign if sign.isalnum() else "_" for sign in name)
    return [
        KnownRun(path / f"{safe}-{seed}", [[final - 2, final - 3], [final, final - 1]], seed=seed, **changes)
        for seed, final in enumerate(finals, 1)
    ]
