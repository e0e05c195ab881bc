"""Reading run folders: what an optimization left behind."""

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self, get_args

from swarmwright._controller import Controller
from swarmwright._errors import InputError, RunError
from swarmwright._experiment import Experiment
from swarmwright._export import csv_lines, write_table
from swarmwright._statistics import Summary
from swarmwright._store import FILE, Attempt, Evaluation, Event, Record, Session, StoreReader
from swarmwright._store._reader import nothing

State = Literal["done", "stopped", "running", "interrupted", "killed", "failed"]


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


class Run:
    """An optimization's results, in a folder.

    Made by `swarmwright.optimize` or `Run.open(folder)`. The files: run.sqlite (every evaluation and how it
    came about), experiment.yaml (every default written out), best.json (the best controller) and
    fitness.png. A run that was killed can be opened too, and one that still goes on; it holds all generations
    that were finished when it was opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.store = StoreReader(path)
        """What run.sqlite holds, table by table."""

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open a run folder. Raises InputError when `path` is none, or when its store cannot be read."""
        folder = Path(path)
        if not folder.is_dir():
            what = "is not a folder" if folder.exists() else "there is no such folder"
            raise InputError(f"{folder}: {what}; name a run folder such as runs/minisim-1")
        if not (folder / FILE).is_file():
            from swarmwright._store._writer import without_store

            raise without_store(folder)
        run = cls(folder)
        _ = run.history, run.experiment  # complain now rather than later
        return run

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment as it was run."""
        try:
            experiment = Experiment._stored(self.store.experiment())
        except InputError as error:
            raise InputError(f"{self.path}: the experiment in {FILE} cannot be used: {error}") from error
        object.__setattr__(experiment, "path", self.path / "experiment.yaml")
        return experiment

    @property
    def name(self) -> str:
        """What the experiment's file was called, or else its simulation."""
        return self.store.name

    @property
    def created(self) -> str:
        """When it was started, ISO 8601, UTC."""
        return self.store.created

    @cached_property
    def history(self) -> list[Summary]:
        """The figures of each finished generation."""
        return self.store.history()

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
        best = self.store.best()
        if best is None:
            raise RunError(nothing(self.path))
        specification = self.experiment.representation().specification(best.genome)
        return Best(best.fitness, best.generation, best.candidate, specification)

    @cached_property
    def sessions(self) -> list[Session]:
        """Who worked on it: the first process, then one for each time that it was resumed."""
        return self.store.sessions()

    @property
    def state(self) -> State:
        """How it stands.

        done: the budget is used or the target reached; stopped: a callback ended it; interrupted: Ctrl-C did;
        killed: it ended without a word; failed: no server, a full disk, ..; running: a process works on it.
        """
        from swarmwright._store._writer import is_locked

        outcome: Any = self.sessions[-1].outcome if self.sessions else None
        if outcome is None:
            return "running" if is_locked(self.path) else "killed"
        state: State = outcome if outcome in get_args(State) else "failed"
        return state

    @property
    def interrupted(self) -> bool:
        """Whether it ended before its time: by Ctrl-C, by being killed, or by a failure."""
        return self.state not in {"done", "stopped"}

    @property
    def seconds(self) -> float:
        """Duration of all sessions together; what a killed one did after its last generation is not known."""
        return math.fsum(session.seconds or 0.0 for session in self.sessions)

    def attempts(self) -> Iterator[Attempt]:
        """Yield every attempt at evaluations: which server, when, how long, what went wrong."""
        return self.store.attempts()

    def events(self) -> Iterator[Event]:
        """Yield what was worth a warning, in order."""
        return self.store.events()

    @cached_property
    def record(self) -> Record:
        """Every evaluation of the finished generations, as arrays."""
        return self.store.record()

    def evaluation(self, candidate: int | None = None, generation: int | None = None) -> Evaluation:
        """Return one line of the record.

        Args:
            candidate: index among the candidates evaluated in `generation`, the best of them if not given;
                without a generation, the number of the evaluation in the whole run, from 0.
            generation: from 0. Without both, the best of the run is returned.

        Raises InputError when there is none of that number, RunError when there is nothing at all.
        """
        return self.store.evaluation(candidate, generation)

    def seeds(self, generation: int) -> list[int]:
        """Return the simulation seed of each episode of a generation. Raises InputError without that one."""
        return self.store.seeds(generation)

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics in the record."""
        return self.store.metrics

    @cached_property
    def digest(self) -> str:
        """SHA-256, in hexadecimal, of the record as `export` writes it: the same for the same results."""
        text = hashlib.sha256()
        for line in csv_lines(self.store):
            text.update(line.encode())
        return text.hexdigest()

    def export(self, path: str | Path) -> None:
        """Write the record as a table, a line per evaluation, sorted by generation and candidate.

        `.csv`: generation, candidate, fitness, episode_0, .. (its episodes' fitness), then metrics if there
        are any (name_0, ..), then g0, .. (its genome). `.parquet`: the same with lists in the columns
        episodes and genome and in those of the metrics; this needs `pip install swarmwright[parquet]`.
        Raises InputError when the file cannot be written.
        """
        write_table(self.store, Path(path))

    def plot(self, path: str | Path | None = None) -> Path:
        """Draw fitness over generations as a PNG; return its path, by default fitness.png in the folder."""
        from swarmwright._plot import draw

        target = self.path / "fitness.png" if path is None else Path(path)
        draw(self, target)
        return target

    def __repr__(self) -> str:
        """Name the folder and how far it got."""
        return f"<Run {self.path}: {self.generations} generations, {self.evaluations} evaluations>"
