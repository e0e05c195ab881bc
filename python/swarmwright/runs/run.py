"""Read run folders, the results of optimizations."""

import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from operator import index
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, SupportsIndex, get_args

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arguments import check_arguments, flag, path_of
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.html import facts, picture, png_of
from swarmwright.common.processes import StablePath
from swarmwright.common.statistics import Summary
from swarmwright.controllers.controller import Controller
from swarmwright.experiment.budget import EndReason
from swarmwright.experiment.experiment import Experiment, load_stored_experiment
from swarmwright.experiment.settings import parameter_settings
from swarmwright.methods.rankings.race import RaceOptions
from swarmwright.methods.rankings.slow_simulation import METRIC, SlowOptions
from swarmwright.runs.annotations import read_annotations, write_annotations
from swarmwright.runs.export import write_table
from swarmwright.runs.failures import iterate_episode_counts
from swarmwright.runs.feasibility import violations_of
from swarmwright.runs.instances import best_words
from swarmwright.runs.store import Evaluation, StoreReader
from swarmwright.runs.store.folder import find_store
from swarmwright.runs.store.lock import is_locked
from swarmwright.runs.store.lookup import explain_missing_best
from swarmwright.runs.store.table import RecordTable
from swarmwright.servers.rows import Attempt, Event, FailureReason, ServerShare, Session
from swarmwright.simulations.user_code.trust import trusting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmwright.runs.elites import Elites
    from swarmwright.runs.matches import Champion
    from swarmwright.runs.metric_curves import Names
    from swarmwright.runs.page import ReplayPage
    from swarmwright.runs.post_evaluation import PostEvaluation
    from swarmwright.runs.transfer.transferred import Transferred
    from swarmwright.runs.validation import Validation
    from swarmwright.ui.notebook import NotebookWindow

State = Literal["done", "stopped", "running", "interrupted", "killed", "failed"]


@dataclass(frozen=True)
class Best:
    """The best candidate of a run; the first of equals."""

    fitness: float
    generation: int
    candidate: int
    """Index in its generation."""
    specification: dict[str, Any] = field(repr=False)
    """The controller as plain values."""

    @property
    def controller(self) -> Controller:
        """A new controller at the start of an episode, callable on numpy arrays."""
        return Controller(self.specification)


