"""Designs: differences between groups other than their tasks; each has one colour and name in a figure."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swarmwright.analysis.groups import names_of, number_of
from swarmwright.analysis.labels import name_of
from swarmwright.analysis.tasks import identity
from swarmwright.common.formatting import format_count, shorten
from swarmwright.common.values import sort_key
from swarmwright.experiment.settings import SIZES

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Group, Task

_NAME_CHARACTERS = 120
"""Largest number of characters of a name."""


@dataclass(frozen=True)
class Design:
    """Groups that differ only in their task."""

    number: int
    """Its index among the designs sorted by name, which determines its colour in any order of the groups."""
    name: str
    """Description of what distinguishes it from other designs."""
    groups: "tuple[Group, ...]"

    @property
    def entry(self) -> str:
        """Its name with the numbers of counted and excluded runs of its groups."""
        counts = sorted({len(group.runs) for group in self.groups})
        few = "" if len(counts) == 1 else f"{counts[0]} to "
        lacking = sum(len(group.left_out) for group in self.groups)
        without = f", {lacking:,} left out" if lacking else ""
        return f"{self.name} ({few}{format_count(counts[-1], 'run')}{without})"


def designs_of(tasks: "Sequence[Task]", labels: Mapping[str, str] | None = None) -> list[Design]:
    """Return the designs of the groups of tasks, in the order of the groups.

    Keys in which tasks differ are omitted, as are numbers of sensors and actuators, which follow from other
    keys.

    labels: custom names of designs.
    """
    groups = [group for task in tasks for group in task.groups]
    keys = _keys(tasks)
    designs: dict[str, tuple[dict[str, Any], list[Group]]] = {}
    for group in groups:
        differs = {key: value for key, value in group.differs.items() if key in keys}
        designs.setdefault(identity(differs), (differs, []))[1].append(group)
    ordered = sorted(designs.values(), key=lambda design: sort_key(design[0], keys))
    if all(len(members) == 1 and differs == members[0].differs for differs, members in ordered):
        # The groups are numbered as in the table.
        ordered.sort(key=lambda design: number_of(design[1][0].label))
        names = [members[0].label for _, members in ordered]  # as in the table
    elif len(ordered) == 1:
        names = [name_of(groups[0].runs[0].experiment)]
    else:
        names = names_of([(differs, members[0].runs[0]) for differs, members in ordered])
    renamed = [(labels or {}).get(name, name) for name in names]
    found_designs = [
        Design(number, shorten(name, _NAME_CHARACTERS), tuple(members))
        for number, (name, (_, members)) in enumerate(zip(renamed, ordered, strict=True))
    ]
    places = {id(group): position for position, group in enumerate(groups)}
    return sorted(found_designs, key=lambda design: min(places[id(group)] for group in design.groups))


def _keys(tasks: "Sequence[Task]") -> set[str]:
    """Return the keys that define designs: those that differ within a task, or that do not define tasks."""
    of_tasks = {key for task in tasks for key in task.differs}
    within = {key for task in tasks for key in _differing(task.groups)}
    every = {key for task in tasks for group in task.groups for key in group.differs}
    keys = (every - of_tasks) | within
    fewer = keys - set(SIZES)
    return fewer if all(_are_distinct(task.groups, fewer) for task in tasks) else keys


def _differing(groups: "Sequence[Group]") -> set[str]:
    every = {key for group in groups for key in group.differs}
    return {key for key in every if len({identity(_select(group.differs, [key])) for group in groups}) > 1}


def _are_distinct(groups: "Sequence[Group]", keys: Collection[str]) -> bool:
    return len({identity(_select(group.differs, keys)) for group in groups}) == len(groups)


def _select(differs: Mapping[str, Any], keys: Collection[str]) -> dict[str, Any]:
    return {key: differs[key] for key in keys if key in differs}
