"""Reading run folders, the results of optimizations."""

import math
import os
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from operator import index
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, SupportsIndex, get_args

from swarmwright.common.arguments import check_arguments, flag, path_of
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.html import facts, picture, png_of
from swarmwright.common.processes import StablePath
from swarmwright.common.statistics import Summary
from swarmwright.controllers.controller import Controller
from swarmwright.experiment.budget import Ended
from swarmwright.experiment.experiment import Experiment, stored_experiment
from swarmwright.methods.rankings.race import RaceOptions
from swarmwright.methods.rankings.slow_simulation import METRIC, SlowOptions
from swarmwright.runs.export import write_table
from swarmwright.runs.failures import taken
from swarmwright.runs.instances import best_words
from swarmwright.runs.store import Evaluation, StoreReader
from swarmwright.runs.store.folder import find_store
from swarmwright.runs.store.lock import is_locked
from swarmwright.runs.store.lookup import nothing
from swarmwright.runs.store.table import RecordTable
from swarmwright.servers.rows import Attempt, Event, FailureReason, ServerShare, Session
from swarmwright.simulations.user_code.trust import trusting

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from swarmwright.runs.elites import Elites
    from swarmwright.runs.metric_curves import Names
    from swarmwright.runs.page import ReplayPage
    from swarmwright.runs.post_evaluation import PostEvaluation
    from swarmwright.runs.transfer.transferred import Transferred
    from swarmwright.runs.validation import Validation

State = Literal["done", "stopped", "running", "interrupted", "killed", "failed"]


@dataclass(frozen=True)
class Best:
    """The best candidate of a run; of equals, the first."""

    fitness: float
    generation: int
    candidate: int
    """Index among the candidates evaluated in that generation."""
    specification: dict[str, Any] = field(repr=False)
    """The controller as plain values."""

    @property
    def controller(self) -> Controller:
        """A new controller at the start of an episode, callable on numpy arrays."""
        return Controller(self.specification)


