"""Grouping of runs whose experiments differ only in the seed."""

import json
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swarmwright.analysis.labels import Wording, kind_of, name_of, telling
from swarmwright.analysis.sweep_folders import keys_of_grid
from swarmwright.common.errors import InputError
from swarmwright.common.formatting import shorten
from swarmwright.common.values import flatten
from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD, Experiment
from swarmwright.experiment.robots import mission_name, mission_of, robot_of
from swarmwright.runs.run import Run
from swarmwright.simulations.catalogue import ARENA, description, find_built_in
from swarmwright.simulations.user_code.copying import Copy, compute_digest, display_name

_NO_GROUP = KEYS_OUTSIDE_RECORD | {"seed"}
"""Keys of an experiment that may differ within a group."""
_NAME_CHARACTERS = 120
"""Largest number of characters of a name; groups with longer names are numbered and explained in a note."""
_NUMBER = re.compile(r"group (\d+): ")
"""Beginning of the labels of such groups."""
_BEGINNING = 60
"""Characters that are kept of a longer name."""
_TOLD = 500
"""Characters of such a name in a note."""
_PATHS = 3
"""Number of runs that a note names."""
_NAMED = ("mission", "robot")
"""Parameters of the arena that may be mappings with many keys, for which a name can stand."""
_ROBOT = "parameters.robot"


@dataclass(frozen=True)
class RunGroup:
    """Runs whose experiments differ only in the seed, and what distinguishes them from the other groups."""

    label: str
    differs: dict[str, Any]
    """Keys of the experiment that differ between the groups, with this group's values."""
    runs: tuple[Run, ...]


def group(runs: Sequence[Run], *, besides: Collection[str] = ()) -> tuple[list[RunGroup], list[str]]:
    """Group runs by the differences between their experiments, in the given order.

    A run that is given twice, or repeated with the same experiment and seed, counts once, since it is not a
    second sample.

    besides: further keys that may differ within a group, such as parameters.seed.

    Returns:
        The groups, and notes on excluded runs.
    """
    distinct_runs, notes = _remove_repetitions(runs)
    # A named mission is written out if others are changed in parts, so that only these parts differ.
    missions = any(isinstance(run.experiment.parameters.get("mission"), Mapping) for run in distinct_runs)
    # Changes of single parts of the code are known only for runs with a copy of it.
    parts = all(not run.code or _code_parts(run) is not None for run in distinct_runs)
    flattened = [
        {
            key: value
            for key, value in flatten_experiment(run, missions=missions, parts=parts).items()
            if key not in besides
        }
        for run in distinct_runs
    ]
    titles = collect_mission_names(distinct_runs)
    by_values: dict[str, tuple[dict[str, Any], list[Run]]] = {}
    for run, values, keys in zip(distinct_runs, flattened, differing_keys(flattened), strict=True):
        differs = {key: values.get(key) for key in keys}
        if differs.get(_ROBOT, "") is None:
            differs[_ROBOT] = _robot(run.experiment)
        same = json.dumps(differs, sort_keys=True, default=str)
        by_values.setdefault(same, (restore_mission_names(differs, run, titles), []))[1].append(run)
    if len(by_values) == 1:
        return [RunGroup(name_of(distinct_runs[0].experiment), {}, tuple(distinct_runs))], notes
    members_by_values = list(by_values.values())
    names = names_in_sweep(members_by_values) or names_of(
        [(differs, members[0]) for differs, members in members_by_values]
    )
    labels = names
    if max(map(len, names)) > _NAME_CHARACTERS:
        labels = [f"group {number}: {shorten(name, _BEGINNING)}" for number, name in enumerate(names, 1)]
        notes += [f"group {number} has {shorten(name, _TOLD)}" for number, name in enumerate(names, 1)]
    groups = [
        RunGroup(label, differs, tuple(members))
        for label, (differs, members) in zip(labels, members_by_values, strict=True)
    ]
    return groups, notes


def number_of(label: str) -> int:
    """Return the number of a group whose name is too long; 0 if it has none."""
    match = _NUMBER.match(label)
    return int(match[1]) if match else 0


def names_in_sweep(groups: Sequence[tuple[Mapping[str, Any], Sequence[Run]]]) -> list[str] | None:
    """Return names for groups of runs of a sweep from the keys of its grid, like the sweep's labels.

    None if the runs are not from one sweep, or differ in more than the grid.

    groups: differences between them, and their runs.
    """
    of_grid = keys_of_grid([run for _, members in groups for run in members])
    if of_grid is None:
        return None
    keys = iter(of_grid)
    titles = collect_mission_names(run for _, members in groups for run in members)
    named, kinds = [], []
    for differs, members in groups:
        values = {**restore_mission_names(flatten_experiment(members[0]), members[0], titles), **differs}
        of_runs = {next(keys) for _ in members}
        if len(of_runs) > 1:
            return None
        kinds.append(values)
        named.append(
            {
                key: value
                for name in of_runs.pop()
                for key, value in values.items()
                if key == name or (key in differs and key.startswith(f"{name}."))
            }
        )
    with_runs = zip(telling(named, kinds), groups, strict=True)
    names = names_of([(differs, members[0]) for differs, (_, members) in with_runs])
    return names if all(names) and len(set(names)) == len(names) else None


