"""The views that there are: our own, and those of other packages."""

import re
from importlib import import_module

from swarmwright import InputError
from swarmwright.common.entry_points import (
    choose_entry_point,
    describe_plug_in,
    find_entry_points,
    load_plug_in,
)
from swarmwright.ui.views._base import View

GROUP = "swarmwright.views"
BUILT_IN = (
    "runs",
    "run",
    "compare",
    "new",
    "draw",
    "jobs",
    "servers",
    "genes",
    "front",
    "archive",
    "races",
    "progress",
    "timeline",
    "notes",
)
"""Modules in this folder, in the order of the navigation."""
NAME = re.compile("[a-z][a-z0-9_]*")


def load_views() -> tuple[View, ...]:
    """Return all views: our own first, then those of other packages by name.

    Raises InputError for a view that cannot be imported, is no View, or takes another's name or request.
    """
    views: list[View] = [import_module(f"swarmwright.ui.views.{name}").VIEW for name in BUILT_IN]
    names = {key for view in views for key in keys(view)}
    for name, points in sorted(find_entry_points(GROUP).items()):
        point = choose_entry_point("view", points)
        view = load_plug_in("view", point)
        label = describe_plug_in("view", point)
        if not isinstance(view, View):
            raise InputError(f"{label} is not a swarmwright.ui.views.View")
        if view.name != name or NAME.fullmatch(name) is None:
            raise InputError(
                f"{label}: its name is {view.name!r}; use that of the entry point, in lower-case letters, "
                "digits and '_'"
            )
        if not view.script.is_file():
            raise InputError(f"{label}: {view.script}: does not exist")
        duplicate = next((key for key in sorted(keys(view)) if key in names), None)
        if duplicate is not None:
            raise InputError(f"{label}: {duplicate} is taken by another view; begin its name with '{name}_'")
        names |= keys(view)
        views.append(view)
    return tuple(views)


def keys(view: View) -> set[str]:
    """Return the addresses of a view and of its requests."""
    requests = {f"/api/{key}" for group in (view.answers, view.asks, view.changes) for key in group}
    return {f"#/{view.name}", *requests, *(f"/{key}" for key in view.documents)}
