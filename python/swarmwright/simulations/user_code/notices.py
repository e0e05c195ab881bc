"""Warnings about source that has changed since a run."""

from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.user_code.changes import near, summary
from swarmwright.simulations.user_code.copying import Copy, Kept
from swarmwright.simulations.user_code.parts import Part


def copy_is_used(copy: Copy, kept: Kept, now: Part, hint: str = "") -> None:
    """Say once that the simulation is the run's copy, as what it was copied from has changed.

    hint: what else can be done, from its semicolon on; where it differs, the warning is the same.
    """
    text = f"{near(copy.run.absolute())}: {summary(kept, now)} since; the copy in the run is used"
    warn_once(f"{text}{hint}", key=text)
