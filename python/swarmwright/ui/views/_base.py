"""What a view is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from starlette.requests import Request
from starlette.responses import Response

from swarmwright import Run
from swarmwright.ui.window import Window

STATIC = Path(__file__).parents[1] / "static"
Values: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True)
class View:
    """A page of the window, or a tab on the page of a run.

    Requests are computed in threads, never on the event loop. What they raise as `SwarmwrightError` is
    answered with status 422 and `{"error": message}`.

    Args:
        name: of its address, `#/name`; lower-case letters, digits and `_`.
        script: ES module. It exports `show(element, query, argument)` for a page, where `argument` is what
            follows `#/name/`, or `show(element, run)` for a tab, where `run` has `id`, `details` (of the
            request `run`, kept up to date) and `replay(candidate, isBeside)`. It may return an object with
            functions: `leave()` is called before something else is shown, `isChanged()` returns whether
            changes would be lost then, so that the user is asked first, and `update()` of a tab shows that
            the run has gone on. `trail` of a page is a list of words for the title. The script's folder is
            served, too.
        title: in the navigation, or on the tab; empty for pages that only links lead to.
        tab_of: for a tab, returns whether a run has it; None: a page.
        is_for_changes: whether a read-only window leaves it out of the navigation.
        answers: computes the values of GET requests to `/api/KEY`, as JSON, or a response such as a file.
        asks: the same for POST requests with an object of JSON that change nothing.
        changes: the same for those that change something, which a read-only window refuses.
        documents: computes HTML documents at `/KEY`, such as replays, for sandboxed frames.
    """

    name: str
    script: Path
    title: str = ""
    tab_of: Callable[[Run], bool] | None = None
    is_for_changes: bool = False
    answers: Mapping[str, Callable[[Window, Request], Values | Response]] = field(default_factory=dict)
    asks: Mapping[str, Callable[[Window, dict[str, Any]], Values]] = field(default_factory=dict)
    changes: Mapping[str, Callable[[Window, dict[str, Any]], Values]] = field(default_factory=dict)
    documents: Mapping[str, Callable[[Window, Request], str]] = field(default_factory=dict)
