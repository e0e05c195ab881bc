"""Validation of a run's best candidates on held-out seeds at its end.

It is stored separately from the record: `state`, `seeds`, `seen`, `metrics`, `candidates` with the fitness of
each episode, and `start`, the controller that the method's first sample was drawn around, if there is one.
The state is `due` (in progress, with the episodes so far), `done`, `same` (fitness does not depend on the
seed) or `none` (switched off, or the run was too short).
"""

import dataclasses
import json
import logging
import math
import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import Genome
from swarmwright.common.errors import InputError
from swarmwright.common.files import write_text
from swarmwright.common.html import table
from swarmwright.common.statistics import Estimate, estimate, means
from swarmwright.common.warn_once import warn_once
from swarmwright.controllers import Representation
from swarmwright.experiment.derived import reports_slow
from swarmwright.experiment.document import AUTO
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.start_from import find_start_genomes, samples_around_start
from swarmwright.experiment.targets import slow_of
from swarmwright.experiment.unavailable import explain_unreadable
from swarmwright.methods.constraints import Limits, sum_violations
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.rankings.race import RaceOptions
from swarmwright.methods.rankings.slow_simulation import METRIC
from swarmwright.runs.instances import averages_instances
from swarmwright.runs.post_evaluation import (
    EPISODES,
    ControllerEvaluation,
    PostEvaluation,
    choose_unseen_seeds,
    decode_numbers,
    encode_numbers,
    evaluate_genomes,
    load_controller_evaluation,
    load_post_evaluation,
)
from swarmwright.runs.store import Evaluation, StoreReader
from swarmwright.runs.store.table import name_column
from swarmwright.servers.evaluation.base import Backend, Progress

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

_MAX_SHARE = 0.05
"""Largest share of a run's episodes for the validation, with `episodes: auto`."""
_MIN_EPISODES = 10
"""Smallest number of episodes that is informative."""
_TRIAL_EPISODES = 20
"""Episodes after which `episodes: auto` decides whether fitness depends on the seed."""
_MAX_PARTS = 20
"""Largest number of parts in which the episodes after the trial are evaluated and stored."""
_MIN_PART_EPISODES = 25
"""Smallest number of episodes per candidate in such a part."""
_ANNOUNCED_S = 5.0
"""Expected seconds from which a validation is announced."""
progress = logging.getLogger("swarmwright.progress")

Keep = Callable[[dict[str, Any]], None]


