"""What a run that is resumed is to become: prolonged, or evaluated elsewhere; and why it cannot go on."""

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
from swarmwright.experiment.budget import Ended
from swarmwright.experiment.experiment import ELSEWHERE, Experiment
from swarmwright.experiment.unavailable import method_of, require
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
"""Recorded with the others; nothing is computed with it, or most changes of it change no record."""


class NothingLeftError(InputError):
    """A larger budget leaves nothing of a run to evaluate."""


@dataclass(frozen=True)
class Resumption:
    """What a run that is resumed is to become."""

    experiment: Experiment
    """The run's, with what has changed in its file, and with the settings and budgets of the caller."""
    notes: list[str]
    """What has changed in its file, in words."""
    reader: StoreReader
    has_all_generations: bool
    had_ended: bool
    """Whether its last session came to an end in order."""
    has_other_validation: bool
    """Whether the validation is asked for otherwise than before."""

    @classmethod
    def of(
        cls, run: Run, reader: StoreReader, settings: Iterable[str], budget: Mapping[str, float | None]
    ) -> Self:
        """Return what a run is to become.

        Args:
            run: that is resumed.
            reader: of its store.
            settings: as in `resume`.
            budget: generations, evaluations and seconds, None for those that stay.

        Raises InputError for what cannot change.
        """
        wanted = prolonged(run, run.experiment, settings, budget)
        edited, notes = edits.taken_over(run, wanted)
        if wanted.validate != run.experiment.validate:
            at_end.allow(wanted, run)
        experiment = prolonged(run, edited, settings, budget)
        return cls(
            experiment,
            notes,
            reader,
            has_all_generations=run.state == "done" and experiment.budget == run.experiment.budget,
            had_ended=any(session.outcome in {"done", "stopped"} for session in reader.sessions()[-1:]),
            has_other_validation=experiment.validate != run.experiment.validate,
        )

    def check_goes_on(self, run: Run, ended: Ended | None) -> None:
        """Raise NothingLeftError where a larger budget leaves nothing to evaluate: another limit ends it.

        Args:
            run: that is resumed.
            ended: what ends it after the generations that it has; None where it goes on.
        """
        budget = self.experiment.budget
        if ended is None or budget == run.experiment.budget:
            return
        how = (
            f"begin a new run with another one, from the best of this one: --set start_from={run.path}"
            if ended == "target"
            else f"raise that limit as well: --{ended} N"
        )
        raise NothingLeftError(
            f"{run.path}: with this budget nothing is left to evaluate, since "
            f"{budget.words(ended, run.generations, run.evaluations)}; {how}"
        )

    @cached_property
    def validation_is_due(self) -> bool:
        """Whether the best are to be validated still; of a run that has all generations."""
        changed = self.has_other_validation or not self.had_ended
        return is_due(self.experiment, self.reader, changed=changed)


def prolonged(
    run: Run, experiment: Experiment, settings: Iterable[str], budget: Mapping[str, float | None]
) -> Experiment:
    """Return the experiment with which a run goes on: with a larger budget, or evaluated elsewhere.

    Args:
        run: that goes on.
        experiment: with which it would go on otherwise.
        settings: as in `resume`.
        budget: generations, evaluations and seconds, None for those that stay.

    Raises InputError when something else is changed, or the budget is less than the run has.
    """
    require(experiment.method, run.path)
    # Neither imports the class: it may not be the one with which the run continues.
    new = experiment.with_settings(
        settings, only=ELSEWHERE | {"method"}, reason="a run goes on with what it has", ask=False
    )
    changes = {name: value for name, value in budget.items() if value is not None}
    if changes:
        options = {**new.to_mapping()["method"], **changes}
        try:
            method_options = type(new.method).model_validate(options)
        except ValidationError as error:
            found = problems_of(error, type(new.method))
            raise InputError("\n".join(f"{format_path(path)}: {words}" for path, words in found)) from error
        new = dataclasses.replace(new, method=method_options)
    limits: dict[str, Any] = vars(new.budget)
    old = experiment.method
    if new.method.model_dump(exclude=set(limits)) != old.model_dump(exclude=set(limits)):
        raise InputError("method: only its budget can be changed: generations, evaluations, seconds")
    method = method_of(old)
    if method.spreads_evaluations and limits["evaluations"] != experiment.budget.evaluations:
        raise InputError(
            "method.evaluations: cannot be changed, because the method has planned the whole run with them; "
            f"begin a new run with more, from the best of this one: --set start_from={run.path}"
        )
    used = {"generations": run.generations, "evaluations": run.evaluations, "seconds": 0}
    for name, before in vars(experiment.budget).items():
        if limits[name] is not None and limits[name] < (used[name] if before is None else before):
            has = f"the {used[name]} that the run has" if before is None else f"the experiment's {before}"
            raise InputError(f"{name}: {limits[name]} is less than {has}; a run can be prolonged, not cut")
    return new