def _robot(experiment: Experiment) -> str | None:
    """Return the name of the arena's default robot if no robot is given; None for other simulations."""
    if find_built_in(experiment.simulation) != ARENA:
        return None
    robot = robot_of(experiment.parameters)
    return robot if isinstance(robot, str) else None


def names_of(groups: Sequence[tuple[Mapping[str, Any], Run]]) -> list[str]:
    """Return names for groups from their differences and one run of each.

    Named missions and robots stand for the differences in them, which are added if groups would have equal
    names.
    """
    keys = {key for differs, _ in groups for key in differs}
    named: dict[str, list[str]] = {}
    for parameter in _NAMED:
        if not any(_is_within(key, parameter) and key != f"parameters.{parameter}" for key in keys):
            continue  # nothing differs, or only names
        titles = [_title_of(parameter, run.experiment) for _, run in groups]
        if len(set(titles)) > 1:
            named[parameter] = titles
    wording = Wording([differs for differs, _ in groups])
    names, details = [], []
    for index, (differs, _) in enumerate(groups):
        heads = [titles[index] for titles in named.values() if titles[index]]
        hidden = {key for key in differs for parameter in named if _is_within(key, parameter)}
        if named:  # these keys follow from the robots
            hidden |= differs.keys() & {"sensors", "actuators"}
        remaining = {key: value for key, value in differs.items() if key not in hidden}
        names.append(", ".join([*heads, *wording.words(remaining, remaining)]))
        details.append({key: differs[key] for key in differs if key in hidden and differs[key] is not None})
    for name in set(names):
        alike = [index for index, other in enumerate(names) if other == name]
        if len(alike) == 1:
            continue
        distinguishing_keys = distinguishing([details[index] for index in alike])
        for index in alike:
            details_of_group = {
                key: value for key, value in details[index].items() if key in distinguishing_keys
            }
            names[index] = ", ".join(
                [word for word in (name, *wording.words(details_of_group, groups[index][0])) if word]
            )
    return names


def _is_within(key: str, parameter: str) -> bool:
    """Return whether a key is the mission or the robot, or a part of it."""
    return key == f"parameters.{parameter}" or key.startswith(f"parameters.{parameter}.")


def _title_of(parameter: str, experiment: Experiment) -> str:
    """Return the name of an experiment's mission or robot; empty if it has none."""
    value = experiment.parameters.get(parameter)
    if value is None and (parameter == "robot" or find_built_in(experiment.simulation) != ARENA):
        return ""
    if parameter == "robot":
        return f"robot {value.get('preset', 'of its own') if isinstance(value, Mapping) else value}"
    mission = mission_of(value)
    title = None if mission is None else mission.get("title")
    return f"mission {title or ('without a title' if isinstance(value, Mapping) else value)}"


