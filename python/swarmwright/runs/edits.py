"""Edits of a run's experiment.yaml. The file documents the run, which does not read it."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value
from swarmwright.common.values import flatten
from swarmwright.common.yaml import dump, read
from swarmwright.experiment.experiment import ELSEWHERE, Experiment, stored_experiment
from swarmwright.runs.store import StoreReader

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


FILE = "experiment.yaml"
_BUDGET = {"method.generations", "method.evaluations", "method.seconds"}
_NOTHING = object()


@dataclass(frozen=True)
class Change:
    """A key that has another value in the file than in the run."""

    key: str
    """With points: method.population."""
    recorded: Any
    now: Any

    @property
    def matters(self) -> bool:
        """Whether results depend on it, rather than where and how they are computed."""
        return self.key.partition(".")[0] not in ELSEWHERE

    def __str__(self) -> str:
        """Return key and values in words."""
        now, recorded = _value_in_words(self.now), _value_in_words(self.recorded)
        return f"{self.key} is {now} in the file, {recorded} in the run"


def changes(run: "Run") -> tuple[list[Change], Experiment]:
    """Return what differs between the file and the run as it is now, and the experiment as the file has it.

    No difference where the file is gone. Raises InputError when it is not an experiment.
    """
    file = run.path / FILE
    if not file.is_file():
        return [], run.experiment
    text, opened = file.read_bytes(), run._store.experiment()
    if text == dump(opened).encode():
        return [], run.experiment
    # The run may have been prolonged since it was opened, and the file with it.
    store = StoreReader(run.path)
    present = store.experiment()
    if text == dump(present).encode():
        return [], run.experiment
    written = Experiment._checked(read(file), file, ask=False)
    recorded = run.experiment if present == opened else stored_experiment(store, present)
    # A missing key means its default in both.
    return differences(recorded.to_mapping(), written.to_mapping()), written


def differences(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> list[Change]:
    """Return the keys in which two experiments differ."""
    before, after = flatten(dict(recorded)), flatten(dict(now))
    return [
        Change(key, before.get(key, _NOTHING), after.get(key, _NOTHING))
        for key in dict.fromkeys([*before, *after])
        if before.get(key, _NOTHING) != after.get(key, _NOTHING)
    ]


def in_words(run: "Run") -> str | None:
    """Return in words what was changed in the file, None when nothing was."""
    try:
        found, _ = changes(run)
    except InputError as error:
        return f"{run.path / FILE} was edited and cannot be read any more: {error}"
    if not found:
        return None
    return f"{run.path / FILE} was edited: {', '.join(map(str, found))}"


def taken_over(run: "Run", asked: Experiment) -> tuple[Experiment, list[str]]:
    """Return the experiment with which a run goes on, and what it has from the file, in words.

    Keys that say where and how it is computed are taken from the file.

    asked: the experiment with what options say, a larger budget for instance, which the file may hold, too.
    Raises InputError when something else was edited.
    """
    try:
        found, written = changes(run)
    except InputError as error:
        raise InputError(
            f"{error}\n{run.path / FILE} was edited since the run wrote it; restore it, or delete it, and it "
            "is written anew"
        ) from error
    options = flatten(asked.to_mapping())
    wrong = [change for change in found if change.matters and change.now != options.get(change.key, _NOTHING)]
    if wrong:
        lines = "".join(f"\n  {change}" for change in wrong)
        prolonged = all(change.key in _BUDGET for change in wrong)
        cure = "To prolong the run, give the option --generations, or --set. " if prolonged else ""
        raise InputError(
            f"{run.path / FILE} was edited, and a run goes on only with the experiment that it was begun "
            f"with:{lines}\n{cure}To go on with this run, restore these values, or delete the file, and it "
            f"is written anew. To use them, start another run: swarmwright optimize {run.path / FILE}"
        )
    moved = [change for change in found if change.key.partition(".")[0] in ELSEWHERE]
    if not moved:
        return run.experiment, []
    sections = {change.key.partition(".")[0] for change in moved}
    experiment = dataclasses.replace(run.experiment, **{key: getattr(written, key) for key in sections})
    return experiment, [
        f"{FILE}: {change.key} {_value_in_words(change.recorded)} -> {_value_in_words(change.now)}"
        for change in moved
    ]


def _value_in_words(value: Any) -> str:  # noqa: ANN401 - any value of a file
    return "not given" if value is _NOTHING else format_value(value)
