"""Grouping of runs whose experiments differ only in the seed."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swarmwright.core.flatten import flat
from swarmwright.experiment.experiment import ELSEWHERE, Experiment
from swarmwright.experiment.robots import mission_of
from swarmwright.runs.run import Run
from swarmwright.simulations.catalogue import ARENA, built_in, description
from swarmwright.user_code.copying import shown

_NO_GROUP = ELSEWHERE | {"seed"}
"""Keys of an experiment in which runs of a group may differ."""


@dataclass(frozen=True)
class RunGroup:
    """Runs whose experiments differ only in the seed, and what distinguishes them from the other groups."""

    label: str
    differs: dict[str, Any]
    """Keys of the experiment that differ between the groups, with this group's values."""
    runs: tuple[Run, ...]


def group(runs: Sequence[Run], *, besides: Collection[str] = ()) -> tuple[list[RunGroup], list[str]]:
    """Group runs by what differs between their experiments, in the order in which they were given.

    besides: keys in which runs of a group may differ as well, such as parameters.seed.

    A run that is given twice, or was made again with the same experiment and seed, counts once: it is not a
    second sample.

    Returns:
        The groups, and notes on what was left out.
    """
    kept, notes = _once(runs)
    # Beside a mission whose parts were set, one that is named is written out: then only these parts differ.
    missions = any(isinstance(run.experiment.parameters.get("mission"), Mapping) for run in kept)
    flattened = [
        {key: value for key, value in flattened_of(run, missions=missions).items() if key not in besides}
        for run in kept
    ]
    keys = distinguishing(flattened)
    found: dict[str, tuple[dict[str, Any], list[Run]]] = {}
    for run, values in zip(kept, flattened, strict=True):
        # An option that a kind does not have is left out; a parameter, or a key of the experiment itself such
        # as fitness, may have been left out by its author.
        differs = {
            key: values.get(key)
            for key in keys
            if key in values or key.startswith("parameters.") or "." not in key
        }
        found.setdefault(json.dumps(differs, sort_keys=True, default=str), (differs, []))[1].append(run)
    groups = [RunGroup(label_of(differs), differs, tuple(members)) for differs, members in found.values()]
    if len(groups) == 1:
        groups = [RunGroup(name_of(kept[0].experiment), {}, groups[0].runs)]
    return groups, notes


def _once(runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Leave out runs that are the same as another one; of two, the longer one stays."""
    kept: dict[str, Run] = {}
    places: dict[str, str] = {}
    notes = []
    for run in runs:
        place = str(run.path.resolve())
        same = json.dumps([flattened_of(run), run.experiment.seed], sort_keys=True, default=str)
        other = kept.get(same)
        if place in places:
            notes.append(f"{run.path} is given twice and counts once")
            continue
        places[place] = same
        if other is None:
            kept[same] = run
            continue
        longer, shorter = (run, other) if run.evaluations > other.evaluations else (other, run)
        kept[same] = longer
        notes.append(
            f"{shorter.path} has experiment and seed of {longer.path}, so it is not a second sample and does "
            "not count"
        )
    return list(kept.values()), notes


def flattened_of(run: Run, *, missions: bool = False) -> dict[str, Any]:
    """Return the experiment with nested keys joined by points, and what its code is.

    missions: write out the arena's missions that are named.
    """
    experiment = run.experiment
    mapping = experiment.to_mapping()
    mapping["simulation"] = shown(experiment.simulation)
    code = run.code
    if code:
        mapping["code"] = code[max(code)][:12]
    # A parameter that is not given has its default; defaults of an external simulation are not known.
    parameters = {**_defaults(experiment.simulation), **mapping.get("parameters", {})}
    if missions and built_in(experiment.simulation) == ARENA:
        parameters["mission"] = mission_of(parameters.get("mission")) or parameters.get("mission")
    mapping["parameters"] = parameters
    kept = {key: value for key, value in mapping.items() if key not in _NO_GROUP}
    return {name: _plain(value) for name, value in flat(kept).items()}


def _plain(value: Any) -> Any:  # noqa: ANN401 - any value of a file
    """Return a value in which 1.0 is 1: files may hold either, as may defaults."""
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _defaults(simulation: str) -> dict[str, Any]:
    if built_in(simulation) is None:
        return {}
    parameters = description(simulation)["parameters"]
    return {name: parameter.get("default") for name, parameter in parameters.items()}


def distinguishing(flat: Sequence[dict[str, Any]]) -> list[str]:
    """Return the keys whose values differ, in the experiment's order.

    Options of a component count only among runs with the same kind of it: that an option of one kind is
    missing in another follows from the kind.
    """
    keys = list(dict.fromkeys(key for values in flat for key in values))
    return [key for key in keys if any(len(among) > 1 for among in _values(key, flat).values())]


def _values(key: str, flat: Sequence[dict[str, Any]]) -> dict[Any, set[str]]:
    """Return the values that a key has, for each kind of the component that it is an option of."""
    kind_key = f"{key.rpartition('.')[0]}.kind"
    found: dict[Any, set[str]] = {}
    for values in flat:
        kind = None if key == kind_key else values.get(kind_key)
        found.setdefault(kind, set()).add(json.dumps(values.get(key), sort_keys=True, default=str))
    return found


def label_of(differs: Mapping[str, Any]) -> str:
    """Return values that keys of an experiment have as words: kinds alone, others with their names."""
    words = []
    for key, value in differs.items():
        if key == "simulation" or key.endswith(".kind"):
            words.append(str(value))
        else:
            shown = (
                "not given"
                if value is None
                else value
                if isinstance(value, str)
                else json.dumps(value, default=str)
            )
            short = shown if len(shown) <= 24 else f"{shown[:23]}…"
            words.append(f"{_shortest(key, differs)} {short}")
    return ", ".join(words)


def _shortest(key: str, differs: Mapping[str, Any]) -> str:
    """Return the last part of a key, unless another one ends alike: runs themselves have a seed."""
    last = key.rpartition(".")[2]
    return last if last != "seed" and sum(other.rpartition(".")[2] == last for other in differs) == 1 else key


def name_of(experiment: Experiment) -> str:
    """Return what a single group is called: simulation and method."""
    method: str = experiment.method.kind  # type: ignore[attr-defined] # every kind's options have it
    return f"{experiment.label}, {method}"