def _remove_repetitions(runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Remove repeated runs; of two equal runs, the finished one or else the longer one is kept."""
    distinct_runs: dict[str, Run] = {}
    copies: dict[str, list[Run]] = {}
    folders: dict[str, Run] = {}
    repeated: dict[str, Run] = {}
    for run in runs:
        folder = str(run.path.resolve())
        if folder in folders:
            repeated[folder] = run
            continue
        folders[folder] = run
        same = json.dumps([flatten_experiment(run), run.experiment.seed], sort_keys=True, default=str)
        previous = distinct_runs.get(same)
        if previous is None:
            distinct_runs[same] = run
            continue
        longer, shorter = (run, previous) if _weight(run) > _weight(previous) else (previous, run)
        distinct_runs[same] = longer
        copies.setdefault(same, []).append(shorter)
    notes = [_describe_repeated(list(repeated.values()))] if repeated else []
    notes += [_describe_copies(distinct_runs[same], left_out) for same, left_out in copies.items()]
    return list(distinct_runs.values()), notes


def _weight(run: Run) -> tuple[bool, int]:
    return not run.interrupted, run.evaluations


def _describe_repeated(runs: Sequence[Run]) -> str:
    if len(runs) == 1:
        return f"{runs[0].path} is given more than once and counts once"
    return f"{len(runs):,} runs are given more than once and count once: {_paths(runs)}"


def _describe_copies(counted_run: Run, left_out: Sequence[Run]) -> str:
    """Describe why runs with the same experiment and seed as another one do not count."""
    if len(left_out) == 1:
        return (
            f"{left_out[0].path} has experiment and seed of {counted_run.path}, so it is not a second sample "
            "and does not count"
        )
    return (
        f"{len(left_out):,} runs have experiment and seed of {counted_run.path}, so they are not further "
        f"samples and do not count: {_paths(left_out)}"
    )


def _paths(runs: Sequence[Run]) -> str:
    more = f" and {len(runs) - _PATHS:,} more" if len(runs) > _PATHS else ""
    return f"{', '.join(str(run.path) for run in runs[:_PATHS])}{more}"


def collect_mission_names(runs: Iterable[Run]) -> dict[str, str]:
    """Return the names of the arena's missions in the first run of each, by their long names."""
    titles: dict[str, str] = {}
    for run in runs:
        simulation = run.experiment.simulation
        if find_built_in(simulation) != ARENA:
            continue
        mission = run.experiment.parameters.get("mission")
        if mission is None:
            mission = mission_name(_defaults(simulation)["mission"])
        if isinstance(mission, str):
            titles.setdefault(mission_name(mission), mission)
    return titles


def restore_mission_names(values: Mapping[str, Any], run: Run, missions: Mapping[str, str]) -> dict[str, Any]:
    """Return flattened values of a run with the name of the mission that the authors of the runs used.

    missions: see `collect_mission_names`; a mission with two names gets one of them, so that values are
    comparable.
    """
    key = "parameters.mission"
    name = values.get(key)
    if not isinstance(name, str) or find_built_in(run.experiment.simulation) != ARENA:
        return dict(values)
    return {**values, key: missions.get(name, name)}


def flatten_experiment(run: Run, *, missions: bool = False, parts: bool = True) -> dict[str, Any]:
    """Return the experiment with nested keys joined by dots, and the digest of its code.

    missions: write out the arena's named missions. parts: distinguish the parts of the code, as
    `code.simulation` and `code.method`, if the run has a copy.
    """
    experiment = run.experiment
    mapping = experiment.to_mapping()
    mapping["simulation"] = display_name(experiment.simulation)
    for key in ("method", "ranking"):
        mapping[key]["kind"] = display_name(mapping[key]["kind"])
    code = run.code
    if code:
        code_parts = _code_parts(run) if parts else None
        mapping["code"] = code[max(code)][:12] if code_parts is None else code_parts
    # Omitted parameters have their defaults, which are unknown for an external simulation.
    parameters = {**_defaults(experiment.simulation), **mapping.get("parameters", {})}
    if find_built_in(experiment.simulation) == ARENA:
        mission = parameters.get("mission")
        # `aac` and `aggregation` are names of the same mission.
        parameters["mission"] = (mission_of(mission) if missions else None) or mission_name(mission)
    mapping["parameters"] = parameters
    compared_keys = {key: value for key, value in mapping.items() if key not in _NO_GROUP}
    return {name: _plain(value) for name, value in flatten(compared_keys).items()}


def _code_parts(run: Run) -> dict[str, str] | None:
    """Return the beginning of the SHA-256 of each part of a run's code; None if its copy is missing."""
    version = max(run.code)
    try:
        copy = Copy.find(run.path, version)
        if copy is None or copy.digest != run.code[version]:
            return None
        return {name: compute_digest({name: part.digests})[:12] for name, part in copy.parts.items()}
    except InputError:
        return None


def _plain(value: Any) -> Any:  # noqa: ANN401 - any value of a file
    """Return a value with 1 in place of 1.0, since files and defaults may have either."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _defaults(simulation: str) -> dict[str, Any]:
    if find_built_in(simulation) is None:
        return {}
    parameters = description(simulation)["parameters"]
    return {name: parameter.get("default") for name, parameter in parameters.items()}


def distinguishing(flat: Sequence[dict[str, Any]]) -> list[str]:
    """Return the keys whose values differ, in the experiment's order.

    Options of a component are compared only among runs with the same kind of it, since other kinds do not
    have them.
    """
    return list(_varying(flat))


def differing_keys(flat: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return for each experiment the keys in which it differs from others with the same kind of component.

    Options that are equal within a kind, or that the kind does not have, are excluded; a parameter, or a key
    of the experiment itself such as fitness, also counts if its author omitted it.
    """
    kinds = _varying(flat)
    return [
        [
            key
            for key, among in kinds.items()
            if key.startswith("parameters.")
            or "." not in key
            or (key in values and kind_of(key, values) in among)
        ]
        for values in flat
    ]


def _varying(flat: Sequence[Mapping[str, Any]]) -> dict[str, set[Any]]:
    """Return the keys whose values differ, with the kinds of component among which they differ."""
    varying = {}
    for key in dict.fromkeys(key for values in flat for key in values):
        values_of: dict[Any, set[str]] = {}
        for values in flat:
            if key in values or not key.startswith("code."):
                text = json.dumps(values.get(key), sort_keys=True, default=str)
                values_of.setdefault(kind_of(key, values), set()).add(text)
        kinds = {kind for kind, texts in values_of.items() if len(texts) > 1}
        if kinds:
            varying[key] = kinds
    return varying
