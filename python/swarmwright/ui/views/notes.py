"""Tags and a note of a run, and tags of several."""

import contextlib
from pathlib import Path
from typing import Any

from starlette.requests import Request

from swarmwright import InputError
from swarmwright.runs.annotations import Annotations, read_annotations, write_annotations
from swarmwright.ui.requests import read_field
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.views.runs import read_runs
from swarmwright.ui.window import Window


def read(window: Window, request: Request) -> Values:
    """Return the tags and the note of a run."""
    run = window.run(request)
    return {"tags": run.tags, "note": run.note}


def write(window: Window, values: dict[str, Any]) -> Values:
    """Set the note of a run, or add tags to runs, or take tags away from them: from all, or from none.

    Values: `runs`, and `note`, `add` or `remove`.
    """
    names = read_runs(window, values)
    added, removed = (
        split_tags(read_field({key: values.get(key, "")}, key, str)) for key in ("add", "remove")
    )
    note = values.get("note")
    if note is not None and len(names) > 1:
        raise InputError("note: is that of a single run")
    changes: dict[Path, tuple[Annotations, Annotations]] = {}
    for folder in map(window.index.path, names):
        before = read_annotations(folder)
        tags = [tag for tag in dict.fromkeys((*before.tags, *added)) if tag not in removed]
        text = before.note if note is None else read_field(values, "note", str)
        try:
            changes[folder] = before, Annotations(tuple(tags), text)
        except InputError as error:
            raise InputError(f"{folder}: {error}" if len(names) > 1 else str(error)) from None
    written: list[Path] = []
    try:
        for folder, (_, after) in changes.items():
            write_annotations(folder, after.tags, after.note)
            written.append(folder)
    except InputError:
        for folder in written:
            before = changes[folder][0]
            with contextlib.suppress(InputError):  # the first error is the one that is told
                write_annotations(folder, before.tags, before.note)
        raise
    return {"runs": names}


def split_tags(text: str) -> list[str]:
    """Return the tags of a text, in which commas separate them."""
    return [tag.strip() for tag in text.split(",") if tag.strip()]


VIEW = View(
    "notes",
    STATIC / "notes.js",
    "Notes",
    tab_of=lambda _run: True,
    answers={"notes": read},
    changes={"annotate": write},
)
