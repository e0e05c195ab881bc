"""Sides of a match: what a class declares is checked when it is read, and known wherever it runs."""

from collections.abc import Mapping
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Side
from swarmwright.common.groups import DeclaredSide
from swarmwright.simulations import catalogue
from swarmwright.simulations.base import Group
from swarmwright.simulations.host import Host, describe
from tests.python.simulations.pursuit import Pursuit


class Misspelt(Pursuit):
    """A class with a mistake in its sides."""

    sides: Mapping[str, Side] = {"hunters": Side(), "pray": Side()}


def declared(sides: Any, **attributes: Any) -> tuple[DeclaredSide, ...]:
    return describe(type("Match", (Pursuit,), {"sides": sides, **attributes})()).sides


def test_a_side_has_the_group_of_its_name_by_default() -> None:
    sides = {"prey": Side(fitness="distance"), "others": Side(groups=["hunters"])}
    assert declared(sides) == (
        DeclaredSide("prey", ("prey",), "distance"),
        DeclaredSide("others", ("hunters",), None),
    )
    groups = {name: Group(1, 1, 1) for name in ("a", "b", "c")}
    found = declared({"one": Side(("c", "a")), "b": Side()}, groups=groups)
    assert [side.groups for side in found] == [("c", "a"), ("b",)]


def test_each_of_several_groups_is_a_side_by_default() -> None:
    assert declared({}) == (DeclaredSide("hunters", ("hunters",)), DeclaredSide("prey", ("prey",)))
    assert declared({}, groups={}, sensors=1, actuators=1) == ()
    # They could not be announced.
    assert declared({}, groups={str(index): Group(1, 1, 1) for index in range(257)}) == ()
    assert declared({}, groups={"x" * 101: Group(1, 1, 1), "y": Group(1, 1, 1)}) == ()


def test_every_group_belongs_to_a_side() -> None:
    groups = {name: Group(1, 1, 1) for name in ("a", "b", "ball")}
    with pytest.raises(InputError, match=r"Match.sides: ball missing; each group belongs to a side"):
        declared({"a": Side(), "b": Side()}, groups=groups)
    with pytest.raises(InputError, match="there is no group 'a'; available: none"):
        declared({"a": Side(), "b": Side()}, groups={}, sensors=1, actuators=1)


def test_an_experiment_is_refused_if_sides_are_wrong() -> None:
    with pytest.raises(InputError, match=r"Misspelt.sides\['pray'\].groups: there is no group 'pray'"):
        Experiment.from_mapping({"simulation": Misspelt, "controller": {"kind": "layered"}})


def test_the_engine_is_told_of_them() -> None:
    kind = type("Match", (Pursuit,), {"sides": {"hunters": Side(), "prey": Side(fitness="distance")}})
    assert Host(kind).sides == [("hunters", ["hunters"], None), ("prey", ["prey"], "distance")]


def test_sides_of_built_in_simulations_depend_on_their_parameters() -> None:
    assert catalogue.sides("minisim", {}) == []
    found = catalogue.sides("minisim", {"defenderSteering": "controller"})
    assert found == [DeclaredSide("agents", ("agents",)), DeclaredSide("defenders", ("defenders",))]