@dataclass(frozen=True, kw_only=True, repr=False)
class Validation:
    """A run's best candidates in the same episodes with held-out seeds.

    Fitness is in the units of the simulation; larger is better, and failed episodes have NaN.
    """

    candidates: list[PostEvaluation]
    """The best candidates of the run with different controllers, by their recorded fitness; never empty."""
    depends_on_seed: bool
    """Whether fitness depends on the seed, as far as it was tried. If not, candidates have only the episodes
    of this trial."""
    by_instance: bool = False
    """True for the method racing: recorded fitness is the mean over all instances (one in each generation) on
    which the candidate had been evaluated."""
    slow: str | None = None
    """Name of the ranking's slow simulation, if the candidates were evaluated in it."""
    constraints: Mapping[str, Limits] = field(default_factory=dict)
    """Constraints of the experiment."""
    start: ControllerEvaluation | None = None
    """The controller that the method's first sample was drawn around, which is not a candidate of the run;
    None if there is none."""

    def __repr__(self) -> str:
        """Return the number of candidates and the mean fitness of the best."""
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
        """The candidate with the best recorded fitness."""
        return self.candidates[0]

    @property
    def failed(self) -> int:
        """Number of failed episodes of all candidates."""
        return sum(candidate.failed for candidate in self.candidates)

    @property
    def leading(self) -> PostEvaluation:
        """The candidate with the highest fitness on the held-out seeds; the first of equals.

        Candidates whose mean excludes failed episodes come after all others, those that violate constraints
        on these seeds after those that meet them.
        """
        return max(
            self.candidates,
            key=lambda candidate: (
                -self.violation_of(candidate),
                candidate.is_reportable,
                math.isfinite(candidate.fitness.mean),
                candidate.fitness.mean,
            ),
        )

    def violation_of(self, candidate: PostEvaluation) -> float:
        """Return the sum of violations of constraints by a candidate's means on the held-out seeds."""
        if not self.constraints:
            return 0.0
        columns = np.stack([candidate.metrics[name] for name in self.constraints], axis=-1)
        return float(sum_violations(self.constraints, means(columns[np.newaxis]))[0])

    @property
    def lead(self) -> Estimate | None:
        """Paired difference in fitness between `leading` and `best`; None if they are the same candidate.

        The interval is corrected for the number of other candidates, since the luckiest of several equal
        candidates would otherwise often seem better. None also if an episode failed and `ranking.failed` is
        not a number, so that episodes cannot be paired.
        """
        ahead, best = self.leading, self.best
        return None if ahead is best else estimate_gain(ahead, best, intervals=len(self.candidates) - 1)

    @property
    def gain(self) -> Estimate | None:
        """Paired difference in fitness between `best` and `start`; None without `start`, or as for `lead`."""
        return None if self.start is None else estimate_gain(self.best, self.start)

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
            "candidates": [self.summarize(candidate) for candidate in self.candidates],
            **({} if self.start is None else {"start": self.start.summary()}),
        }

    def summarize(self, candidate: PostEvaluation) -> dict[str, Any]:
        """Return plain values of a candidate, with its violation if there are constraints."""
        violation = {"violation": self.violation_of(candidate)} if self.constraints else {}
        return {**candidate.summary(), **violation}

    def export(self, path: str | PathLike[str]) -> None:
        """Write all episodes of all candidates as a CSV table, in the order of `candidates` and `seeds`.

        Columns: generation, candidate, recorded, seed, fitness (nan for failed episodes), metrics.
        Raises InputError for another file type, and when the file cannot be written.
        """
        if Path(path).suffix.lower() != ".csv":
            raise InputError(f"{path}: a validation can only be exported to .csv")
        names = list(self.best.metrics)
        lines = [
            ",".join(["generation", "candidate", "recorded", "seed", "fitness", *map(name_column, names)])
        ]
        for candidate in self.candidates:
            columns = [
                candidate.seeds,
                candidate.episodes.tolist(),
                *(candidate.metrics[name].tolist() for name in names),
            ]
            key = (candidate.generation, candidate.candidate, candidate.recorded)
            lines += [",".join(map(repr, (*key, *row))) for row in zip(*columns, strict=True)]
        write_text(path, "\n".join([*lines, ""]))


def estimate_gain(
    better: ControllerEvaluation, baseline: ControllerEvaluation, intervals: int = 1
) -> Estimate | None:
    """Estimate the paired difference in fitness in the same episodes; None if either is not reportable.

    intervals: number of simultaneous intervals, for the correction.
    """
    if not (better.is_reportable and baseline.is_reportable):
        return None
    samples = (evaluation.ranking.samples(evaluation.counted) for evaluation in (better, baseline))
    return estimate([first - second for first, second in zip(*samples, strict=True)], comparisons=intervals)


def load_validation(
    values: dict[str, Any],
    ranking: Ranking,
    *,
    by_instance: bool = False,
    slow: str | None = None,
    constraints: Mapping[str, Limits] | None = None,
) -> Validation:
    """Build a validation from its stored values."""
    shared = {key: values[key] for key in ("seeds", "seen", "metrics")}
    start = values.get("start")
    return Validation(
        candidates=[
            load_post_evaluation({**shared, **candidate}, ranking) for candidate in values["candidates"]
        ],
        depends_on_seed=values["state"] != "same",
        by_instance=by_instance,
        slow=slow,
        constraints=constraints or {},
        start=None if start is None else load_controller_evaluation({**shared, **start}, ranking),
    )


def load_run_validation(run: "Run") -> Validation | None:
    """Load a run's validation; None if there is none or it is of another candidate than the best."""
    values = run._store.validation()
    if values is None or values["state"] not in {"done", "same"}:
        return None
    if values["candidates"][0]["number"] != run.evaluation().number:
        return None  # the run has continued, and has another best candidate
    experiment = run.experiment
    reason = explain_unreadable(experiment.ranking)
    if reason is not None:
        warn_once(f"{run.path}: held-out fitness is unavailable: {reason}")
        return None
    target = slow_of(experiment) if reports_slow(experiment) else None
    return load_validation(
        values,
        experiment.new_ranking(),
        by_instance=averages_instances(experiment),
        slow=None if target is None else target.name,
        constraints=experiment.constraints,
    )