class Run:
    """An optimization's results, in a folder.

    Made by `swarmwright.optimize`, `Run.open(folder)` or `Run(folder)`. The files: run.sqlite (every
    evaluation with its seeds, servers and errors), experiment.yaml (every default written out), best.json
    (the best controller) and fitness.png. A run that was killed can be opened too, and one that still
    goes on.

    All of it is as it was when it was opened, whatever is added later: generations, sessions, attempts,
    validation. Only `state`, and with it `interrupted` and `ended`, tell of a run that goes on what has
    become of it; `validation_is_due` and `transfer_is_due` say what is missing now. `Run.open(run.path)` has
    what was added. Two of these objects are equal when they are the same object.
    """

    _values: dict[str, Any] | None = None
    """The experiment as plain values, where it is made of them later."""

    def __init__(self, path: str | os.PathLike[str], store: StoreReader | None = None) -> None:
        folder = path_of("path", path, "a run folder")
        self._place = StablePath(folder if store else find_store(folder))
        if store is None:
            with StoreReader.opened(self.path) as store:
                pass  # it keeps to this moment
        self._store = store
        """What run.sqlite holds, table by table; for this library only."""

    @property
    def path(self) -> Path:
        """The folder: as it was given, or absolute where the working folder has changed since."""
        return self._place.path

    @classmethod
    def open(cls, path: str | os.PathLike[str], *, trust: bool = False) -> Self:
        """Open a run folder, which runs no code of it.

        Args:
            path: of the folder.
            trust: execute its simulation's code when it is evaluated or shown, although it is not of a run
                that this user has made here. It is remembered for this code.

        Raises InputError when `path` is not a run folder, or when its store cannot be read.
        """
        flag("trust", trust)
        run = cls(path)
        with trusting() if trust else nullcontext():
            _ = run.history, run.experiment  # report errors now rather than later
        if trust:
            from swarmwright.runs.code import trust_code

            trust_code(run)
        return run

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment as it was run."""
        return stored_experiment(self._store, self._values)

    @property
    def name(self) -> str:
        """What the experiment's file was called, or else its simulation."""
        return self._store.name

    @property
    def created(self) -> str:
        """When it was started, ISO 8601, UTC."""
        return self._store.created

    @cached_property
    def history(self) -> list[Summary]:
        """The figures of each finished generation."""
        return self._store.history()

    @property
    def best_words(self) -> str:
        """What the best fitness so far of `history` is, in words: with racing or `reevaluate` it can fall."""
        return best_words(self.experiment)

    @property
    def generations(self) -> int:
        """Finished generations."""
        return self._store.finished

    @property
    def evaluations(self) -> int:
        """Evaluated candidates."""
        return self.history[-1].evaluations if self.history else 0

    @property
    def failed_evaluations(self) -> int:
        """Evaluated candidates of which at least one episode failed."""
        return sum(summary.failed for summary in self.history)

    @cached_property
    def failed_episodes(self) -> int:
        """Episodes of the record that failed; where there are any, every evaluation is read."""
        if not self.failed_evaluations:
            return 0
        return sum(int(entry.failed.sum()) for entry in taken(self))

    @cached_property
    def best(self) -> Best:
        """The best candidate. Raises RunError when no candidate was evaluated."""
        best = self._store.best()
        if best is None:
            raise RunError(nothing(self.path))
        from swarmwright.runs.code import of_generation

        experiment = of_generation(self, best.generation)
        specification = experiment.representation().specification(best.genome)
        return Best(best.fitness, best.generation, best.candidate, specification)

    @cached_property
    def validation(self) -> "Validation | None":
        """The best candidates on held-out seeds, evaluated when the run ended, as `validate` says.

        None where that is switched off or has not been done, and of runs that are too short for it.
        """
        from swarmwright.runs.validation import of_run

        return of_run(self) if self.generations else None

    @cached_property
    def episodes_saved(self) -> int:
        """Episodes that candidates did not go through because a race had dropped them: `ranking: race`."""
        ranking = self.experiment.ranking
        if not isinstance(ranking, RaceOptions):
            return 0
        if ranking.failure_fitness is None:
            return self._store.episodes_left_out()
        return self.evaluations * ranking.episodes - sum(int(entry.episodes.sum()) for entry in taken(self))

    @cached_property
    def slow_evaluations(self) -> int:
        """Candidates that were evaluated in the ranking's slow simulation as well, but for failed ones."""
        return self._store.measured(METRIC) if isinstance(self.experiment.ranking, SlowOptions) else 0

    @property
    def audit(self) -> dict[str, int] | None:
        """How many evaluations were repeated when the run ended, and how they came out; None for none.

        `evaluations` and `episodes` that were compared, `elsewhere`, how many of these episodes another
        server repeated, `failed`, how many failed when they were repeated, and `differ`, how many evaluations
        came out differently. See `faults: {audit}`.
        """
        return self._store.audit()

    @property
    def validation_is_due(self) -> bool:
        """Whether the validation was interrupted, or a run that is done lacks it: `resume` does it.

        As the run is now, also where it has gone on since it was opened.
        """
        from swarmwright.runs.validation import is_due

        run = Run(self.path)
        if run.state != "done":
            stored = run._store.validation()
            return stored is not None and stored["state"] == "due"
        return is_due(run.experiment, run._store, changed=False)

    @cached_property
    def transferred(self) -> "tuple[Transferred, ...]":
        """The best candidates in the other simulations that `validate` names, evaluated when the run ended.

        One for each simulation that could be reached, in the order of `validate`.
        `swarmwright.transfer(run, ..)` evaluates them in others, without adding anything to the run.
        """
        from swarmwright.runs.transfer.at_end import of_run

        return of_run(self) if self.generations else ()

    @property
    def transfer_is_due(self) -> bool:
        """Whether the run has ended and simulations that `validate` names are missing: `resume` does them.

        As the run is now, also where it has gone on since it was opened.
        """
        from swarmwright.runs.transfer.at_end import is_due

        run = Run(self.path)
        if not run.experiment.validate.transfers or run.state not in {"done", "stopped"}:
            return False
        return is_due(run.experiment, run._store)

    @property
    def unseen(self) -> "PostEvaluation | None":
        """The candidate with the best recorded fitness, evaluated on held-out seeds: `validation.best`.

        None where it has not been, or fitness depends on no seed.
        """
        validation = self.validation
        return None if validation is None or not validation.depends_on_seed else validation.best

    @cached_property
    def sessions(self) -> list[Session]:
        """Its sessions: the first process, then one for each time that it was resumed."""
        return self._store.sessions()

    @property
    def state(self) -> State:
        """The state of the run.

        done: the budget is used or the target reached; stopped: a callback ended it;
        interrupted: Ctrl-C or a closed output did; killed: it ended without writing an outcome; failed: no
        server, a full disk, ..; running: a process works on it. Of a run that had not ended when it was
        opened, this is its present state; the generations remain those that were finished then.
        """
        outcome: Any = self._outcome
        if outcome is None:
            # First the lock: an outcome that is written in between is not missed then.
            locked = is_locked(self.path)
            outcome = self._store.outcome()
            if outcome is None:
                return "running" if locked else "killed"
        state: State = outcome if outcome in get_args(State) else "failed"
        return state

    @property
    def _outcome(self) -> str | None:
        """How its last session had ended when it was opened."""
        return self.sessions[-1].outcome if self.sessions else None

    @property
    def ended(self) -> Ended | None:
        """What ended a run that is done: `generations`, `evaluations`, `seconds` or `target`; else None."""
        ended: Any = self._store.ended(now=self._outcome is None) if self.state == "done" else ""
        return ended if ended in get_args(Ended) else None

    @property
    def interrupted(self) -> bool:
        """Whether it ended before its time: by Ctrl-C, by being killed, or by a failure."""
        return self.state not in {"done", "stopped"}

    @property
    def ended_since_opened(self) -> bool:
        """Whether it has ended since it was opened, so that this object lacks its last generations."""
        return self._outcome is None and not self.interrupted

    @property
    def seconds(self) -> float:
        """Duration of all sessions together, of one without an outcome up to its last generation."""
        return math.fsum(session.seconds or 0.0 for session in self.sessions)

    @property
    def code(self) -> dict[int, str]:
        """SHA-256 of each version of the source that was copied into the folder, from 1 on; in code/1, .."""
        return self._store.code()

    def attempts(self) -> Iterator[Attempt]:
        """Yield attempts at evaluations: which server, when, how long, what went wrong.

        All of those by servers and worker processes; in this process, of evaluations that failed.
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
        """Every evaluation of the finished generations: arrays, and a mapping of the columns of a table.

        `pandas.DataFrame(run.record)` has the columns that `export` writes.
        """
        return RecordTable(self._store.record(), self.metrics)

    @cached_property
    def fitness(self) -> "NDArray[np.float64]":
        """(evaluations,) fitness of every evaluation in the order of the record, NaN where it failed.

        `record` has it, too; this reads nothing else.
        """
        return self._store.fitness()

    @check_arguments
    def evaluation(
        self, candidate: SupportsIndex | None = None, generation: SupportsIndex | None = None
    ) -> Evaluation:
        """Return one line of the record.

        Args:
            candidate: index among the candidates evaluated in `generation`, the best of them if not given;
                without a generation, the number of the evaluation in the whole run, from 0.
            generation: from 0. Without both, the best of the run is returned.

        Raises InputError when there is no such evaluation, RunError when there is nothing at all.
        """
        return self._store.evaluation(candidate, generation)

    @check_arguments
    def seeds(self, generation: int) -> list[int]:
        """Return the simulation seed of each episode of a generation. Raises InputError without that one."""
        return self._store.seeds(generation)

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics in the record."""
        return self._store.metrics

    @cached_property
    def digest(self) -> str:
        """SHA-256, in hexadecimal, of the record: the same for the same results.

        It is that of the last generation in the store, which goes on from those of all generations before.
        """
        return self._store.digest()

    @cached_property
    def elites(self) -> "Elites":
        """The archive of `map_elites`, or the front of `nsga2`. Raises InputError for other methods."""
        from swarmwright.runs.elites import of_run

        return of_run(self)

    @check_arguments
    def export(self, path: str | PathLike[str]) -> None:
        """Write the record as a table, a line per evaluation, sorted by generation and candidate.

        `.csv`: generation, candidate, fitness, episode_0, .. (its episodes' fitness), then metrics if there
        are any (name_0, ..), then g0, .. (its genome). A metric that is called like another column, such as
        episode, is metric_episode. `.parquet`: the same with lists in the columns
        episodes and genome and in those of the metrics; this needs `pip install 'swarmwright[parquet]'`.
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
        """Return a matplotlib figure of fitness and diversity, or of metrics, which a notebook shows.

        Args:
            path: where it is written as well (.png, .svg or .pdf); without it, nothing is.
            x: "evaluations" or "generations".
            metrics: draw fitness and these instead, to see what good and poor candidates do: names of metrics
                that the run has recorded, or "all". Each has lines of the best candidate of a generation, and
                of the means of the best quarter, the middle half and the worst quarter by fitness.
            style: "screen", or a publisher's: "ieee", "nature", "science", "acm", "elsevier" or "springer",
                with the widths of its columns, its fonts and sizes, and without a title.
            width: "column" (the default) or "page" of the style, inches, or a length such as "89 mm".
            title: instead of the figure's own; "" for none.

        Raises InputError when the run has no finished generation or has not recorded a metric, for another
        style, width or ending, or when the file cannot be written.
        """
        from swarmwright.display.figures.style import Page, check, on, save

        if path is not None:
            check(Path(path))
        if not self.history:
            raise InputError(f"{self.path}: holds no finished generation to draw")
        with on(Page.of(style, width, title)):
            figure = self._figure(x, metrics)
        if path is not None:
            save(figure, Path(path))
        return figure

    def _figure(self, x: str, metrics: "Names | None") -> "Figure":
        """Return the figure of `plot` for the present page."""
        if metrics is not None:
            from swarmwright.display.figures import metrics as drawing
            from swarmwright.runs.metric_curves import MetricCurves, names_of

            return drawing.draw(self, MetricCurves(self, names_of([self], metrics)), x=x)
        from swarmwright.display.figures.run import draw
        from swarmwright.runs.diversity import diversity

        return draw(self, diversity(self), x=x)

    @check_arguments
    def replay(
        self,
        *,
        generation: int | None = None,
        candidate: int | None = None,
        episode: int | None = None,
        seed: SupportsIndex | None = None,
        speed: float = 1.0,
        broker: str | None = None,
    ) -> "ReplayPage":
        """Play an episode again; return the page that shows it, which a notebook displays.

        Args:
            generation: of the candidate, from 0; as in `evaluation`.
            candidate: as in `evaluation`; default: the best one.
            episode: one of the run's, default 0.
            seed: of the simulation, for an episode that the run did not have.
            speed: how many times faster than the simulation's step size it plays at first.
            broker: a server on it that has scenes computes the episode, as for a simulation that is not here.

        Raises InputError when the simulation is not here and no broker is known, or there is no such
        candidate or episode; RunError when no server shows it.
        """
        from swarmwright.runs.page import ReplayPage

        if speed <= 0:
            raise InputError(f"speed: must be greater than 0, not {speed}")
        return ReplayPage.of(
            self,
            generation=generation,
            candidate=candidate,
            episode=episode,
            seed=None if seed is None else index(seed),
            speed=speed,
            broker=broker,
        )

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
        where = f"generation {best.generation}, candidate {best.candidate}, both from 0"
        rows.append(("best fitness", f"{best.fitness + 0.0:.6g} ({where})"))
        if self.unseen is not None:
            held_out, count = self.unseen.fitness, len(self.unseen.episodes)
            interval = ""
            if held_out.low is not None:
                interval = f", 95 % confidence interval {held_out.low:.4g} to {held_out.high:.4g}"
            failed = f", {self.unseen.failed_words}" if self.unseen.failed else ""
            rows.append(("on held-out seeds", f"{held_out.mean:.4g} ({count} episodes{failed}{interval})"))
        for transfer in self.transferred:
            there, lost = transfer.target_fitness[0], transfer.losses[0]
            interval = f"{there.mean:.4g}; loses {lost.mean:.4g}"
            if lost.low is not None:
                interval = f"{interval}, 95 % confidence interval {lost.low:.4g} to {lost.high:.4g}"
            rows.append(
                (f"in {transfer.target}", f"{interval} ({transfer.source_episodes.shape[1]} episodes)")
            )
        from swarmwright.display.figures.run import fitness

        return facts(f"Run {self.path}", rows) + picture(
            png_of(fitness(self)), 540, "fitness over generations"
        )

    def __repr__(self) -> str:
        """Name the folder and how far it got."""
        return f"<Run {self.path}: {self.generations} generations, {self.evaluations} evaluations>"


def run_of(given: Run | str | os.PathLike[str]) -> Run:
    """Return a run that is given as such, or as its folder. Raises InputError as `Run.open`."""
    return given if isinstance(given, Run) else Run.open(given)


def written_run(path: Path) -> Run:
    """Open the folder of a run that this process has written: what is in it is read when it is needed."""
    with StoreReader.opened(path) as store:
        run = Run(path, store)
        run._values = store.experiment()
    return run
