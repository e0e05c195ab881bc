"""Tasks: which groups of runs can be compared by a test of fitness."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from swarmwright.analysis.groups import RunGroup, names_of
from swarmwright.common.formatting import shorten
from swarmwright.experiment.robots import robot_of
from swarmwright.experiment.settings import ANNOUNCED
from swarmwright.runs.run import Run
from swarmwright.simulations.catalogue import ARENA, find_built_in

_FAILED = "ranking.failed"
"""If this option is a number, it is the fitness of a failed episode, in the run and on held-out seeds."""
_DEFINITIONS = ("fitness", "ranking.aggregate", "ranking.level", _FAILED)
"""Keys that define what fitness means."""
_SIMULATION = "simulation"
_MISSION = "parameters.mission"
_SCORE = ("title", "fitness", "metrics")
"""Parts of a mission that define its score."""
_MODELS = "e-puck-rm"
"""Prefix of the names of the e-puck's reference models in the arena."""
_ROBOTS = {f"{part}.robot{preset}" for part in ("parameters", _MISSION) for preset in ("", ".preset")}
"""Keys that may name a reference model."""
_LABEL_CHARACTERS = 120
"""Largest number of characters of a label."""
_NAMED = 3
"""Number of groups that `describe_untested` names."""


class Distinguished(Protocol):
    """A group of runs and its differences from other groups."""

    @property
    def differs(self) -> dict[str, Any]:
        """Keys of the experiment that differ between the groups, with this group's values."""

    @property
    def runs(self) -> tuple[Run, ...]:
        """Runs of the group; at least one."""


@dataclass(frozen=True)
class TaskGroups:
    """Groups whose runs solve the same task."""

    label: str
    """Description of what distinguishes the task from the others; empty if there is only one."""
    differs: dict[str, Any]
    """Keys of the experiment that differ between the tasks, with this task's values."""
    indices: tuple[int, ...]
    """Indices of its groups."""


def group_by_task(groups: Sequence[RunGroup], *, by: str, held_out: bool) -> list[TaskGroups]:
    """Return the groups by the task that they solve, in their order.

    A task is defined by the simulation, its parameters and the definition of fitness. A reference model of
    the arena's e-puck does not define a task, since it is the interface of a design to the same robot. Groups
    that differ only in parameters are kept together, since such a comparison is meant to show the parameters'
    effect; but not if their fitness has a different meaning, as in other missions.

    Args:
        groups: groups with the differences between them.
        by: compared quantity.
        held_out: whether it is fitness on held-out seeds, which is a mean over episodes with any ranking.
    """
    values = [
        {
            key: value
            for key, value in _make_task_groups(group).items()
            if _makes_task(key, by, held_out=held_out)
        }
        for group in groups
    ]
    every = dict.fromkeys(key for mapping in values for key in mapping)
    keys = [key for key in every if len({identity(mapping.get(key)) for mapping in values}) > 1]
    tasks: dict[str, tuple[dict[str, Any], list[int]]] = {}
    for index, mapping in enumerate(values):
        differs = {key: mapping.get(key) for key in keys}
        tasks.setdefault(identity(differs), (differs, []))[1].append(index)
    members_by_task = list(tasks.values())
    if len(members_by_task) == 1 or (
        len(members_by_task) == len(groups) and _differ_only_in_parameters(groups, keys)
    ):
        return [TaskGroups("", {}, tuple(range(len(groups))))]
    telling = _telling([differs for differs, _ in members_by_task])
    labels = names_of(
        [
            (indices_of_task, groups[indices[0]].runs[0])
            for indices_of_task, (_, indices) in zip(telling, members_by_task, strict=True)
        ]
    )
    return [
        TaskGroups(shorten(label, _LABEL_CHARACTERS), differs, tuple(indices))
        for label, (differs, indices) in zip(labels, members_by_task, strict=True)
    ]