class Run:
    """The results of an optimization, in a folder.

    Returned by `swarmwright.optimize`, `Run.open(folder)` and `Run(folder)`. The folder has run.sqlite (all
    evaluations with their seeds, servers and errors), experiment.yaml (with all defaults), best.json (the
    best controller) and fitness.png. Killed and running runs can be opened, too.

    A run is a snapshot of the moment when it was opened: generations, sessions, attempts and validation that
    are added later do not appear; open it again with `Run.open(run.path)` to read them. Only `state`,
    `interrupted` and `ended` follow a run in progress, and `validation_is_due` and `transfer_is_due` describe
    the present folder. Two runs are equal only if they are the same object.
    """

    _values: dict[str, Any] | None = None
    """The experiment as plain values, if it is created from them later."""

    def __init__(self, path: str | os.PathLike[str], store: StoreReader | None = None) -> None:
        folder = path_of("path", path, "a run folder")
        self._place = StablePath(folder if store else find_store(folder))
        if store is None:
            with StoreReader.open_snapshot(self.path) as store:
                pass  # fixes the moment of the snapshot
        self._store = store
        """Reader of run.sqlite; private to this library."""

    @property
    def path(self) -> Path:
        """The folder as passed to the constructor, or absolute if the working directory has changed."""
        return self._place.path

    @classmethod
    def open(cls, path: str | os.PathLike[str], *, trust: bool = False) -> Self:
        """Open a run folder without executing any code in it.

        Args:
            path: path of the folder.
            trust: allow its simulation's code to be executed when candidates are evaluated or shown, although
                another user or machine made the run. The permission is remembered for this code.

        Raises InputError when `path` is not a run folder, or its store cannot be read.
        """
        flag("trust", trust)
        run = cls(path)
        with trusting() if trust else nullcontext():
            _ = run.history, run.experiment  # report errors early
        if trust:
            from swarmwright.runs.code import trust_code

            trust_code(run)
        return run

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment of the run."""
        return load_stored_experiment(self._store, self._values)

    @property
    def name(self) -> str:
        """Name of the experiment's file without its suffix, or else of the simulation."""
        return self._store.name

    @property
    def tags(self) -> tuple[str, ...]:
        """Words to find the run by, set by `annotate`. Raises InputError if their file is damaged."""
        return read_annotations(self.path).tags

    @property
    def note(self) -> str:
        """The user's note about the run, set by `annotate`. Raises InputError like `tags`."""
        return read_annotations(self.path).note

    @check_arguments
    def annotate(self, *, tags: Sequence[str] | None = None, note: str | None = None) -> None:
        """Set the run's tags or its note, in `notes.json` beside the record; None leaves them unchanged.

        Args:
            tags: at most 20 words of at most 50 characters, without commas.
            note: text of at most 10,000 characters.

        Raises InputError if they are invalid or cannot be written.
        """
        write_annotations(self.path, self.tags if tags is None else tags, self.note if note is None else note)

    @property
    def created(self) -> str:
        """Start of the run, ISO 8601, UTC."""
        return self._store.created

    @cached_property
    def history(self) -> list[Summary]:
        """Statistics of each finished generation."""
        return self._store.history()

    @property
    def best_words(self) -> str:
        """Description of the best fitness so far in `history`; with racing or `reevaluate` it can fall."""
        return best_words(self.experiment)

    @property
    def generations(self) -> int:
        """Number of finished generations."""
        return self._store.finished

    @property
    def evaluations(self) -> int:
        """Number of evaluated candidates."""
        return self.history[-1].evaluations if self.history else 0

    @property
    def failed_evaluations(self) -> int:
        """Number of evaluated candidates with at least one failed episode."""
        return sum(summary.failed for summary in self.history)

    @cached_property
    def failed_episodes(self) -> int:
        """Number of failed episodes in the record; if there are any, all evaluations are read."""
        if not self.failed_evaluations:
            return 0
        return sum(int(entry.failed.sum()) for entry in iterate_episode_counts(self))

    @cached_property
    def best(self) -> Best:
        """The best candidate. Raises RunError when no candidate was evaluated."""
        best = self._store.best()
        if best is None:
            raise RunError(explain_missing_best(self.path))
        from swarmwright.runs.code import restore_experiment

        experiment = restore_experiment(self, best.generation)
        specification = experiment.representation().specification(best.genome)
        return Best(best.fitness, best.generation, best.candidate, specification)

    def champions(self, side: str) -> "list[Champion]":
        """Return the best candidate of a side of a competition in each generation.

        Raises InputError if the run is not a competition, or has no such side.
        """
        from swarmwright.runs.matches import champions

        return champions(self, side)

    @cached_property
    def validation(self) -> "Validation | None":
        """The best candidates on held-out seeds, evaluated at the end of the run as set by `validate`.

        None if validation is switched off or not done yet, or the run is too short for it.
        """
        from swarmwright.runs.validation import load_run_validation

        return load_run_validation(self) if self.generations else None

    @cached_property
    def episodes_saved(self) -> int:
        """Episodes saved because a race dropped candidates (`ranking: race`)."""
        ranking = self.experiment.ranking
        if not isinstance(ranking, RaceOptions):
            return 0
        if ranking.failure_fitness is None:
            return self._store.episodes_left_out()
        return self.evaluations * ranking.episodes - sum(
            int(entry.episodes.sum()) for entry in iterate_episode_counts(self)
        )

    @cached_property
    def slow_evaluations(self) -> int:
        """Candidates successfully evaluated in the ranking's slow simulation."""
        return self._store.count_measured(METRIC) if isinstance(self.experiment.ranking, SlowOptions) else 0

    @property
    def audit(self) -> dict[str, int] | None:
        """Result of the audit at the end of the run; None without an audit. See `faults: {audit}`.

        Keys: `evaluations` and `episodes` that were compared, `elsewhere` (episodes repeated by another
        server), `failed` (episodes that failed in the repetition) and `differ` (evaluations with another
        result).
        """
        return self._store.audit()

    @property
    def validation_is_due(self) -> bool:
        """Whether the validation was interrupted, or is missing in a finished run; `resume` completes it.

        This describes the present folder, even if the run has continued since it was opened.
        """
        from swarmwright.runs.validation import is_due

        run = Run(self.path)
        if run.state != "done":
            stored = run._store.validation()
            return stored is not None and stored["state"] == "due"
        return is_due(run.experiment, run._store, changed=False)

    @cached_property
    def transferred(self) -> "tuple[Transferred, ...]":
        """The best candidates in the other simulations that `validate` names, evaluated at the run's end.

        One result for each simulation that was available, in the order of `validate`. To evaluate them in
        other simulations, without adding anything to the run, use `swarmwright.transfer(run, ..)`.
        """
        from swarmwright.runs.transfer.at_end import load_transfers

        return load_transfers(self) if self.generations else ()

    @property
    def transfer_is_due(self) -> bool:
        """Whether the run has ended without all simulations that `validate` names; `resume` adds them.

        This describes the present folder, even if the run has continued since it was opened.
        """
        from swarmwright.runs.transfer.at_end import is_due

        run = Run(self.path)
        if not run.experiment.validate.transfers or run.state not in {"done", "stopped"}:
            return False
        return is_due(run.experiment, run._store)

    @property
    def unseen(self) -> "PostEvaluation | None":
        """The candidate with the best recorded fitness on held-out seeds: `validation.best`.

        None without a validation, or if fitness does not depend on the seed.
        """
        validation = self.validation
        return None if validation is None or not validation.depends_on_seed else validation.best

    @cached_property
    def sessions(self) -> list[Session]:
        """Sessions of the run: the first process, and one more each time it was resumed."""
        return self._store.sessions()

    @property
    def state(self) -> State:
        """The state of the run.

        done: the budget is used up or the target is reached. stopped: a callback ended it. interrupted: by
        Ctrl-C or a closed output. killed: it ended without writing an outcome. failed: no server, a full
        disk, .. running: a process works on it. For a run that had not ended when it was opened, this is the
        present state, while the generations remain those of that moment.
        """
        outcome: Any = self._outcome
        if outcome is None:
            # Check the lock first, so that an outcome written in between is not missed.
            locked = is_locked(self.path)
            outcome = self._store.outcome()
            if outcome is None:
                return "running" if locked else "killed"
        state: State = outcome if outcome in get_args(State) else "failed"
        return state

    @property
    def _outcome(self) -> str | None:
        """Outcome of the last session when the run was opened."""
        return self.sessions[-1].outcome if self.sessions else None

    @property
    def ended(self) -> EndReason | None:
        """What ended a finished run: `generations`, `evaluations`, `seconds` or `target`; otherwise None."""
        ended: Any = self._store.find_end_reason(now=self._outcome is None) if self.state == "done" else ""
        return ended if ended in get_args(EndReason) else None

    @property
    def interrupted(self) -> bool:
        """Whether the run ended early: by Ctrl-C, a killed process, or a failure."""
        return self.state not in {"done", "stopped"}

    @property
    def ended_since_opened(self) -> bool:
        """Whether the run has ended since it was opened, so that this object lacks its last generations."""
        return self._outcome is None and not self.interrupted

    @property
    def seconds(self) -> float:
        """Total duration of all sessions; killed sessions count up to their last generation."""
        return math.fsum(session.seconds or 0.0 for session in self.sessions)

    @property
    def code(self) -> dict[int, str]:
        """SHA-256 of each version of user code copied into the folder, by number from 1 (code/1, ..)."""
        return self._store.code()

    def attempts(self) -> Iterator[Attempt]:
        """Yield attempts at evaluations, with server, time, duration and error.

        All attempts by servers and worker processes are recorded; in this process only failed ones.
        """
        return self._store.attempts()

    def events(self) -> Iterator[Event]:
        """Yield the warnings, in order."""
        return self._store.events()

    def servers(self) -> list[ServerShare]:
        """Return what each server did: evaluations, failures, seconds."""
        return self._store.servers()

    def failures(self) -> list[FailureReason]:
        """Return why attempts failed, the most frequent reason first, and on which servers."""
        return self._store.failures()

    @cached_property
    def record(self) -> RecordTable:
        """All evaluations of the finished generations, as arrays and as a mapping of table columns.

        `pandas.DataFrame(run.record)` has the columns that `export` writes.
        """
        return RecordTable(self._store.record(), self.metrics)

    @cached_property
    def fitness(self) -> NDArray[np.float64]:
        """(evaluations,) fitness of every evaluation in the order of the record.

        It is NaN for candidates that failed or violate constraints. Unlike `record`, this reads only the
        fitness.
        """
        return self._store.fitness()

    @cached_property
    def violations(self) -> NDArray[np.float64]:
        """(evaluations,) sum of violations of the experiment's constraints; 0 for feasible candidates.

        It is infinite if a metric has no value, as in failed episodes.
        """
        return violations_of(self)

    @check_arguments
    def evaluation(
        self, candidate: SupportsIndex | None = None, generation: SupportsIndex | None = None
    ) -> Evaluation:
        """Return an evaluation from the record, by default the best of the run.

        Args:
            candidate: index in `generation`, by default of its best candidate; without a generation, the
                number of the evaluation in the whole run, from 0.
            generation: from 0.

        Raises InputError when the evaluation does not exist, RunError when the record is empty.
        """
        return self._store.evaluation(candidate, generation)

    @check_arguments
    def seeds(self, generation: int) -> list[int]:
        """Return the simulation seed of each episode of a generation. Raises InputError if it is missing."""
        return self._store.seeds(generation)

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics in the record."""
        return self._store.metrics

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the record in hexadecimal; equal records have equal digests.

        It is the digest of the last generation, which includes those of all generations before.
        """
        return self._store.digest()

    @cached_property
    def elites(self) -> "Elites":
        """The archive of `map_elites` and `novelty`, or the front of `nsga2` or `nsga3`.

        Raises InputError for other methods.
        """
        from swarmwright.runs.elites import compute_elites

        return compute_elites(self)

    @check_arguments
    def export(self, path: str | PathLike[str]) -> None:
        """Write the record as a table with a row per evaluation, sorted by generation and candidate.

        `.csv` has the columns generation, candidate, fitness, episode_0, .. (fitness of the episodes), then
        metrics if there are any (name_0, ..), then g0, .. (the genome). A metric with the name of another
        column, such as episode, becomes metric_episode. `.parquet` has the same columns, with lists for
        episodes, genome and each metric; it needs `pip install 'swarmwright[parquet]'`.
        Raises InputError when the file cannot be written.
        """
        write_table(self._store, Path(path))

    @check_arguments
    def plot(
        self,
        path: str | PathLike[str] | None = None,
        *,
        x: str = "evaluations",
        metrics: "Names | None" = None,
        style: str = "screen",
        width: str | float | None = None,
        title: str | None = None,
    ) -> "Figure":
        """Draw fitness and diversity, or metrics; return the matplotlib figure, which a notebook shows.

        Args:
            path: file to write (.png, .svg or .pdf); by default none.
            x: "evaluations" or "generations".
            metrics: draw fitness and these metrics instead, to compare good and poor candidates: names of
                recorded metrics, or "all". Each has a line for the best candidate of a generation, and for
                the means of the best quarter, the middle half and the worst quarter by fitness.
            style: "screen", or a publisher's column widths, fonts and sizes, without a title: "ieee",
                "nature", "science", "acm", "elsevier" or "springer".
            width: "column" (the default) or "page" of the style, inches, or a length such as "89 mm".
            title: replaces the figure's title; "" for none.

        Raises InputError when the run has no finished generation or lacks a metric, for an unknown style,
        width or file type, or when the file cannot be written.
        """
        from swarmwright.display.figures.style import Page, check_figure_path, save, use_page

        if path is not None:
            check_figure_path(Path(path))
        if not self.history:
            raise InputError(f"{self.path}: has no finished generation to draw")
        with use_page(Page.from_options(style, width, title)):
            figure = self._figure(x, metrics)
        if path is not None:
            save(figure, Path(path))
        return figure

    def _figure(self, x: str, metrics: "Names | None") -> "Figure":
        """Draw the figure of `plot` for the present page."""
        if metrics is not None:
            from swarmwright.display.figures import metrics as drawing
            from swarmwright.runs.metric_curves import MetricCurves, select_names

            return drawing.draw(self, MetricCurves(self, select_names([self], metrics)), x=x)
        from swarmwright.display.figures.run import draw
        from swarmwright.runs.diversity import diversity

        return draw(self, diversity(self), x=x)

    @check_arguments
    def replay(
        self,
        *,
        generation: int | None = None,
        candidate: int | None = None,
        match: Sequence[int] = (),
        episode: int | None = None,
        seed: SupportsIndex | None = None,
        parameters: Mapping[str, Any] | None = None,
        most_bodies: int | None = None,
        speed: float = 1.0,
        broker: str | None = None,
    ) -> "ReplayPage":
        """Replay an episode; return a page with its animation, which a notebook displays.

        Args:
            generation: generation of the candidate, from 0; as in `evaluation`.
            candidate: as in `evaluation`; by default the best.
            match: generation of the champion of each side of a competition, in place of a candidate.
            episode: index of an episode of the run, by default 0; of a match, as `measure_progress` counts.
            seed: simulation seed, for an episode that is not in the run.
            parameters: other values for parameters of the simulation, with keys such as `robots` or
                `robot.drive.noise`.
            most_bodies: refuse an episode with more bodies in all scenes together, where a scene counts as
                50 bodies at least.
            speed: initial speed of the animation, as a multiple of the simulated time.
            broker: compute the episode on a server on this broker that has scenes, for simulations that are
                not installed here.

        Raises InputError when the simulation is not installed and no broker is known, or the candidate or
        episode does not exist, or the simulation refuses a parameter; RunError when no server shows it.
        """
        from swarmwright.runs.page import ReplayPage

        if speed <= 0:
            raise InputError(f"speed: must be greater than 0, not {speed}")
        return ReplayPage.of(
            self,
            generation=generation,
            candidate=candidate,
            match=match,
            episode=episode,
            seed=None if seed is None else index(seed),
            settings=parameter_settings(parameters or {}),
            most_bodies=most_bodies,
            speed=speed,
            broker=broker,
        )

    def ui(
        self,
        *,
        read_only: bool = True,
        frame_ancestors: str | Sequence[str] | None = None,
        base: str = "",
        hosts: Collection[str] = (),
    ) -> "NotebookWindow":
        """Show the run in the window of `swarmwright ui`, which this process serves until it ends.

        A notebook shows the result as a frame; elsewhere, open its `address`. The next call returns the same
        window.

        Args:
            read_only: refuse what changes the run.
            frame_ancestors: origins of the pages that may show the window in a frame, as
                `https://hub.example`. Default: `http://localhost:*` and `http://127.0.0.1:*`.
            base: address under which the browser reaches it, if that is not this machine: with
                jupyter-server-proxy on a hub `/user/ada/proxy/{port}/`, where `{port}` is replaced.
            hosts: with `base`, names of the host in the browser's address.

        Raises InputError when an origin is invalid, or the libraries of the extra `ui` are missing.
        """
        # Imported dynamically, since the package `runs` must not depend on `ui`.
        notebook = import_module("swarmwright.ui.notebook")
        window: NotebookWindow = notebook.show(
            self.path,
            read_only=read_only,
            frame_ancestors=notebook.LOOPBACK if frame_ancestors is None else frame_ancestors,
            base=base,
            hosts=hosts,
        )
        return window

    def _repr_html_(self) -> str:
        """Return a summary with the fitness curve, for notebooks."""
        experiment = self.experiment
        rows: list[tuple[str, object]] = [
            ("simulation", experiment.label),
            ("method", experiment.to_mapping()["method"]["kind"]),
            ("controller", experiment.controller.kind),
            ("seed", experiment.seed),
            ("state", self.state),
            ("done", f"{self.generations:,} generations, {self.evaluations:,} evaluations"),
        ]
        if self.failed_evaluations:
            rows.append(("failed", f"{self.failed_evaluations:,} evaluations"))
        if not self.history:
            return facts(f"Run {self.path}", rows)
        best = self.best
        position = f"generation {best.generation}, candidate {best.candidate}, both from 0"
        rows.append(("best fitness", f"{best.fitness + 0.0:.6g} ({position})"))
        if self.unseen is not None:
            held_out, count = self.unseen.fitness, len(self.unseen.episodes)
            interval = ""
            if held_out.low is not None:
                interval = f", 95 % confidence interval {held_out.low:.4g} to {held_out.high:.4g}"
            failed = f", {self.unseen.failed_words}" if self.unseen.failed else ""
            rows.append(("on held-out seeds", f"{held_out.mean:.4g} ({count} episodes{failed}{interval})"))
        for transfer in self.transferred:
            fitness_there, loss = transfer.target_fitness[0], transfer.losses[0]
            text = f"{fitness_there.mean:.4g}; loses {loss.mean:.4g}"
            if loss.low is not None:
                text = f"{text}, 95 % confidence interval {loss.low:.4g} to {loss.high:.4g}"
            rows.append((f"in {transfer.target}", f"{text} ({transfer.source_episodes.shape[1]} episodes)"))
        from swarmwright.display.figures.run import fitness

        return facts(f"Run {self.path}", rows) + picture(
            png_of(fitness(self)), 540, "fitness over generations"
        )

    def __repr__(self) -> str:
        """Return the folder and its numbers of generations and evaluations."""
        return f"<Run {self.path}: {self.generations} generations, {self.evaluations} evaluations>"


def open_run(run: Run | str | os.PathLike[str]) -> Run:
    """Return a run, or open its folder. Raises InputError as `Run.open`."""
    return run if isinstance(run, Run) else Run.open(run)


def open_written_run(path: Path) -> Run:
    """Open the folder of a run that this process has written, and read its content only when needed."""
    with StoreReader.open_snapshot(path) as store:
        run = Run(path, store)
        run._values = store.experiment()
    return run
