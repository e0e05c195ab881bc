"""The transfer at the end of a run: its best candidates in the other simulations that `validate` names.

It is stored separately from the record: `state`, `seeds`, `numbers` of the evaluations, `candidates`, and
their fitness of each episode in the run's own simulation (`source`) and in each finished target (`targets`).
The state is `due` (targets are missing) or `done`.
"""

import json
import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from swarmwright.common.errors import InputError, RunError
from swarmwright.common.warn_once import warn_once
from swarmwright.experiment.derived import place_of
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.targets import OtherSimulation, PseudoReality, Target, slow_of, targets_at_end
from swarmwright.experiment.unavailable import explain_unreadable
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.post_evaluation import choose_unseen_seeds, decode_numbers, encode_numbers
from swarmwright.runs.run import Run, open_written_run
from swarmwright.runs.store import FILE, Evaluation, StoreReader, StoreWriter
from swarmwright.runs.transfer.evaluation import Plan, Work, check_target
from swarmwright.runs.transfer.transferred import Candidate, Transferred
from swarmwright.runs.validation import find_leading, has_feasible
from swarmwright.servers.evaluation.base import Progress, Servers
from swarmwright.simulations.user_code.parts import read_simulation
from swarmwright.simulations.user_code.permission import remember, require_named

progress = logging.getLogger("swarmwright.progress")
Stored = dict[str, Any]


def check(experiment: Experiment, broker: str | None = None) -> None:
    """Raise InputError if another simulation that a run uses is not available.

    broker: as in `optimize`; other simulations may be on it.
    """
    broker = broker or experiment.broker
    slow = slow_of(experiment)
    named = [("validate", target) for target in targets_at_end(experiment)]
    for key, target in [*([] if slow is None else [("ranking", slow)]), *named]:
        try:
            check_target(target, target.make_experiments(experiment, 1)[0], experiment, broker)
        except InputError as error:
            raise InputError(f"{place_of(experiment, key)}{error}") from error


def allow(experiment: Experiment, run: Run | None = None) -> None:
    """Trust the classes and commands of other simulations that the user's experiment names.

    run: the resumed run. Names in the run or in the file of a run folder may be from another user, and must
    already be trusted.

    Raises InputError for untrusted names.
    """
    named = [_target_as_json(target) for target in ([] if run is None else targets_at_end(run.experiment))]
    received = run is None and experiment.path is not None and (experiment.path.parent / FILE).exists()
    slow = slow_of(experiment) if run is None else None
    targets = [target for target in targets_at_end(experiment) if _target_as_json(target) not in named]
    for name in _codes(experiment, [*([] if slow is None else [slow]), *targets]):
        if received:
            require_named(name)
            continue
        part = read_simulation(name)
        remember([] if part is None else [part])


def _codes(experiment: Experiment, targets: Iterable[Target]) -> Iterator[str]:
    for target in targets:
        name = target.find_code(experiment) if isinstance(target, OtherSimulation) else None
        if name is not None:
            yield name


@dataclass(frozen=True)
class _TransferPlan:
    """The candidates, seeds and targets to evaluate."""

    best: list[Evaluation]
    seeds: list[int]
    random: int
    targets: list[Target]

    @classmethod
    def of(cls, experiment: Experiment, reader: StoreReader) -> Self | None:
        """Plan the transfer; return None if there is nothing to do."""
        options = experiment.validate
        if not options.transfers or reader.last() is None or not has_feasible(experiment, reader):
            return None
        used = reader.collect_seeds() if options.seed is None else set[int]()
        return cls(
            find_leading(experiment, reader, options.candidates),
            choose_unseen_seeds(experiment.first_seed, used, options.seeds, options.seed),
            options.random,
            targets_at_end(experiment),
        )

    def create_values(self) -> Stored:
        """Return the values to store before anything is evaluated."""
        return {
            "state": "due",
            "seeds": self.seeds,
            "random": self.random,
            "numbers": [evaluation.number for evaluation in self.best],
            "candidates": [],
            "source": None,
            "targets": [],
        }

    def fits(self, stored: Stored | None) -> bool:
        """Return whether the stored values have the same candidates and seeds."""
        if stored is None:
            return False
        values = self.create_values()
        return all(stored[key] == values[key] for key in ("seeds", "random", "numbers"))

    def missing(self, stored: Stored | None) -> list[Target]:
        """Return the targets that are not stored."""
        finished = (
            [entry["target"] for entry in stored["targets"]]
            if stored is not None and self.fits(stored)
            else []
        )
        return [target for target in self.targets if _target_as_json(target) not in finished]


def is_due(experiment: Experiment, reader: StoreReader) -> bool:
    """Return whether an ended run lacks targets."""
    planned = _TransferPlan.of(experiment, reader)
    return planned is not None and bool(planned.missing(reader.transfer()))