def _telling(tasks: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the keys that distinguish each task from the others, the most distinctive first.

    The order matters because a label may be cut. Parameters that are equal for all tasks of a simulation are
    omitted, since other simulations do not have them.

    tasks: differing keys with their values, for each task.
    """
    of_simulation: dict[str, list[Mapping[str, Any]]] = {}
    for settings in tasks:
        of_simulation.setdefault(identity(settings.get(_SIMULATION)), []).append(settings)

    def apart(selected: Sequence[Mapping[str, Any]], keys: Collection[str]) -> int:
        return len({identity([task.get(key) for key in keys]) for task in selected})

    distinguishing = []
    for settings in tasks:
        alike = of_simulation[identity(settings.get(_SIMULATION))]
        waiting = [key for key in settings if not key.startswith("parameters.") or apart(alike, [key]) > 1]
        keys = [_SIMULATION] if _SIMULATION in waiting else []
        waiting = [key for key in waiting if key != _SIMULATION]
        while waiting:
            best = max(waiting, key=lambda key: apart(alike, [*keys, key]))
            waiting.remove(best)
            keys.append(best)
        distinguishing.append({key: settings[key] for key in keys})
    return distinguishing


def differing_parameters(groups: Sequence[Distinguished]) -> set[str]:
    """Return the parameters of the simulation in which groups solve different tasks."""
    values = [_make_task_groups(group) for group in groups]
    every = {key for value in values for key in value}
    return parameters_of([key for key in every if len({identity(value.get(key)) for value in values}) > 1])


def parameters_of(keys: Collection[str]) -> set[str]:
    """Return the parameters of the simulation among keys, except the seed, which does not define a task."""
    return {key.split(".")[1] for key in keys if key.startswith("parameters.")} - {"seed"}


def has_other_models(groups: Sequence[Distinguished]) -> bool:
    """Return whether groups have different reference models of one robot."""
    every = {key for group in groups for key in group.differs}
    return bool(every & _ROBOTS) and "robot" not in differing_parameters(groups)


def different_tasks() -> str:
    """Return a note that groups are tested only against groups with the same task."""
    return "groups solve different tasks, and those of one task are tested against each other"


def describe_untested(tasks: Sequence[tuple[Mapping[str, Any], Sequence[str]]]) -> str | None:
    """Describe which groups are alone in their task and therefore not tested, and how the tasks differ.

    None if no group is alone.

    Args:
        tasks: differences between the tasks, and the labels of each task's groups.
    """
    alone = [labels[0] for _, labels in tasks if len(labels) == 1]
    if len(tasks) == 1 or not alone:
        return None
    keys = {key for differs, _ in tasks for key in differs}
    others = {key for key in keys if not key.startswith("parameters.")}
    if len(alone) == 1:
        words = f"{alone[0]} is the only one of its task and is"
    elif len(alone) <= _NAMED:
        words = f"{'; '.join(alone)} are each the only one of their task and are"
    else:
        words = f"{len(alone)} groups are each the only one of their task and are"
    return (
        f"{words} tested against no other; tasks differ in {', '.join(sorted(parameters_of(keys) | others))}"
    )


def _makes_task(key: str, by: str, *, held_out: bool) -> bool:
    if key == _SIMULATION or parameters_of([key]):
        return True
    if by == "coverage":
        return False
    return key in _DEFINITIONS and not (held_out and key.startswith("ranking.") and key != _FAILED)


def _differ_only_in_parameters(groups: Sequence[RunGroup], keys: Collection[str]) -> bool:
    """Return whether groups differ only in parameters, and fitness means the same in all of them.

    keys: keys in which their tasks differ. Announced sizes follow from parameters.
    """
    every = {key for group in groups for key in group.differs}
    others = {key for key in every - set(keys) - set(ANNOUNCED) if key != "parameters.seed"}
    return not others and not any(map(_is_other_quantity, keys))


def _is_other_quantity(key: str) -> bool:
    """Return whether a differing key changes what fitness means, often including its units."""
    if not key.startswith("parameters."):
        return True
    return key == _MISSION or any(f"{key}.".startswith(f"{_MISSION}.{part}.") for part in _SCORE)


def _make_task_groups(distinguished: Distinguished) -> dict[str, Any]:
    """Return the differences of a group, with the robot in place of its reference model."""
    experiment = distinguished.runs[0].experiment
    differs = distinguished.differs
    if isinstance(differs.get(_FAILED), str):  # last and stop do not change what fitness means
        differs = {**differs, _FAILED: "last"}
    if find_built_in(experiment.simulation) != ARENA or not differs.keys() & _ROBOTS:
        return differs
    robot = robot_of(experiment.parameters)
    name = robot.get("preset") if isinstance(robot, Mapping) else robot
    if not isinstance(name, str) or not name.startswith(_MODELS):
        return differs
    return {key: "e-puck" if key in _ROBOTS else value for key, value in differs.items()}


def identity(value: Any) -> str:  # noqa: ANN401 - any value of an experiment
    """Return a text that is equal for equal values."""
    return json.dumps(value, sort_keys=True, default=str)
