"""Plans for resuming a run with a larger budget or elsewhere, and errors of runs that cannot continue."""

import dataclasses
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

from pydantic import ValidationError

from swarmwright.common.errors import InputError, RunError
from swarmwright.common.plug_in_code import is_plug_in
from swarmwright.common.problems import problems_of
from swarmwright.common.revision import revision
from swarmwright.common.yaml import format_path
from swarmwright.controllers import Representation
from swarmwright.experiment.budget import EndReason
from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD, Experiment
from swarmwright.experiment.unavailable import method_of, require_method
from swarmwright.methods import Method
from swarmwright.methods.rankings import Ranking
from swarmwright.methods.search import SearchMethod
from swarmwright.runs import edits
from swarmwright.runs.run import Run
from swarmwright.runs.store import StoreReader
from swarmwright.runs.store.provenance import COMMIT, HASH_SEED, versions
from swarmwright.runs.transfer import at_end
from swarmwright.runs.validation import is_due
from swarmwright.servers.rows import GenerationResult

Component = Method | Ranking | Representation
_SORTS: Mapping[type, str] = {Method: "method", Representation: "representation", Ranking: "ranking"}
_NO_PART = {"sqlite", COMMIT, HASH_SEED}
"""Recorded versions that do not affect results, or rarely do."""


class NothingLeftError(InputError):
    """A run has nothing left to evaluate even with a larger budget."""


@dataclass(frozen=True)
class Resumption:
    """The plan for resuming a run."""

    experiment: Experiment
    """The run's experiment, with the changes in its file and the caller's settings and budgets."""
    notes: list[str]
    """Descriptions of the changes in its file."""
    reader: StoreReader
    has_all_generations: bool
    had_ended: bool
    """Whether its last session ended cleanly."""
    has_other_validation: bool
    """Whether the options of the validation have changed."""

    @classmethod
    def of(
        cls, run: Run, reader: StoreReader, settings: Iterable[str], budget: Mapping[str, float | None]
    ) -> Self:
        """Build the plan for resuming a run.

        Args:
            run: the run to resume.
            reader: reader of its store.
            settings: as in `resume`.
            budget: generations, evaluations and seconds, None for unchanged limits.

        Raises InputError for changes that are not allowed.
        """
        extended = extend_experiment(run, run.experiment, settings, budget)
        edited, notes = edits.adopt_file_edits(run, extended)
        if extended.validate != run.experiment.validate:
            at_end.allow(extended, run)
        experiment = extend_experiment(run, edited, settings, budget)
        return cls(
            experiment,
            notes,
            reader,
            has_all_generations=run.state == "done" and experiment.budget == run.experiment.budget,
            had_ended=any(session.outcome in {"done", "stopped"} for session in reader.sessions()[-1:]),
            has_other_validation=experiment.validate != run.experiment.validate,
        )

    def check_goes_on(self, run: Run, ended: EndReason | None) -> None:
        """Raise NothingLeftError if another limit ends the run despite a larger budget.

        Args:
            run: the run to resume.
            ended: what ends it after its stored generations; None if it continues.
        """
        budget = self.experiment.budget
        if ended is None or budget == run.experiment.budget:
            return
        remedy = (
            f"start a new run with another target, from the best of this one: --set start_from={run.path}"
            if ended == "target"
            else f"raise that limit as well: --{ended} N"
        )
        raise NothingLeftError(
            f"{run.path}: nothing is left to evaluate with this budget, since "
            f"{budget.describe_end(ended, run.generations, run.evaluations)}; {remedy}"
        )

    @cached_property
    def validation_is_due(self) -> bool:
        """Whether a run with all its generations still lacks the validation of its best candidates."""
        changed = self.has_other_validation or not self.had_ended
        return is_due(self.experiment, self.reader, changed=changed)


