"""Validation: a run's best candidates on held-out seeds, when it has ended.

What is stored of it is apart from the record: `state`, `seeds`, `seen`, `metrics`, and `candidates` with
their fitness of each episode; `start`, the controller that the method's first sample was drawn around, where
there was one. The state is `due` (under way, with the episodes so far), `done`, `same`
(fitness does not depend on the seed) or `none` (switched off, or the run was too short).
"""

import dataclasses
import json
import logging
import math
import shlex
import time
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genome
from swarmwright.common.errors import InputError
from swarmwright.common.files import write_text
from swarmwright.common.html import table
from swarmwright.common.statistics import Estimate, estimate
from swarmwright.common.warn_once import warn_once
from swarmwright.controllers import Representation
from swarmwright.experiment.derived import reports_slow
from swarmwright.experiment.document import AUTO
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.start_from import samples_around_start, start_genomes
from swarmwright.experiment.targets import slow_of
from swarmwright.experiment.unavailable import unreadable
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.rankings.race import RaceOptions
from swarmwright.methods.rankings.slow_simulation import METRIC
from swarmwright.runs.instances import by_instance
from swarmwright.runs.post_evaluation import (
    EPISODES,
    ControllerEvaluation,
    PostEvaluation,
    evaluated,
    finite,
    numbers,
    stored_controller_evaluation,
    stored_post_evaluation,
    unseen_seeds,
)
from swarmwright.runs.store import Evaluation, StoreReader
from swarmwright.runs.store.table import column_of
from swarmwright.servers.evaluation.base import Backend, Progress

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

_SHARE = 0.05  # of a run's episodes, at most, are spent on validating its best with `episodes: auto`
_LEAST = 10  # episodes; fewer are not informative
_TRIED = 20
"""Episodes after which it is decided whether fitness depends on the seed, where their number is auto."""
_PARTS = 20  # at most, in which the other episodes are evaluated and stored
_PART = 25  # episodes of each candidate, at least, in one of them

_LONG_S = 5.0
"""Seconds from which on a validation is announced."""
progress = logging.getLogger("swarmwright.progress")

Keep = Callable[[dict[str, Any]], None]


@dataclass(frozen=True, kw_only=True, repr=False)
class Validation:
    """A run's best candidates in the same episodes, those of `seeds`, with held-out seeds.

    Fitness is in the units of the simulation, more is better; NaN where an episode failed.
    """

    candidates: list[PostEvaluation]
    """The best of the run, then the next best ones with other controllers, by their fitness in the record;
    never empty."""
    depends_on_seed: bool
    """Whether fitness depends on the seed, as far as it was tried. If not, candidates have the episodes of
    this trial alone."""
    by_instance: bool = False
    """True for the method racing: recorded fitness is the mean over all instances (one in each generation) on
    which the candidate had been evaluated."""
    slow: str | None = None
    """Name of the slow simulation of the ranking, where the candidates were evaluated in that one."""
    start: ControllerEvaluation | None = None
    """The controller that the method's first sample was drawn around, which is not a candidate of the run.
    None where there is no such controller."""

    def __repr__(self) -> str:
        """Say how good the best of the run is."""
        count = len(self.candidates)
        candidates = f"{count} candidate{'' if count == 1 else 's'}"
        return f"<Validation of {candidates}; the best, {self.best.label}: mean fitness {self.best.result}>"

    def _repr_html_(self) -> str:
        """Return the candidates as a table, for notebooks."""
        rows = [
            (candidate.label, f"{candidate.recorded + 0.0:.6g}", candidate.result)
            for candidate in self.candidates
        ]
        if self.start is not None:
            rows.append(("start", "", self.start.result))
        return table(("candidate", "recorded fitness", "mean fitness on held-out seeds"), rows)

    @property
    def best(self) -> PostEvaluation:
        """The best of the run, by its fitness in the record."""
        return self.candidates[0]

    @property
    def failed(self) -> int:
        """Episodes that failed, of all candidates."""
        return sum(candidate.failed for candidate in self.candidates)

    @property
    def leading(self) -> PostEvaluation:
        """The candidate with the highest fitness on the held-out seeds; of equals, the first.

        One whose mean leaves failed episodes out comes after all others.
        """
        return max(
            self.candidates,
            key=lambda candidate: (
                candidate.is_reportable,
                math.isfinite(candidate.fitness.mean),
                candidate.fitness.mean,
            ),
        )

    @property
    def lead(self) -> Estimate | None:
        """How much `leading` is better than `best`, of the same episodes; None where they are the same one.

        The interval is one of as many as there are other candidates: `leading` is chosen among them, and the
        luckiest of equal ones would often seem better otherwise. None also where an episode failed and
        `ranking.failed` is no number, so that they cannot be compared one by one.
        """
        ahead, best = self.leading, self.best
        return None if ahead is best else gain_of(ahead, best, of=len(self.candidates) - 1)

    @property
    def gain(self) -> Estimate | None:
        """How much `best` is better than `start`, of the same episodes; None without it, or as for `lead`."""
        return None if self.start is None else gain_of(self.best, self.start)

    @property
    def seeds(self) -> list[int]:
        """Simulation seed of each episode."""
        return self.best.seeds

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "depends_on_seed": self.depends_on_seed,
            "episodes": len(self.seeds),
            "seeds": self.seeds,
            "candidates": [candidate.summary() for candidate in self.candidates],
            **({} if self.start is None else {"start": self.start.summary()}),
        }

    def export(self, path: str | PathLike[str]) -> None:
        """Write every episode of every candidate as a table, .csv, in the order of `candidates` and `seeds`.

        Columns: generation, candidate, recorded, seed, fitness (nan where the episode failed), metrics.
        Raises InputError for another ending, and when the file cannot be written.
        """
        if Path(path).suffix.lower() != ".csv":
            raise InputError(f"{path}: the table of a validation ends with .csv")
        names = list(self.best.metrics)
        lines = [",".join(["generation", "candidate", "recorded", "seed", "fitness", *map(column_of, names)])]
        for candidate in self.candidates:
            columns = [
                candidate.seeds,
                candidate.episodes.tolist(),
                *(candidate.metrics[name].tolist() for name in names),
            ]
            whose = (candidate.generation, candidate.candidate, candidate.recorded)
            lines += [",".join(map(repr, (*whose, *row))) for row in zip(*columns, strict=True)]
        write_text(path, "\n".join([*lines, ""]))


