"""What a run that is resumed is to become: prolonged, or evaluated elsewhere."""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

from pydantic import ValidationError

from swarmwright.common.errors import InputError
from swarmwright.common.problems import problems_of
from swarmwright.common.yaml import dotted_path
from swarmwright.experiment.budget import Ended
from swarmwright.experiment.experiment import ELSEWHERE, Experiment
from swarmwright.experiment.unavailable import method_of, require
from swarmwright.runs import edits
from swarmwright.runs.run import Run
from swarmwright.runs.store import StoreReader
from swarmwright.runs.transfer import at_end
from swarmwright.runs.validation import is_due


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
            had_ended=any(one.outcome in {"done", "stopped"} for one in reader.sessions()[-1:]),
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
            raise InputError("\n".join(f"{dotted_path(path)}: {words}" for path, words in found)) from error
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
