"""Warnings that appear once in a process."""

import logging

_given: set[str] = set()
"""Keys of the issued warnings."""


def warn_once(text: str, *, key: str | None = None) -> None:
    """Log a warning unless this process has logged it before.

    A cause may occur often: for every run of a sweep or of a loop in a notebook, for every candidate. A new
    process warns again.

    Args:
        text: text of the warning, with its subject, so that the warnings of two runs differ.
        key: shared key of warnings that count as one although their texts differ; default: the text.
    """
    identity = text if key is None else key
    if identity not in _given:
        _given.add(identity)
        logging.getLogger("swarmwright").warning("%s", text)