def gain_of(one: ControllerEvaluation, other: ControllerEvaluation, of: int = 1) -> Estimate | None:
    """Return how much one is better than another in the same episodes; None where one does not count.

    of: intervals that are looked at together.
    """
    if not (one.is_reportable and other.is_reportable):
        return None
    samples = (each.ranking.samples(each.counted) for each in (one, other))
    return estimate([first - second for first, second in zip(*samples, strict=True)], of=of)


def stored_validation(
    values: dict[str, Any], ranking: Ranking, *, by_instance: bool = False, slow: str | None = None
) -> Validation:
    """Return a validation from what a store keeps of it."""
    shared = {key: values[key] for key in ("seeds", "seen", "metrics")}
    start = values.get("start")
    return Validation(
        candidates=[
            stored_post_evaluation({**shared, **candidate}, ranking) for candidate in values["candidates"]
        ],
        depends_on_seed=values["state"] != "same",
        by_instance=by_instance,
        slow=slow,
        start=None if start is None else stored_controller_evaluation({**shared, **start}, ranking),
    )


def of_run(run: "Run") -> Validation | None:
    """Return a run's validation; None where there is none of its best."""
    values = run._store.validation()
    if values is None or values["state"] not in {"done", "same"}:
        return None
    if values["candidates"][0]["number"] != run.evaluation().number:
        return None  # the run went on, and another one is the best
    experiment = run.experiment
    reason = unreadable(experiment.ranking)
    if reason is not None:
        warn_once(f"{run.path}: held-out fitness is not shown: {reason}")
        return None
    target = slow_of(experiment) if reports_slow(experiment) else None
    return stored_validation(
        values,
        experiment.new_ranking(),
        by_instance=by_instance(experiment),
        slow=None if target is None else target.name,
    )


