"""Plug-ins of installed packages, and errors of broken ones.

Packages announce plug-ins in their metadata, in a group of entry points for each kind; see the table in
docs/reference/python.md. Swarmwright announces some of its own parts in the same way.
"""

from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.untrusted import escape_line

OWN = "swarmwright"
"""Name of our own distribution."""


def find_entry_points(group: str) -> dict[str, list[EntryPoint]]:
    """Return the entry points of a group by name, without importing them."""
    points_by_name: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=group):
        points_by_name.setdefault(point.name, []).append(point)
    return points_by_name


def distribution(point: EntryPoint) -> str:
    """Return the name of the package that announces an entry point."""
    return escape_line(point.dist.name) if point.dist is not None else "unknown"


def describe_plug_in(noun: str, point: EntryPoint) -> str:
    """Describe a plug-in for messages: method 'climb' (climber:Climb, announced by the package climber)."""
    return (
        f"{noun} {point.name!r} ({escape_line(point.value)}, announced by the package {distribution(point)})"
    )


def choose_entry_point(noun: str, points: Sequence[EntryPoint]) -> EntryPoint:
    """Return the entry point of a name; Swarmwright's own if another package announces the same name.

    Raises InputError if two other packages announce different entry points.
    """
    points = [point for point in points if distribution(point) == OWN] or list(points)
    if len({point.value for point in points}) > 1:
        origins = " and ".join(
            sorted(
                f"{escape_line(entry_point.value)} by {distribution(entry_point)}" for entry_point in points
            )
        )
        raise InputError(
            f"{noun} {points[0].name!r} is announced twice, as {origins}; uninstall one of the packages"
        )
    return points[0]


def load_plug_in(noun: str, point: EntryPoint) -> Any:  # noqa: ANN401 - whatever a package announces
    """Import a plug-in. Raises InputError with its name and package if that fails."""
    try:
        return point.load()
    except SwarmwrightError:
        raise
    except (Exception, SystemExit) as error:  # a plug-in may fail in any way while it is imported
        raise InputError(
            f"{describe_plug_in(noun, point)} cannot be imported: {escape_line(repr(error))}"
        ) from error