def transfer_at_end(
    folder: Path,
    *,
    broker: str | None = None,
    servers: Servers | None = None,
    on_progress: Progress | None = None,
) -> None:
    """Transfer the best candidates of an ended run to the simulations that its experiment names.

    Stored results are not evaluated again. The run is complete without the transfer; simulations that are
    not available are reported as warnings.

    Args:
        folder: folder of the run.
        broker: as in `optimize`.
        servers: as in `optimize`.
        on_progress: as in `optimize`.
    """
    run = open_written_run(folder)
    if not run.transfer_is_due:
        return
    with StoreWriter.resume(folder) as store:
        try:
            _Session(run, store, broker).evaluate(servers, on_progress)
        except (InputError, RunError) as error:
            _warn(folder, error)


class _Session:
    """Evaluates the missing targets of a run's transfer."""

    def __init__(self, run: Run, store: StoreWriter, broker: str | None) -> None:
        planned = _TransferPlan.of(run.experiment, run._store)
        assert planned is not None
        self._run, self._store, self._broker, self._planned = run, store, broker, planned
        stored = run._store.transfer()
        self._stored = stored if stored is not None and planned.fits(stored) else planned.create_values()

    def evaluate(self, servers: Servers | None, on_progress: Progress | None) -> None:
        """Evaluate and store. Raises InputError and RunError if the run's own simulation is not available."""
        planned, stored, count = self._planned, self._stored, len(self._planned.seeds)
        experiment = resolve_experiment(self._run, planned.best[0].generation)
        for name in _codes(experiment, planned.targets):
            require_named(name)
        missing = planned.missing(stored)
        plan = Plan.of(experiment, planned.best, missing, random=planned.random, seeds=count)
        work = Work(planned.seeds, self._broker, servers, on_progress, plan.episodes(count))
        if stored["source"] is None:
            stored["candidates"] = [
                [candidate.generation, candidate.candidate, candidate.recorded]
                for candidate in plan.candidates
            ]
            stored["source"] = encode_numbers(work.evaluate_source(plan))
            self._store.note_transfer(stored)
        else:
            work.skip(len(plan.candidates) * count)
        for target, experiments in plan.targets:
            self._evaluate_target(plan, work, target, experiments)
        if not planned.missing(stored):
            self._store.note_transfer({**stored, "state": "done"})

    def _evaluate_target(self, plan: Plan, work: Work, target: Target, experiments: list[Experiment]) -> None:
        progress.info(
            "transfer: running %d episodes with held-out seeds for each of %d candidates in %s",
            len(self._planned.seeds), len(plan.candidates), target.name,
        )  # fmt: skip
        try:
            check_target(target, experiments[0], plan.experiment, self._broker or plan.experiment.broker)
            episodes = work.evaluate_target(plan, target, experiments)
        except (InputError, RunError) as error:
            _warn(self._run.path, error)
            return
        self._stored["targets"].append(
            {"target": _target_as_json(target), "name": target.name, "episodes": encode_numbers(episodes)}
        )
        self._store.note_transfer(self._stored)


def _target_as_json(target: Target) -> Any:  # noqa: ANN401 - plain values
    """Return the identity of a target as JSON values."""
    if isinstance(target, PseudoReality):
        values: Any = {
            "ranges": [[list(interval.path), interval.low, interval.high] for interval in target.ranges]
        }
    else:
        values = {"name": target.name, "changes": None if target.changes is None else dict(target.changes)}
    return json.loads(json.dumps(values))


def _warn(folder: Path, error: Exception) -> None:
    logging.getLogger("swarmwright").warning(
        "the best candidates were not transferred: %s; the run itself is finished, and "
        "`swarmwright resume %s` repeats the transfer",
        error, folder,
    )  # fmt: skip


def load_transfers(run: Run) -> tuple[Transferred, ...]:
    """Load the finished transfers of a run, in the order of its experiment.

    Empty if the run has continued and has another best candidate.
    """
    stored = run._store.transfer()
    if stored is None or stored["source"] is None or stored["numbers"][0] != run.evaluation().number:
        return ()
    candidates = tuple(Candidate(*candidate) for candidate in stored["candidates"])
    reason = explain_unreadable(run.experiment.ranking)
    if reason is not None:
        warn_once(f"{run.path}: fitness in other simulations is unavailable: {reason}")
        return ()
    source, ranking = decode_numbers(stored["source"]), run.experiment.new_ranking()
    entries = {json.dumps(entry["target"]): entry for entry in stored["targets"]}
    ordered = (entries.get(json.dumps(_target_as_json(target))) for target in targets_at_end(run.experiment))
    return tuple(
        Transferred(run, entry["name"], candidates, source, decode_numbers(entry["episodes"]), ranking)
        for entry in ordered
        if entry is not None
    )


def read_seeds(run: Run) -> list[int]:
    """Return the seed of each episode of a run's transfer; empty without a transfer."""
    stored = run._store.transfer()
    return [] if stored is None else list(stored["seeds"])