@dataclass(frozen=True)
class _Plan:
    """What is evaluated."""

    candidates: list[Evaluation]
    seeds: list[int]
    tried: int
    """Episodes after which it is decided."""
    first: Evaluation
    """The first evaluation of the run."""

    @property
    def numbers(self) -> list[int]:
        """Of the evaluations in the whole run."""
        return [candidate.number for candidate in self.candidates]

    def fits(self, stored: dict[str, Any] | None) -> bool:
        """Return whether what is stored is of the same candidates and seeds."""
        if stored is None or stored["state"] == "none":
            return False
        numbers = [candidate["number"] for candidate in stored["candidates"]]
        seeds = self.seeds[: self.tried] if stored["state"] == "same" else self.seeds
        return bool(numbers == self.numbers and stored["seeds"] == seeds)


def is_due(experiment: Experiment, reader: StoreReader, *, changed: bool) -> bool:
    """Return whether a run that has ended is to be validated still.

    changed: whether it is asked for otherwise than before.
    """
    stored = reader.validation()
    if stored is not None and stored["state"] == "due":
        return True
    if not changed and not _is_missing(experiment, reader, stored):
        return False
    plan = _planned(experiment, reader)
    return plan is not None and not plan.fits(stored)


def _is_missing(experiment: Experiment, reader: StoreReader, stored: dict[str, Any] | None) -> bool:
    """Whether a run that is done may lack its validation: it was interrupted just before that."""
    if "validate" not in reader.experiment() or reader.last() is None:
        return False  # of a version that validated nothing, or the best alone
    if stored is None:
        return True
    if stored["state"] == "none":
        return experiment.validate.episodes not in {0, AUTO}  # a number is always evaluated
    # The run was prolonged, and another one is the best now.
    return bool(stored["candidates"][0]["number"] != reader.evaluation(None, None).number)


class TooShort(NamedTuple):
    """Why a run with `validate.episodes: auto` was not validated."""

    share: float
    """Of a run's evaluations, that a validation takes at most."""
    affordable: int
    """Episodes that this share is."""
    needed: int
    """Fewest episodes of a validation."""
    command: str
    """Validates the run."""


def too_short(run: "Run") -> TooShort | None:
    """Return why a run that is done has no validation; None where it has one, or was not to have one."""
    if run.state != "done" or not run.generations or run.validation is not None:
        return None
    experiment = run.experiment
    if experiment.validate.episodes != AUTO or _planned(experiment, run._store) is not None:
        return None
    affordable, needed = _affordable(experiment, run._store), max(_LEAST, experiment.ranking.episodes)
    return TooShort(_SHARE, affordable, needed, command_to_validate(run))


def command_to_validate(run: "Run", episodes: int = EPISODES) -> str:
    """Return the command by which a run that has no validation is validated.

    episodes: held-out episodes, where the run itself asks for none.
    """
    asked = run.experiment.validate.episodes not in {0, AUTO}
    # What the run asks for comes at its end; where it asks for none, or is too short for one, a number must.
    option = f" --set validate.episodes={episodes}"
    if run.validation_is_due or (asked and run.state != "done"):
        option = ""
    return f"swarmwright resume {shlex.quote(str(run.path))}{option}"


def validate(
    experiment: Experiment, reader: StoreReader, backend: Backend, on_progress: Progress | None, keep: Keep
) -> None:
    """Validate the best candidates of a run that has ended.

    Args:
        experiment: as it was run; `validate` says how many episodes of how many candidates.
        reader: reads the run.
        backend: evaluates.
        on_progress: as in `optimize`.
        keep: stores what is known so far; a validation that was interrupted goes on from there.

    Raises RunError when every episode fails, or servers do.
    """
    plan = _planned(experiment, reader)
    if plan is None:
        keep({"state": "none"})
        return
    stored = reader.validation()
    work = _Work(experiment, plan, backend, on_progress, keep)
    if stored is not None and plan.fits(stored) and stored["state"] == "due":
        work.take_up(stored)
    else:
        work.keep("due")
    begun, before = time.monotonic(), work.done
    work.to(min(plan.tried, _TRIED))
    rate = (time.monotonic() - begun) / max(work.done - before, 1)

    def alike() -> bool:
        return not (_differ(work.rows) or _record_differs(experiment, reader) or work.other())

    if plan.tried < len(plan.seeds) and alike():
        work.evaluate_start()
        work.keep("same")
        return
    if rate * (len(plan.seeds) - work.done) > _LONG_S:
        progress.info(
            "validating: %d episodes with held-out seeds of each of the best %d candidates",
            len(plan.seeds), len(plan.candidates),
        )  # fmt: skip
    size = max(_PART, math.ceil(len(plan.seeds) / _PARTS))
    while work.done < len(plan.seeds):
        work.to(min(len(plan.seeds), work.done + size))
    work.evaluate_start()
    work.keep("same" if plan.tried == len(plan.seeds) and alike() else "done")


