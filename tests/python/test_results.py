"""The types of what the library returns can be named."""

import inspect
import typing
from collections.abc import Iterator
from functools import cached_property
from types import GenericAlias
from typing import Any

import swarmwright
from swarmwright import Episodes, Run, compare, results

NAMED = {name: getattr(swarmwright, name) for name in swarmwright.__all__} | {
    name: getattr(results, name) for name in results.__all__
}


def test_what_is_returned_is_of_these_types(finished: Run) -> None:
    comparison = compare([finished])
    found: dict[str, object] = {
        "Best": finished.best,
        "ComparedGroup": comparison.groups[0],
        "Evaluation": finished.evaluation(0, 0),
        "Indicator": comparison.indicator,
        "Observation": Episodes("minisim").observe(),
        "RecordTable": finished.record,
        "ReplayPage": finished.replay(),
        "Session": finished.sessions[0],
        "Summary": finished.history[0],
        "Task": comparison.tasks[0],
    }
    for name, value in found.items():
        assert name in results.__all__
        assert type(value) is getattr(results, name), name


def attributes(kind: type) -> Iterator[tuple[str, Any]]:
    """The public attributes of a class that are declared, with their types."""
    yield from typing.get_type_hints(kind, localns=NAMED).items()
    for base in kind.__mro__:
        for name, value in vars(base).items():
            getter = value.fget if isinstance(value, property) else getattr(value, "func", None)
            if isinstance(value, property | cached_property) and base.__module__.startswith("swarmwright"):
                yield name, typing.get_type_hints(getter, localns=NAMED)["return"]


def classes(hint: Any) -> Iterator[type]:
    """The classes in a type."""
    if inspect.isclass(hint) and not isinstance(hint, GenericAlias):
        yield hint
    for part in typing.get_args(hint):
        yield from classes(part)


def test_types_of_their_attributes_can_be_named() -> None:
    """Those of results; options of an experiment and base classes of plug-ins are in modules of their own."""
    found = {
        f"{kind.__name__}.{name}: {one.__name__}"
        for kind in NAMED.values()
        if inspect.isclass(kind) and kind is not swarmwright.Experiment
        for name, hint in attributes(kind)
        if not name.startswith("_")
        for one in classes(hint)
        if one.__module__.startswith("swarmwright.") and one not in NAMED.values()
    }
    rankings = {
        f"{name}.ranking: Ranking" for name in ("ControllerEvaluation", "PostEvaluation", "Transferred")
    }
    assert found == rankings, "swarmwright.rankings has it"