class StrayedError(RunError):
    """A generation comes out differently: resuming again does not help."""


def strayed(
    reader: StoreReader, generation: int, components: Sequence[Component], edited: Sequence[str] = ()
) -> StrayedError:
    """Return the error for a generation that comes out differently when a run is resumed.

    Args:
        reader: of the run.
        generation: the first one that does.
        components: what the generation was made with.
        edited: in words, what was edited in the code of plug-ins since the run, and accepted.
    """
    return StrayedError(
        f"{reader.file}: the run cannot continue: generation {generation} comes out differently here"
        f"{_why(reader, components, edited)}"
    )


def _why(reader: StoreReader, components: Sequence[Component], edited: Sequence[str]) -> str:
    if edited:
        return (
            f", since the code that made it has changed: {', '.join(edited)}. Restore what was edited (the "
            f"run's copy is in {reader.file.parent / 'code'}), or start a new run"
        )
    first = reader.sessions()[0]
    then = {
        name: version for name, version in first.versions.items() if ":" not in name and name not in _NO_PART
    }
    now = versions([*then])
    others = [
        f"{name} {installed} (here {now.get(name, 'it is not installed')})"
        for name, installed in then.items()
        if now.get(name) != installed
    ]
    if others:
        return (
            f". It was begun with {', '.join(others)}; use these versions, on a machine of the same kind, or "
            "start a new run"
        )
    for component in components:
        if is_plug_in(type(component)):
            sort = next(name for base, name in _SORTS.items() if isinstance(component, base))
            return (
                f": the {sort} {component.kind} does not give the same {_output_of(sort)} again; "
                f"`swarmwright.testing.check_{sort}({component.kind!r})` finds out why. Start a new run"
            )
    state, commits = "", (first.versions.get(COMMIT), revision())
    if commits[0] is not None and commits[0] != commits[1]:
        state = f" (commit {commits[0]}; here {commits[1] or 'it is not known'})"
    elsewhere = ""
    if first.machine != platform.platform():
        elsewhere = f", or it needs a machine of the same kind as {first.machine}"
    return (
        " although the versions are the same: the store was changed, or the run was made by an earlier state "
        f"of this version{state}{elsewhere}; `swarmwright runs verify {reader.file.parent}` checks the store"
    )


def _output_of(sort: str) -> str:
    return "fitness" if sort == "ranking" else "genomes"


def refuse_cut_restart(reader: StoreReader, stored: GenerationResult, method: Method) -> None:
    """Raise InputError where a larger budget makes the last generation larger than it is in the store.

    Args:
        reader: of the run.
        stored: a generation that comes out differently when the run is resumed.
        method: of the run, which has been told of those before.
    """
    size = len(stored.fitness)
    by_generation = isinstance(method, SearchMethod) and method.options.operation == "generational"
    was_asked = by_generation and method.generation == stored.generation
    if was_asked and size < len(method.ask()) and stored.generation == len(reader.history()) - 1:
        folder = reader.file.parent
        raise InputError(
            f"method: {folder} cannot be prolonged, because its last restart had {size} candidates, the "
            "rest of its budget, and would have had more with a larger one; begin a new run with more, "
            f"from the best of this one: --set start_from={folder}"
        )
