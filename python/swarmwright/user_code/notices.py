"""Warnings about source that has changed since a run, once per process."""

import logging

from swarmwright.user_code.changes import near, summary
from swarmwright.user_code.copying import Copy, Kept
from swarmwright.user_code.parts import Part

_told: set[str] = set()


def copy_is_used(copy: Copy, kept: Kept, now: Part, hint: str = "") -> None:
    """Say that the simulation is the run's copy, as what it was copied from has changed."""
    say(f"{near(copy.run.absolute())}: {summary(kept, now)} since; the copy in the run is used{hint}")


def say(text: str) -> None:
    """Warn of something once; the text after a semicolon may differ."""
    key = text.partition(";")[0]
    if key not in _told:
        _told.add(key)
        logging.getLogger("swarmwright").warning("%s", text)
