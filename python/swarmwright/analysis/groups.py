"""Grouping of runs whose experiments differ only in the seed."""

import json
import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swarmwright.core.errors import InputError
from swarmwright.core.flatten import flat
from swarmwright.experiment.experiment import ELSEWHERE, Experiment
from swarmwright.experiment.robots import mission_name, mission_of
from swarmwright.runs.run import Run
from swarmwright.simulations.catalogue import ARENA, built_in, description
from swarmwright.user_code.copying import Copy, digest_of, shown

_NO_GROUP = ELSEWHERE | {"seed"}
"""Keys of an experiment in which runs of a group may differ."""
_LONGEST = 120
"""Characters of a name, beyond which groups are numbered and a note explains them."""
_BEGINNING = 60
"""Characters of a longer name that stay."""
_TOLD = 500
"""Characters of it in a note."""
_NAMED = ("mission", "robot")
"""The arena's parameters that may be mappings with many keys, and have a name that stands for these."""


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
    # What changed in the code is known of runs that hold their copy; of others, whether anything has.
    parts = all(not run.code or _code_parts(run) is not None for run in kept)
    flattened = [
        {
            key: value
            for key, value in flattened_of(run, missions=missions, parts=parts).items()
            if key not in besides
        }
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
    if len(found) == 1:
        return [RunGroup(name_of(kept[0].experiment), {}, tuple(kept))], notes
    names = _names([(differs, members[0]) for differs, members in found.values()])
    labels = names
    if max(map(len, names)) > _LONGEST:
        labels = [
            f"group {number}: {textwrap.shorten(name, _BEGINNING, placeholder=' …')}"
            for number, name in enumerate(names, 1)
        ]
        notes += [
            f"group {number} has {textwrap.shorten(name, _TOLD, placeholder=' …')}"
            for number, name in enumerate(names, 1)
        ]
    groups = [
        RunGroup(label, differs, tuple(members))
        for label, (differs, members) in zip(labels, found.values(), strict=True)
    ]
    return groups, notes


def _names(groups: Sequence[tuple[Mapping[str, Any], Run]]) -> list[str]:
    """Return what groups are called, by what differs between them and one run of each.

    Missions and robots that have names of their own stand for what differs in them; where groups would have
    one name, that is added.
    """
    keys = {key for differs, _ in groups for key in differs}
    named: dict[str, list[str]] = {}
    for what in _NAMED:
        if not any(_within(key, what) and key != f"parameters.{what}" for key in keys):
            continue  # nothing differs, or names alone
        found = [_called(what, run.experiment) for _, run in groups]
        if len(set(found)) > 1:
            named[what] = found
    names, details = [], []
    for index, (differs, _) in enumerate(groups):
        heads = [found[index] for found in named.values() if found[index]]
        hidden = {key for key in differs for what in named if _within(key, what)}
        if named:  # they follow from the robots
            hidden |= differs.keys() & {"sensors", "actuators"}
        shown = {key: value for key, value in differs.items() if key not in hidden}
        names.append(", ".join([*heads, *_words(shown, shown)]))
        details.append({key: differs[key] for key in differs if key in hidden and differs[key] is not None})
    for name in set(names):
        alike = [index for index, one in enumerate(names) if one == name]
        if len(alike) == 1:
            continue
        telling = distinguishing([details[index] for index in alike])
        for index in alike:
            of = {key: value for key, value in details[index].items() if key in telling}
            names[index] = ", ".join([word for word in (name, *_words(of, groups[index][0])) if word])
    return names


def _within(key: str, what: str) -> bool:
    """Return whether a key is that of the mission, or of the robot, or within it."""
    return key == f"parameters.{what}" or key.startswith(f"parameters.{what}.")


def _called(what: str, experiment: Experiment) -> str:
    """Return what an experiment's mission or robot is called, in words; nothing where it has none."""
    given = experiment.parameters.get(what)
    if given is None and (what == "robot" or built_in(experiment.simulation) != ARENA):
        return ""
    if what == "robot":
        return f"robot {given.get('preset', 'of its own') if isinstance(given, Mapping) else given}"
    found = mission_of(given)
    title = None if found is None else found.get("title")
    return f"mission {title or ('without a title' if isinstance(given, Mapping) else given)}"


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


def flattened_of(run: Run, *, missions: bool = False, parts: bool = True) -> dict[str, Any]:
    """Return the experiment with nested keys joined by points, and what its code is.

    missions: write out the arena's missions that are named. parts: tell the code of its parts apart, as
    `code.simulation` and `code.method`, where the run holds its copy.
    """
    experiment = run.experiment
    mapping = experiment.to_mapping()
    mapping["simulation"] = shown(experiment.simulation)
    code = run.code
    if code:
        found = _code_parts(run) if parts else None
        mapping["code"] = code[max(code)][:12] if found is None else found
    # A parameter that is not given has its default; defaults of an external simulation are not known.
    parameters = {**_defaults(experiment.simulation), **mapping.get("parameters", {})}
    if built_in(experiment.simulation) == ARENA:
        given = parameters.get("mission")
        # `aac` and `aggregation` are one mission.
        parameters["mission"] = (mission_of(given) if missions else None) or mission_name(given)
    mapping["parameters"] = parameters
    kept = {key: value for key, value in mapping.items() if key not in _NO_GROUP}
    return {name: _plain(value) for name, value in flat(kept).items()}


def _code_parts(run: Run) -> dict[str, str] | None:
    """Return the beginning of the SHA-256 of each part of a run's code; None where its copy is gone."""
    version = max(run.code)
    try:
        copy = Copy.of(run.path, version)
        if copy is None or copy.digest != run.code[version]:
            return None
        return {name: digest_of({name: kept.digests})[:12] for name, kept in copy.parts.items()}
    except InputError:
        return None


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
    section, _, last = key.rpartition(".")
    kind_key = f"{section}.kind"
    if section == "code":  # of a component, which its kind names, or of the simulation
        kind_key = "simulation" if last == "simulation" else f"{last}.kind"
    found: dict[Any, set[str]] = {}
    for values in flat:
        if section == "code" and key not in values:
            continue
        kind = None if key == kind_key else values.get(kind_key)
        found.setdefault(kind, set()).add(json.dumps(values.get(key), sort_keys=True, default=str))
    return found


def label_of(differs: Mapping[str, Any]) -> str:
    """Return values that keys of an experiment have as words: kinds alone, others with their names."""
    return ", ".join(_words(differs, differs))


def _words(differs: Mapping[str, Any], among: Mapping[str, Any]) -> Iterator[str]:
    """Yield a word for each key; among: all keys, of which no two may look alike."""
    for key, value in differs.items():
        section, _, last = key.rpartition(".")
        # Parameters may have kinds, too, such as metrics of a mission.
        if key == "simulation" or (last == "kind" and section.partition(".")[0] != "parameters"):
            yield str(value)
            continue
        shown = (
            "not given"
            if value is None
            else value
            if isinstance(value, str)
            else _kinds(value)
            if key == "parameters.robots" and isinstance(value, list)
            else json.dumps(value, default=str, ensure_ascii=False)
        )
        short = shown if len(shown) <= 24 else f"{shown[:23]}…"
        yield f"{_shortest(key, among)} {short}"


def _kinds(robots: Sequence[Any]) -> str:
    """Return the kinds of robots of a mixed swarm: 12 scout, 4 carrier."""
    words = (f"{one.get('count', '')} {one.get('name', '')}" for one in robots if isinstance(one, Mapping))
    return ", ".join(word.strip() for word in words)


def _shortest(key: str, differs: Mapping[str, Any]) -> str:
    """Return the last part of a key, unless another one ends alike: runs themselves have a seed."""
    section, _, last = key.rpartition(".")
    if section == "code":
        return f"code of the {last}"
    if last == "kind":
        return key.removeprefix("parameters.")
    return last if last != "seed" and sum(other.rpartition(".")[2] == last for other in differs) == 1 else key


def name_of(experiment: Experiment) -> str:
    """Return what a single group is called: simulation and method."""
    method: str = experiment.method.kind
    return f"{experiment.label}, {method}"
