"""Reading run folders: what an optimization left behind."""

import csv
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmwright._controller import Controller
from swarmwright._errors import InputError, RunError
from swarmwright._experiment import Experiment
from swarmwright._files import write_text
from swarmwright._statistics import Summary
from swarmwright.rankings._base import best_first


@dataclass(frozen=True)
class Best:
    """The best candidate of a run; of equals, the first."""

    fitness: float
    generation: int
    candidate: int
    """Index among the candidates evaluated in that generation."""
    specification: dict[str, Any]
    """The controller as plain values."""

    @property
    def controller(self) -> Controller:
        """A new controller at the start of an episode, callable on numpy arrays."""
        return Controller(self.specification)


@dataclass(frozen=True)
class Record:
    """Every evaluation of a run, sorted by generation and candidate."""

    generation: NDArray[np.int64]
    """(evaluations,)"""
    candidate: NDArray[np.int64]
    """(evaluations,)"""
    fitness: NDArray[np.float64]
    """(evaluations,), NaN where it failed."""
    episodes: NDArray[np.float64]
    """(evaluations, episodes)"""
    genomes: NDArray[np.float32]
    """(evaluations, genome_size)"""


class Run:
    """An optimization's results, in a folder of plain files.

    Made by `swarmwright.optimize` or `Run.open(folder)`. The files: experiment.yaml (every default written
    out), record.csv (every evaluation), generations.csv, best.json (the best controller), fitness.png, and
    journal.jsonl (which server did what, when and how long). The folder of a run that was killed can be
    opened too; it holds all generations that were finished.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open a run folder. Raises InputError when `path` is none."""
        folder = Path(path)
        if not folder.is_dir():
            what = "is not a folder" if folder.exists() else "there is no such folder"
            raise InputError(f"{folder}: {what}; name a run folder such as runs/minisim-1")
        missing = [
            name
            for name in ("experiment.yaml", "record.csv", "generations.csv")
            if not (folder / name).exists()
        ]
        if missing:
            raise InputError(f"{folder}: is no run folder: {', '.join(missing)} missing")
        run = cls(folder)
        _ = run.history, run.experiment  # complain now rather than later
        return run

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment as it was run."""
        return Experiment.load(self.path / "experiment.yaml")

    @cached_property
    def history(self) -> list[Summary]:
        """The figures of each finished generation."""
        file = self.path / "generations.csv"
        rows = _rows(file)
        try:
            return [_summary(row) for row in rows]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{file}: is damaged: {error}") from error

    @property
    def generations(self) -> int:
        """Finished generations."""
        return len(self.history)

    @property
    def evaluations(self) -> int:
        """Evaluated candidates."""
        return self.history[-1].evaluations if self.history else 0

    @cached_property
    def best(self) -> Best:
        """The best candidate. Raises RunError when no candidate was evaluated."""
        if not self.history:
            raise RunError(f"{self.path}: holds no finished generation, so there is no best candidate")
        file = self.path / "best.json"
        try:
            values = json.loads(file.read_bytes())
            best = Best(values["fitness"], values["generation"], values["candidate"], values["controller"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{file}: is missing or damaged: {error}") from error
        # A kill between two files leaves the best of the generation before: the record knows better.
        return best if best.fitness == self.history[-1].best_so_far else self._best_of_record()

    def _best_of_record(self) -> Best:
        record = self.record
        index = int(best_first(record.fitness)[0])
        return Best(
            float(record.fitness[index]),
            int(record.generation[index]),
            int(record.candidate[index]),
            self.experiment.representation().specification(record.genomes[index]),
        )

    @cached_property
    def _ending(self) -> dict[str, Any]:
        """The last line of the journal that tells how the run ended; {} when it was killed."""
        for entry in self.journal():
            if entry.get("event") == "end":
                return entry
        return {}

    @property
    def seconds(self) -> float:
        """Duration of the run; NaN when it was killed."""
        return float(self._ending.get("seconds", math.nan))

    @property
    def interrupted(self) -> bool:
        """Whether the run ended before its time, by Ctrl-C or by being killed."""
        return bool(self._ending.get("interrupted", True))

    def journal(self) -> Iterator[dict[str, Any]]:
        """Yield what happened, in order: the start, every episode (server, seconds, errors), the end."""
        try:
            lines = (self.path / "journal.jsonl").read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:
            return
        for line in lines:
            try:
                entry = json.loads(line)
            except ValueError:
                continue  # cut off when the run was killed
            if isinstance(entry, dict):
                yield entry

    @cached_property
    def record(self) -> Record:
        """Every evaluation of the finished generations, as arrays.

        Raises InputError when the file is damaged.
        """
        header, lines = self._record_lines()
        try:
            rows = [line.split(",") for line in lines]
            first_gene = 3 + sum(name.startswith("episode_") for name in header)
            return Record(
                np.array([int(row[0]) for row in rows], dtype=np.int64),
                np.array([int(row[1]) for row in rows], dtype=np.int64),
                np.array([float(row[2]) for row in rows], dtype=np.float64),
                np.array([row[3:first_gene] for row in rows], dtype=np.float64).reshape(
                    len(rows), first_gene - 3
                ),
                np.array([row[first_gene:] for row in rows], dtype=np.float32).reshape(
                    len(rows), len(header) - first_gene
                ),
            )
        except (ValueError, IndexError) as error:
            raise InputError(f"{self.path / 'record.csv'}: is damaged: {error}") from error

    def export(self, path: str | Path) -> None:
        """Write the record as CSV, a line per evaluation, sorted by generation and candidate.

        Columns: generation, candidate, fitness, episode_0, .. (its episodes' fitness), g0, .. (its genome).
        Raises InputError when the file cannot be written.
        """
        header, lines = self._record_lines()
        write_text(path, "".join(f"{line}\n" for line in (",".join(header), *lines)))

    def plot(self, path: str | Path | None = None) -> Path:
        """Draw fitness over generations as a PNG (default.

        Fitness.png in the run folder); return its path.
        """
        from swarmwright._plot import draw

        target = self.path / "fitness.png" if path is None else Path(path)
        draw(self, target)
        return target

    def _record_lines(self) -> tuple[list[str], list[str]]:
        """Return the record's columns and the lines of finished generations."""
        text = (self.path / "record.csv").read_text(encoding="utf-8", errors="replace")
        header, *lines = text.splitlines() or [""]
        missing = self.evaluations - len(lines)
        if missing > 0:
            file = self.path / "record.csv"
            raise InputError(f"{file}: is damaged: {missing} of {self.evaluations} evaluations are missing")
        return header.split(","), lines[: self.evaluations]

    def __repr__(self) -> str:
        """Name the folder and how far it got."""
        return f"<Run {self.path}: {self.generations} generations, {self.evaluations} evaluations>"


_WHOLE = frozenset({"generation", "evaluations", "failed"})


def _summary(row: dict[str, str]) -> Summary:
    values: dict[str, Any] = {
        name: int(value) if name in _WHOLE else float(value) for name, value in row.items()
    }
    return Summary(**values)


def _rows(file: Path) -> list[dict[str, str]]:
    """Return the complete lines of a CSV file; a last line without its end was cut off."""
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    return list(csv.DictReader(text[: text.rfind("\n") + 1].splitlines()))