class _Work:
    """A validation under way."""

    def __init__(
        self,
        experiment: Experiment,
        plan: _Plan,
        backend: Backend,
        on_progress: Progress | None,
        keep: Keep,
    ) -> None:
        self._experiment, self._plan, self._backend = experiment, plan, backend
        self._on_progress, self._keep = on_progress, keep
        self._genomes = np.stack([candidate.genome for candidate in plan.candidates])
        count = len(plan.candidates)
        self._fitness = np.zeros((count, 0))
        self._metrics = np.zeros((count, 0, len(backend.metrics)))
        self._start: dict[str, Any] | None = None

    @property
    def done(self) -> int:
        """Episodes of each candidate so far."""
        return self._fitness.shape[1]

    def take_up(self, stored: dict[str, Any]) -> None:
        """Go on from what is stored, unless other metrics are."""
        if stored["metrics"] != list(self._backend.metrics):
            return
        self._fitness = np.stack([numbers(candidate["episodes"]) for candidate in stored["candidates"]])
        self._metrics = np.stack([numbers(candidate["values"]) for candidate in stored["candidates"]])
        self._metrics = self._metrics.reshape(*self._fitness.shape, len(self._backend.metrics))

    def to(self, count: int) -> None:
        """Evaluate until each candidate has so many episodes, and store them."""
        if count <= self.done:
            return
        before, all_ = self.done * len(self._genomes), len(self._plan.seeds) * len(self._genomes)

        def on_progress(done: int, _: int, waiting_for: str) -> None:
            if self._on_progress is not None:
                self._on_progress(before + done, all_, waiting_for)

        results = evaluated(
            self._experiment,
            self._backend,
            self._genomes,
            self._plan.seeds[self.done : count],
            on_progress,
            may_fail=bool(np.isfinite(self._fitness).any()),
        )
        self._fitness = np.concatenate([self._fitness, results.fitness + 0.0], axis=1)
        self._metrics = np.concatenate([self._metrics, results.metrics], axis=1)
        self.keep("due")

    def evaluate_start(self) -> None:
        """Evaluate the controller that the first sample was drawn around, in the episodes so far."""
        if not samples_around_start(self._experiment):
            return
        representation = self._experiment.representation(self._backend.sensors, self._backend.actuators)
        start = start_genomes(self._experiment, representation)
        if start is None:
            return
        seeds = self._plan.seeds[: self.done]
        results = evaluated(
            self._experiment, self._backend, start[:1], seeds, self._on_progress, may_fail=True
        )
        self._start = {
            "episodes": finite(results.fitness[0] + 0.0), "values": finite(results.metrics[0])
        }  # fmt: skip

    def keep(self, state: str) -> None:
        """Store what is known."""
        plan = self._plan
        self._keep(
            {
                "state": state,
                "seeds": plan.seeds[: self.done] if state == "same" else plan.seeds,
                "seen": 0,
                "metrics": list(self._backend.metrics),
                "candidates": [
                    {
                        "number": candidate.number,
                        "generation": candidate.generation,
                        "candidate": candidate.candidate,
                        "recorded": candidate.fitness,
                        "episodes": finite(self._fitness[index]),
                        "values": finite(self._metrics[index]),
                    }
                    for index, candidate in enumerate(plan.candidates)
                ],
                **({} if self._start is None else {"start": self._start}),
            }
        )

    @property
    def rows(self) -> list[NDArray[np.float64]]:
        """Return the fitness of each candidate's episodes, with those in the record before them."""
        return [
            np.concatenate([candidate.episodes, values])
            for candidate, values in zip(self._plan.candidates, self._fitness, strict=True)
        ]

    def other(self) -> bool:
        """Try the first candidate of the run, which is not a good one yet; whether its episodes differ."""
        first = self._plan.first
        results = evaluated(
            self._experiment,
            self._backend,
            first.genome[np.newaxis],
            self._plan.seeds[:_TRIED],
            lambda *_: None,
            may_fail=True,
        )
        return _differ([np.concatenate([first.episodes, results.fitness[0] + 0.0])])