@dataclass(frozen=True)
class _Plan:
    """The candidates and seeds to evaluate."""

    candidates: list[Evaluation]
    seeds: list[int]
    trial: int
    """Episodes after which it is decided whether fitness depends on the seed."""
    first: Evaluation
    """The first evaluation of the run."""

    def fits(self, stored: dict[str, Any] | None) -> bool:
        """Return whether the stored values have the same candidates and seeds."""
        if stored is None or stored["state"] == "none":
            return False
        stored_numbers = [candidate["number"] for candidate in stored["candidates"]]
        seeds = self.seeds[: self.trial] if stored["state"] == "same" else self.seeds
        same_candidates = stored_numbers == [candidate.number for candidate in self.candidates]
        return bool(same_candidates and stored["seeds"] == seeds)


def is_due(experiment: Experiment, reader: StoreReader, *, changed: bool) -> bool:
    """Return whether an ended run still lacks its validation.

    changed: whether the options of the validation have changed.
    """
    stored = reader.validation()
    if stored is not None and stored["state"] == "due":
        return True
    if not changed and not _is_missing(experiment, reader, stored):
        return False
    plan = _plan_validation(experiment, reader)
    return plan is not None and not plan.fits(stored)


def _is_missing(experiment: Experiment, reader: StoreReader, stored: dict[str, Any] | None) -> bool:
    """Return whether a finished run may lack its validation, for example after an interrupt."""
    if "validate" not in reader.experiment() or reader.last() is None:
        return False  # from a version without this validation
    if stored is None:
        return True
    if stored["state"] == "none":
        return experiment.validate.episodes not in {0, AUTO}  # a number is always evaluated
    # The run was prolonged, and may have another best candidate now.
    return bool(stored["candidates"][0]["number"] != reader.evaluation(None, None).number)


class TooShort(NamedTuple):
    """Why a run with `validate.episodes: auto` was not validated."""

    share: float
    """Largest share of a run's episodes for the validation."""
    affordable: int
    """Number of episodes in this share."""
    needed: int
    """Smallest number of episodes of a validation."""
    command: str
    """Command that validates the run."""


def check_affordability(run: "Run") -> TooShort | None:
    """Return why a finished run has no automatic validation; None if it has one, or the reason is another."""
    if run.state != "done" or not run.generations or run.validation is not None:
        return None
    experiment = run.experiment
    if not has_feasible(experiment, run._store):
        return None
    if experiment.validate.episodes != AUTO or _plan_validation(experiment, run._store) is not None:
        return None
    affordable, needed = (
        _compute_affordable_episodes(experiment, run._store),
        max(_MIN_EPISODES, experiment.ranking.episodes),
    )
    return TooShort(_MAX_SHARE, affordable, needed, format_validation_command(run))


def format_validation_command(run: "Run", episodes: int = EPISODES) -> str:
    """Return the command that validates a run without a validation.

    episodes: number of held-out episodes, if the experiment does not set it.
    """
    is_set = run.experiment.validate.episodes not in {0, AUTO}
    # `resume` validates with the experiment's number; set one if it is missing, or the run is too short.
    option = f" --set validate.episodes={episodes}"
    if run.validation_is_due or (is_set and run.state != "done"):
        option = ""
    return f"swarmwright resume {shlex.quote(str(run.path))}{option}"


