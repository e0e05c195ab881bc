"""Kinds of agents with different sensors or actuators, as the groups of a team."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from swarmwright.common.alike import alike
from swarmwright.common.errors import InputError
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.suggestions import did_you_mean
from swarmwright.interop.models._model import Model
from swarmwright.interop.models._names import Known
from swarmwright.interop.models._parts import Member, Place, Problems
from swarmwright.simulations import catalogue

Groups = dict[str, tuple[dict[str, Any], Place]]
"""Options of the groups of a team by name, with what each comes from."""


def groups_of(model: Model, known: Known, parameters: Mapping[str, Any], kind: str) -> Groups:
    """Return the groups of a model's team.

    Args:
        model: with several kinds of agents.
        known: its simulation. Where it declares groups, they have its names, and numbers of agents, sensors
            and actuators are checked; else they state these numbers.
        parameters: of the simulation.
        kind: of the controllers.

    Raises:
        InputError: the groups are not those of the simulation, or agents cannot have a controller.
    """
    problems = Problems()
    for member in model.members:
        for what, ways, names in (("sensors", "in", member.sensors), ("actuators", "out", member.actuators)):
            if not names:
                problems.add(
                    member.place, f"has no {what} ({ways}); agents with a controller need at least one"
                )
    problems.stop()
    declared: list[DeclaredGroup] = []
    if known.description is not None:
        with suppress(InputError):  # parameters that the simulation refuses are reported with the experiment
            declared = catalogue.groups(known.simulation, dict(parameters))
    if not declared:
        return {member.name: ({"kind": kind, **_counts(member)}, member.place) for member in model.members}
    found = _matched(model, known.simulation, declared)
    return {one.name: ({"kind": kind}, found[one.name].place) for one in declared}


def _counts(member: Member) -> dict[str, int]:
    return {
        "agents": member.number,
        "sensors": len(member.sensors),
        "actuators": len(member.actuators),
    }


def _matched(model: Model, simulation: str, declared: list[DeclaredGroup]) -> dict[str, Member]:
    """Return the kinds of agents by the names of the simulation's groups. Raises InputError."""
    problems, found = Problems(), dict[str, Member]()
    names = [one.name for one in declared]
    for member in model.members:
        index = next(iter(alike(member.name, names)), None)
        if index is None:
            problems.add(
                member.place,
                f"is no group of agents of {simulation}{did_you_mean(member.name, names) or ';'} its groups: "
                f"{', '.join(names)}",
            )
            continue
        group = declared[index]
        if group.name in found:
            problems.add(member.place, f"is the same group as {found[group.name].name}; keep one")
        found[group.name] = member
        for what, number in _counts(member).items():
            expected = getattr(group, what)
            if number != expected:
                problems.add(
                    member.place, f"has {number} {what}, but {group.name} of {simulation} have {expected}"
                )
    missing = [name for name in names if name not in found]
    if missing and not problems.lines:
        problems.add(
            model.members[0].place,
            f"{simulation} has {' and '.join(missing)}, too; add a part with this name for each",
        )
    problems.stop()
    return found
