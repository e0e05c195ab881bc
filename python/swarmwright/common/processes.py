"""Forked processes: the engine's threads do not survive a fork, and a child would wait for them forever."""

import os

from swarmwright.common.errors import RunError

_process: int | None = None
"""That in which the engine's threads were first used; a forked child has the number of its parent here."""


def use_threads() -> None:
    """Note that the engine's threads are used in this process.

    Raises RunError when the process was forked from one that has used them.
    """
    global _process  # noqa: PLW0603 - one for the process, as the threads are
    here = os.getpid()
    if _process is None:
        _process = here
    elif _process != here:
        raise RunError(
            f"the engine cannot be used in process {here}, which was forked from process {_process} after "
            "that had used it: the engine's threads do not survive a fork; start processes by "
            'multiprocessing.get_context("spawn") or "forkserver", environments of Gymnasium by '
            'AsyncVectorEnv(.., context="forkserver"), or use the engine only after the fork'
        )