def validate(
    experiment: Experiment, reader: StoreReader, backend: Backend, on_progress: Progress | None, keep: Keep
) -> None:
    """Validate the best candidates of an ended run.

    Args:
        experiment: the run's; `validate` has the numbers of episodes and candidates.
        reader: reads the run.
        backend: evaluates.
        on_progress: as in `optimize`.
        keep: stores the results so far, from which an interrupted validation continues.

    Raises RunError when every episode fails, or servers do.
    """
    plan = _plan_validation(experiment, reader)
    if plan is None:
        keep({"state": "none"})
        return
    stored = reader.validation()
    work = _Work(experiment, plan, backend, on_progress, keep)
    if stored is not None and plan.fits(stored) and stored["state"] == "due":
        work.restore(stored)
    else:
        work.keep("due")
    start, before = time.monotonic(), work.done
    work.evaluate_up_to(min(plan.trial, _TRIAL_EPISODES))
    seconds_per_episode = (time.monotonic() - start) / max(work.done - before, 1)

    def is_independent_of_seed() -> bool:
        return not (
            _differ(work.rows) or _record_differs(experiment, reader) or work.first_candidate_differs()
        )

    if plan.trial < len(plan.seeds) and is_independent_of_seed():
        work.evaluate_start()
        work.keep("same")
        return
    if seconds_per_episode * (len(plan.seeds) - work.done) > _ANNOUNCED_S:
        progress.info(
            "validation: running %d episodes with held-out seeds for each of the best %d candidates",
            len(plan.seeds), len(plan.candidates),
        )  # fmt: skip
    size = max(_MIN_PART_EPISODES, math.ceil(len(plan.seeds) / _MAX_PARTS))
    while work.done < len(plan.seeds):
        work.evaluate_up_to(min(len(plan.seeds), work.done + size))
    work.evaluate_start()
    work.keep("same" if plan.trial == len(plan.seeds) and is_independent_of_seed() else "done")


class _Work:
    """A validation in progress."""

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

    def restore(self, stored: dict[str, Any]) -> None:
        """Continue from stored results, unless they have other metrics."""
        if stored["metrics"] != list(self._backend.metrics):
            return
        self._fitness = np.stack(
            [decode_numbers(candidate["episodes"]) for candidate in stored["candidates"]]
        )
        self._metrics = np.stack([decode_numbers(candidate["values"]) for candidate in stored["candidates"]])
        self._metrics = self._metrics.reshape(*self._fitness.shape, len(self._backend.metrics))

    def evaluate_up_to(self, count: int) -> None:
        """Evaluate until each candidate has `count` episodes, and store them."""
        if count <= self.done:
            return
        before, total = self.done * len(self._genomes), len(self._plan.seeds) * len(self._genomes)

        def on_progress(done: int, _: int, waiting_for: str) -> None:
            if self._on_progress is not None:
                self._on_progress(before + done, total, waiting_for)

        results = evaluate_genomes(
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
        start = find_start_genomes(self._experiment, representation)
        if start is None:
            return
        seeds = self._plan.seeds[: self.done]
        results = evaluate_genomes(
            self._experiment, self._backend, start[:1], seeds, self._on_progress, may_fail=True
        )
        self._start = {
            "episodes": encode_numbers(results.fitness[0] + 0.0), "values": encode_numbers(results.metrics[0])
        }  # fmt: skip

    def keep(self, state: str) -> None:
        """Store the results so far."""
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
                        "episodes": encode_numbers(self._fitness[index]),
                        "values": encode_numbers(self._metrics[index]),
                    }
                    for index, candidate in enumerate(plan.candidates)
                ],
                **({} if self._start is None else {"start": self._start}),
            }
        )

    @property
    def rows(self) -> list[NDArray[np.float64]]:
        """Fitness of each candidate's recorded and held-out episodes."""
        return [
            np.concatenate([candidate.episodes, values])
            for candidate, values in zip(self._plan.candidates, self._fitness, strict=True)
        ]

    def first_candidate_differs(self) -> bool:
        """Evaluate the first candidate of the run, a poor one; return whether its episodes differ."""
        first = self._plan.first
        results = evaluate_genomes(
            self._experiment,
            self._backend,
            first.genome[np.newaxis],
            self._plan.seeds[:_TRIAL_EPISODES],
            lambda *_: None,
            may_fail=True,
        )
        return _differ([np.concatenate([first.episodes, results.fitness[0] + 0.0])])


