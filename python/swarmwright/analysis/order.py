"""The order of groups and tasks in tables and figures, which is the same in both."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

from swarmwright.analysis.groups import number_of
from swarmwright.common.errors import InputError
from swarmwright.common.problems import shown
from swarmwright.common.sort_keys import sort_key

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Group
    from swarmwright.analysis.tasks import TaskGroups

Named = Literal["rank", "name", "given"]
Order: TypeAlias = Named | Sequence[str]
"""By rank (the best median first), by name, as the runs were given, or labels, of which the others come
last."""


def check_order(order: object, groups: "Sequence[Group]") -> None:
    """Raise InputError unless groups can be put in this order."""
    if isinstance(order, str):
        if order not in get_args(Named):
            names = ", ".join(get_args(Named))
            raise InputError(f"order: must be one of {names}, or a list of labels, not {shown(order)}")
        return
    if not isinstance(order, Sequence):
        raise InputError(f"order: must be a name or a list of labels, not {shown(order)}")
    labels = [one.label for one in groups]
    unknown = [name for name in order if name not in labels]
    if unknown:
        known = ", ".join(map(repr, labels))
        raise InputError(f"order: there is no group {unknown[0]!r}; there are {known}")


def in_order(groups: "Sequence[Group]", order: Order) -> "list[Group]":
    """Return the groups of a task in an order that `check_order` takes."""
    if order == "given":
        return list(groups)
    keys = {key for one in groups for key in one.differs}
    # Numbers of groups follow the order of the runs; others do not depend on it.
    named = sorted(groups, key=lambda one: (number_of(one.label), sort_key(one.differs, keys)))
    if order == "name":
        return named
    ranked = sorted(named, key=lambda one: -one.median)
    if order == "rank":
        return ranked
    places = {label: place for place, label in enumerate(order)}
    return sorted(ranked, key=lambda one: places.get(one.label, len(places)))


def tasks_in_order(tasks: "Sequence[TaskGroups]", order: Order) -> "list[TaskGroups]":
    """Return tasks in an order that does not depend on that of the runs, unless it is to be that."""
    if order == "given":
        return list(tasks)
    keys = {key for task in tasks for key in task.differs}
    return sorted(tasks, key=lambda task: sort_key(task.differs, keys))