def _planned(experiment: Experiment, reader: StoreReader) -> _Plan | None:
    """Return what is evaluated; None for nothing."""
    options, ranking, last = experiment.validate, experiment.ranking, reader.last()
    automatic = options.episodes == AUTO
    if last is None or options.episodes == 0:
        return None
    count, most = options.episodes, options.candidates
    if automatic:
        affordable = _affordable(experiment, reader)
        count = min(max(EPISODES, 4 * ranking.episodes), affordable)
        count -= count % ranking.episodes
        if count < max(_LEAST, ranking.episodes):
            return None
        most = max(1, min(most, affordable // count))
    candidates = [_recorded(experiment, evaluation) for evaluation in leading(experiment, reader, most)]
    seeds = unseen_seeds(experiment.first_seed, reader.used_seeds(), count, options.seed)
    # A number that is given is evaluated: what fails in one of twenty seeds may go well in the first ones.
    tried = min(count, _TRIED) if automatic else count
    return _Plan(candidates, seeds, tried, _recorded(experiment, reader.evaluation(0, 0)))


def _affordable(experiment: Experiment, reader: StoreReader) -> int:
    """Return how many episodes a validation may take whose number is automatic."""
    evaluations = reader.measured(METRIC) if reports_slow(experiment) else _budgeted(experiment, reader)
    return int(evaluations * experiment.ranking.episodes * _SHARE)


def _budgeted(experiment: Experiment, reader: StoreReader) -> int:
    """Return the evaluations of a run; its whole budget where no other generation fitted into it.

    Runs with the same budget are so validated in equally many episodes, whatever their generations have.
    """
    last, most = reader.last(), experiment.budget.evaluations
    used = 0 if last is None else last.evaluations
    if most is None or reader.ended() != "evaluations":
        return used
    # What ended an earlier session, with a smaller budget, may be stored still.
    return most if most < 2 * used else used


def _recorded(experiment: Experiment, evaluation: Evaluation) -> Evaluation:
    """Return an evaluation with the episodes of the simulation that it is validated in."""
    return (
        dataclasses.replace(evaluation, episodes=evaluation.metrics[:, -1])
        if reports_slow(experiment)
        else evaluation
    )


def leading(experiment: Experiment, reader: StoreReader, count: int) -> list[Evaluation]:
    """Return the best evaluation of a run, and the next best ones of other controllers; at most `count`."""
    return reader.leading(
        count,
        last_only=experiment.ranking.reevaluate,
        by_instance=by_instance(experiment),
        key=_key(experiment.representation()),
    )


def _key(representation: Representation) -> Callable[[Genome], str | bytes]:
    """Return what is the same for genomes of the same controller."""

    def of_weights(genome: Genome) -> bytes:
        weights: NDArray[np.float32] = representation.weights(genome[np.newaxis])
        return weights.astype(np.float32).tobytes()

    def of_specification(genome: Genome) -> str:
        return json.dumps(representation.specification(genome), sort_keys=True)

    # Text takes longer, and is needed only where a representation says more of a controller than its weights.
    alike = type(representation).specification is Representation.specification
    return of_weights if alike else of_specification


def _differ(rows: list[NDArray[np.float64]]) -> bool:
    """Whether the episodes of any candidate came out differently: that some failed is a difference, too."""
    return any(len(set(row[np.isfinite(row)].tolist())) + (not np.isfinite(row).all()) > 1 for row in rows)


def _record_differs(experiment: Experiment, reader: StoreReader) -> bool:
    """Whether the episodes of any candidate of the run came out differently."""
    if experiment.ranking.episodes == 1:
        return False
    # The episodes that a race leaves out are stored like those that failed.
    races = isinstance(experiment.ranking, RaceOptions)
    return any(_any_differs(block.episodes, failures=not races) for block in reader.rows())


def _any_differs(episodes: NDArray[np.float64], *, failures: bool) -> bool:
    """As `_differ`, of (candidates, episodes) at once: records have millions of candidates.

    failures: whether an episode without fitness has failed.
    """
    worked = np.isfinite(episodes)
    if failures and (worked.any(axis=1) & ~worked.all(axis=1)).any():
        return True
    least = np.where(worked, episodes, np.inf).min(axis=1)
    most = np.where(worked, episodes, -np.inf).max(axis=1)
    return bool((least < most).any())
