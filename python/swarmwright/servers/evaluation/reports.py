"""Events of a run's evaluation, reported as they happen to listeners: logs, counters, progress displays.

A report is a mapping with an `event`, see `_engine.Pool.listen`. There are no listeners by default.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

Report = Mapping[str, Any]
Listener = Callable[[Report], None]

WARNINGS = frozenset({"warning", "broker_lost", "broker_back"})

_listeners: list[tuple[Listener, bool]] = []


@contextmanager
def listening(listener: Listener, *, warnings_only: bool = False) -> Iterator[None]:
    """Call `listener` with every report within the block; the run waits for it, so it must be quick.

    warnings_only: report only events in `WARNINGS`; others are not even created.
    """
    entry = (listener, warnings_only)
    _listeners.append(entry)
    try:
        yield
    finally:
        _listeners.remove(entry)


def has_listeners() -> bool:
    """Whether there is a listener."""
    return bool(_listeners)


def needs_only_warnings() -> bool:
    """Whether all listeners want only warnings."""
    return all(warnings_only for _, warnings_only in _listeners)


def tell(report: Report) -> None:
    """Pass a report to every listener that wants it."""
    for listener, warnings_only in tuple(_listeners):
        if not warnings_only or report["event"] in WARNINGS:
            listener(report)
