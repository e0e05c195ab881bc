"""Edits of a run's experiment.yaml, which documents the run but is not read by it."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value
from swarmwright.common.values import flatten
from swarmwright.common.yaml import dump, read
from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD, Experiment, load_stored_experiment
from swarmwright.runs.store import StoreReader

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


FILE = "experiment.yaml"
_BUDGET = {"method.generations", "method.evaluations", "method.seconds"}
_NOTHING = object()


@dataclass(frozen=True)
class Change:
    """A key whose value in the file differs from the run."""

    key: str
    """Dotted key: method.population."""
    recorded: Any
    now: Any

    @property
    def matters(self) -> bool:
        """Whether results depend on it, rather than only where and how they are computed."""
        return self.key.partition(".")[0] not in KEYS_OUTSIDE_RECORD

    def __str__(self) -> str:
        """Return the key and both values."""
        now, recorded = _format_value(self.now), _format_value(self.recorded)
        return f"{self.key} is {now} in the file, {recorded} in the run"


def changes(run: "Run") -> tuple[list[Change], Experiment]:
    """Return the differences between the file and the present run, and the experiment in the file.

    A missing file has no differences. Raises InputError when the file is not an experiment.
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
    written = Experiment._check_source(read(file), file, ask=False)
    recorded = run.experiment if present == opened else load_stored_experiment(store, present)
    # A missing key means its default value in both.
    return differences(recorded.to_mapping(), written.to_mapping()), written


def differences(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> list[Change]:
    """Return the keys in which two experiments differ."""
    before, after = flatten(dict(recorded)), flatten(dict(now))
    return [
        Change(key, before.get(key, _NOTHING), after.get(key, _NOTHING))
        for key in dict.fromkeys([*before, *after])
        if before.get(key, _NOTHING) != after.get(key, _NOTHING)
    ]


def describe_file_edits(run: "Run") -> str | None:
    """Describe the edits of the file, None if there are none."""
    try:
        edited_keys, _ = changes(run)
    except InputError as error:
        return f"{run.path / FILE} was edited and can no longer be read: {error}"
    if not edited_keys:
        return None
    return f"{run.path / FILE} was edited: {', '.join(map(str, edited_keys))}"


def adopt_file_edits(run: "Run", requested: Experiment) -> tuple[Experiment, list[str]]:
    """Return the experiment to continue a run with, and descriptions of the changes from the file.

    Keys that say where and how it is computed are taken from the file.

    requested: the experiment with options applied, such as a larger budget, which the file may have as well.
    Raises InputError when anything else was edited.
    """
    try:
        edited_keys, written = changes(run)
    except InputError as error:
        raise InputError(
            f"{error}\n{run.path / FILE} was edited since the run wrote it; restore it, or delete it to have "
            "it written again"
        ) from error
    options = flatten(requested.to_mapping())
    wrong = [
        change for change in edited_keys if change.matters and change.now != options.get(change.key, _NOTHING)
    ]
    if wrong:
        lines = "".join(f"\n  {change}" for change in wrong)
        prolonged = all(change.key in _BUDGET for change in wrong)
        remedy = "To prolong the run, use the option --generations or --set. " if prolonged else ""
        raise InputError(
            f"{run.path / FILE} was edited, but a run can only continue with its original experiment:{lines}"
            f"\n{remedy}To continue this run, restore these values, or delete the file to have it written "
            f"again. To use the new values, start another run: swarmwright optimize {run.path / FILE}"
        )
    moved = [change for change in edited_keys if change.key.partition(".")[0] in KEYS_OUTSIDE_RECORD]
    if not moved:
        return run.experiment, []
    sections = {change.key.partition(".")[0] for change in moved}
    experiment = dataclasses.replace(run.experiment, **{key: getattr(written, key) for key in sections})
    return experiment, [
        f"{FILE}: {change.key} {_format_value(change.recorded)} -> {_format_value(change.now)}"
        for change in moved
    ]


def _format_value(value: Any) -> str:  # noqa: ANN401 - any value of a file
    return "not set" if value is _NOTHING else format_value(value)