def extend_experiment(
    run: Run, experiment: Experiment, settings: Iterable[str], budget: Mapping[str, float | None]
) -> Experiment:
    """Return an experiment with a larger budget or another place of evaluation.

    Args:
        run: the run to resume.
        experiment: the experiment to change.
        settings: as in `resume`.
        budget: generations, evaluations and seconds, None for unchanged limits.

    Raises InputError if anything else is changed, or the budget is less than the run has used.
    """
    require_method(experiment.method, run.path)
    # Do not import the simulation class: the run may continue with another class.
    new = experiment.with_settings(
        settings, only=KEYS_OUTSIDE_RECORD | {"method"}, reason="it is fixed when a run begins", ask=False
    )
    changes = {name: value for name, value in budget.items() if value is not None}
    if changes:
        options = {**new.to_mapping()["method"], **changes}
        try:
            method_options = type(new.method).model_validate(options)
        except ValidationError as error:
            problems = problems_of(error, type(new.method))
            raise InputError(
                "\n".join(f"{format_path(path)}: {message}" for path, message in problems)
            ) from error
        new = dataclasses.replace(new, method=method_options)
    limits: dict[str, Any] = vars(new.budget)
    old = experiment.method
    if new.method.model_dump(exclude=set(limits)) != old.model_dump(exclude=set(limits)):
        raise InputError("method: only its budget can be changed (generations, evaluations, seconds)")
    method = method_of(old)
    if method.spreads_evaluations and limits["evaluations"] != experiment.budget.evaluations:
        raise InputError(
            "method.evaluations: cannot be changed, because the method plans the whole run with this number; "
            f"start a new run with more, from the best of this one: --set start_from={run.path}"
        )
    used = {"generations": run.generations, "evaluations": run.evaluations, "seconds": 0}
    for name, before in vars(experiment.budget).items():
        if limits[name] is not None and limits[name] < (used[name] if before is None else before):
            lowest = f"the {used[name]} of the run" if before is None else f"the experiment's {before}"
            raise InputError(
                f"{name}: {limits[name]} is less than {lowest}; a run can be prolonged, but not shortened"
            )
    return new


class DivergedError(RunError):
    """A replayed generation differs from the stored one; resuming again does not help."""


def build_divergence_error(
    reader: StoreReader, generation: int, components: Sequence[Component], edited: Sequence[str] = ()
) -> DivergedError:
    """Build the error for a replayed generation that differs from the stored one.

    Args:
        reader: reader of the run.
        generation: the first that differs.
        components: the method, representation and ranking that made the generation.
        edited: descriptions of accepted edits of plug-in code since the run.
    """
    return DivergedError(
        f"{reader.file}: the run cannot continue: generation {generation} is not reproducible here"
        f"{_explain_divergence(reader, components, edited)}"
    )


def _explain_divergence(reader: StoreReader, components: Sequence[Component], edited: Sequence[str]) -> str:
    if edited:
        return (
            f", since the code has changed: {', '.join(edited)}. Restore the original code (its copy is in "
            f"{reader.file.parent / 'code'}), or start a new run"
        )
    first = reader.sessions()[0]
    recorded = {
        name: version for name, version in first.versions.items() if ":" not in name and name not in _NO_PART
    }
    current = versions([*recorded])
    changes = [
        f"{name} {version} (now {current.get(name, 'not installed')})"
        for name, version in recorded.items()
        if current.get(name) != version
    ]
    if changes:
        return (
            f". The run began with {', '.join(changes)}; use these versions on a machine of the same kind, "
            "or start a new run"
        )
    for component in components:
        if is_plug_in(type(component)):
            sort = next(name for base, name in _SORTS.items() if isinstance(component, base))
            output = "fitness" if sort == "ranking" else "genomes"
            return (
                f": the {sort} {component.kind} does not reproduce its {output}; find the cause with "
                f"`swarmwright.testing.check_{sort}({component.kind!r})`, then start a new run"
            )
    state, commits = "", (first.versions.get(COMMIT), revision())
    if commits[0] is not None and commits[0] != commits[1]:
        state = f" (commit {commits[0]}; now {commits[1] or 'unknown'})"
    elsewhere = ""
    if first.machine != platform.platform():
        elsewhere = f", or it needs a machine of the same kind as {first.machine}"
    return (
        " although the versions are the same: the store was changed, or the run was made by another commit "
        f"of this version{state}{elsewhere}; check the store with `swarmwright runs verify "
        f"{reader.file.parent}`"
    )


def refuse_cut_restart(reader: StoreReader, stored: GenerationResult, method: Method) -> None:
    """Raise InputError if a larger budget would enlarge the last stored generation.

    Args:
        reader: reader of the run.
        stored: a generation that differs when the run is resumed.
        method: method of the run, told of all generations before.
    """
    size = len(stored.fitness)
    is_generational = isinstance(method, SearchMethod) and method.options.operation == "generational"
    is_next = is_generational and method.generation == stored.generation
    if is_next and size < len(method.ask()) and stored.generation == len(reader.history()) - 1:
        folder = reader.file.parent
        raise InputError(
            f"method: {folder} cannot be prolonged, because the budget limited its last restart to {size} "
            "candidates; start a new run with a larger budget, from the best of this one: --set "
            f"start_from={folder}"
        )
