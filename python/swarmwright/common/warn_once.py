"""Warnings that appear once in a process, however often their cause is met."""

import logging

_given: set[str] = set()
"""Keys of the warnings that were given."""


def warn_once(text: str, *, key: str | None = None) -> None:
    """Log a warning unless this process has logged it before.

    A process may meet a cause often: for every run of a sweep or of a loop in a notebook, for every
    candidate. A new process, such as another call of the program, warns again.

    Args:
        text: of the warning; it names what it is about, so that the warnings of two runs differ.
        key: what is the same for warnings that count as one although their texts differ; default: the text.
    """
    known = text if key is None else key
    if known not in _given:
        _given.add(known)
        logging.getLogger("swarmwright").warning("%s", text)
