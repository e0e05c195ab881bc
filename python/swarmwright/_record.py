"""Writing a run folder: what came out, generation by generation, and apart from it how it went.

record.csv, generations.csv, best.json and experiment.yaml are the same bytes for the same seed, whoever
evaluated. journal.jsonl tells when, where and how long. A generation counts once its line in generations.csv
is complete.
"""

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, fields
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright._errors import InputError, RunError
from swarmwright._experiment import Experiment
from swarmwright._statistics import Summary
from swarmwright.rankings._base import Fitness
from swarmwright.representations._base import Genomes

FORMAT = 1
"""Version of the run folder."""


def default_folder(experiment: Experiment) -> Path:
    """Return runs/<file stem or simulation>-<seed>, with a number behind it when that exists."""
    name = experiment.path.stem if experiment.path is not None else experiment.simulation
    safe = (
        "".join(sign if sign.isalnum() or sign in "-_." else "_" for sign in name).lstrip(".")[:100] or "run"
    )
    base = Path("runs") / f"{safe}-{experiment.seed}"
    folder, number = base, 1
    while folder.exists():
        number += 1
        folder = base.with_name(f"{base.name}-{number}")
    return folder


def check_folder(folder: Path) -> None:
    """Raise InputError unless `folder` is new or empty: results are never written over."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the results")
    try:
        if folder.is_dir() and any(folder.iterdir()):
            raise InputError(
                f"{folder}: is not empty, and results are never written over; name another folder"
            )
        parent = next(above for above in (folder, *folder.absolute().parents) if above.exists())
    except OSError as error:
        raise InputError(f"{folder}: cannot be used for results: {error.strerror}") from error
    if not (parent.is_dir() and os.access(parent, os.W_OK | os.X_OK)):
        raise InputError(f"{folder}: cannot be created: no right to write in {parent}")


class RecordWriter:
    """Writes a run folder. A context manager: on exit, a generation under way is taken back.

    Args:
        folder: new or empty.
        experiment: as it is run.
        genome_size: genes per candidate.

    Raises:
        InputError: the folder cannot be written, or is not empty.
    """

    def __init__(self, folder: Path, experiment: Experiment, genome_size: int) -> None:
        check_folder(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            experiment.save(folder / "experiment.yaml")
            self._files = {
                name: _new(folder / name) for name in ("record.csv", "generations.csv", "journal.jsonl")
            }
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
        self.folder = folder
        episodes = experiment.ranking.episodes
        columns = ["generation", "candidate", "fitness"]
        columns += [f"episode_{index}" for index in range(episodes)] + [
            f"g{index}" for index in range(genome_size)
        ]
        self._write("record.csv", [",".join(columns)])
        self._write("generations.csv", [",".join(field.name for field in fields(Summary))])
        self._best: dict[str, Any] | None = None
        self._mark()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._write_best()
        for name, file in self._files.items():
            file.flush()
            if name != "journal.jsonl":
                file.truncate(self._complete[name])
            file.close()

    def generation(
        self,
        summary: Summary,
        genomes: Genomes,
        fitness: Fitness,
        episodes: NDArray[np.float64],
        best: dict[str, Any] | None,
    ) -> None:
        """Write the evaluations of a generation, its summary, and the best candidate if it is a new one.

        best: fitness, generation, candidate, controller; None when no candidate is better than all before.
        """
        lines = []
        texts = _engine.decimals(genomes)
        for index, (genes, value, results) in enumerate(zip(texts, fitness, episodes, strict=True)):
            cells = [
                str(summary.generation),
                str(index),
                *map(repr, (float(value), *results.tolist())),
                genes,
            ]
            lines.append(",".join(cells))
        self._write("record.csv", lines)
        self._write("generations.csv", [",".join(repr(value) for value in astuple(summary))])
        self._mark(best)
        self._write_best()

    def _write_best(self) -> None:
        """Write the best candidate, in one piece. Done again on exit, should Ctrl-C have come in between."""
        if self._best is not None:
            text = json.dumps(self._best, indent=2, allow_nan=False) + "\n"
            temporary = self.folder / "best.json.new"
            with _disk_errors(temporary):
                temporary.write_text(text, encoding="utf-8")
                temporary.replace(self.folder / "best.json")
            self._best = None

    def journal(self, entries: Iterable[dict[str, Any]]) -> None:
        """Write journal entries."""
        self._write("journal.jsonl", [json.dumps(entry, sort_keys=False) for entry in entries])

    def _write(self, name: str, lines: Sequence[str]) -> None:
        if lines:
            file = self._files[name]
            with _disk_errors(self.folder / name):
                file.write("".join(f"{line}\n" for line in lines).encode())
                file.flush()

    def _mark(self, best: dict[str, Any] | None = None) -> None:
        """Note that everything written so far counts."""
        state = {name: file.tell() for name, file in self._files.items()}
        self._complete, self._best = state, best or self._best


@contextmanager
def _disk_errors(path: Path) -> Iterator[None]:
    """Say what stops a run when the disk does."""
    try:
        yield
    except OSError as error:
        raise RunError(
            f"{path}: cannot be written: {error.strerror}; what was written before is kept"
        ) from error


def _new(path: Path) -> IO[bytes]:
    return path.open("xb")