def _plan_validation(experiment: Experiment, reader: StoreReader) -> _Plan | None:
    """Plan the validation of a run; None if there is nothing to evaluate."""
    options, ranking, last = experiment.validate, experiment.ranking, reader.last()
    automatic = options.episodes == AUTO
    if last is None or options.episodes == 0 or not has_feasible(experiment, reader):
        return None
    count, most = options.episodes, options.candidates
    if automatic:
        affordable = _compute_affordable_episodes(experiment, reader)
        count = min(max(EPISODES, 4 * ranking.episodes), affordable)
        count -= count % ranking.episodes
        if count < max(_MIN_EPISODES, ranking.episodes):
            return None
        most = max(1, min(most, affordable // count))
    candidates = [
        _select_simulation_episodes(experiment, evaluation)
        for evaluation in find_leading(experiment, reader, most)
    ]
    seeds = choose_unseen_seeds(experiment.first_seed, reader.collect_seeds(), count, options.seed)
    # An explicit number is always evaluated: a rare failure may not occur in the first seeds.
    trial = min(count, _TRIAL_EPISODES) if automatic else count
    return _Plan(candidates, seeds, trial, _select_simulation_episodes(experiment, reader.evaluation(0, 0)))


def has_feasible(experiment: Experiment, reader: StoreReader) -> bool:
    """Return whether a candidate meets the constraints, so that the best has a fitness to validate."""
    return not experiment.constraints or math.isfinite(reader.evaluation(None, None).fitness)


def _compute_affordable_episodes(experiment: Experiment, reader: StoreReader) -> int:
    """Return the largest number of episodes of an automatic validation."""
    evaluations = (
        reader.count_measured(METRIC)
        if reports_slow(experiment)
        else _count_budgeted_evaluations(experiment, reader)
    )
    return int(evaluations * experiment.ranking.episodes * _MAX_SHARE)


def _count_budgeted_evaluations(experiment: Experiment, reader: StoreReader) -> int:
    """Return the evaluations of a run, or its whole budget if another generation would not fit into it.

    So runs with the same budget are validated in the same number of episodes, whatever their generation size.
    """
    last, most = reader.last(), experiment.budget.evaluations
    used = 0 if last is None else last.evaluations
    if most is None or reader.find_end_reason() != "evaluations":
        return used
    # The stored reason may be that of an earlier session with a smaller budget.
    return most if most < 2 * used else used


def _select_simulation_episodes(experiment: Experiment, evaluation: Evaluation) -> Evaluation:
    """Return an evaluation with its episodes in the slow simulation, if the ranking has one."""
    return (
        dataclasses.replace(evaluation, episodes=evaluation.metrics[:, -1])
        if reports_slow(experiment)
        else evaluation
    )


def find_leading(experiment: Experiment, reader: StoreReader, count: int) -> list[Evaluation]:
    """Return at most `count` best evaluations of a run with different controllers."""
    return reader.leading(
        count,
        last_only=experiment.ranking.reevaluate,
        by_instance=averages_instances(experiment),
        key=_make_controller_key(experiment.representation()),
    )


def _make_controller_key(representation: Representation) -> Callable[[Genome], str | bytes]:
    """Return a function with equal values for genomes of the same controller."""

    def get_weights(genome: Genome) -> bytes:
        weights: NDArray[np.float32] = representation.weights(genome[np.newaxis])
        return weights.astype(np.float32).tobytes()

    def get_specification(genome: Genome) -> str:
        return json.dumps(representation.specification(genome), sort_keys=True)

    # Specifications take longer, and matter only if they have more than the weights.
    weights_suffice = type(representation).specification is Representation.specification
    return get_weights if weights_suffice else get_specification


def _differ(rows: list[NDArray[np.float64]]) -> bool:
    """Return whether the episodes of any candidate differ, in fitness or by a failure."""
    return any(len(set(row[np.isfinite(row)].tolist())) + (not np.isfinite(row).all()) > 1 for row in rows)


def _record_differs(experiment: Experiment, reader: StoreReader) -> bool:
    """Return whether the recorded episodes of any candidate of the run differ."""
    if experiment.ranking.episodes == 1:
        return False
    # Episodes skipped by a race are stored like failed ones.
    races = isinstance(experiment.ranking, RaceOptions)
    return any(_differ_anywhere(block.episodes, failures=not races) for block in reader.rows())


def _differ_anywhere(episodes: NDArray[np.float64], *, failures: bool) -> bool:
    """Vectorized `_differ` of (candidates, episodes), since records have millions of candidates.

    failures: whether an episode without fitness has failed.
    """
    succeeded = np.isfinite(episodes)
    if failures and (succeeded.any(axis=1) & ~succeeded.all(axis=1)).any():
        return True
    smallest = np.where(succeeded, episodes, np.inf).min(axis=1)
    largest = np.where(succeeded, episodes, -np.inf).max(axis=1)
    return bool((smallest < largest).any())
