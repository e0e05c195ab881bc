"""What happens while a run is evaluated, told as it happens to whoever listens: logs, counters.

A report is a mapping with an `event`, see `_engine.Pool.listen`. Nobody listens by default.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

Report = Mapping[str, Any]
Listener = Callable[[Report], None]

_listeners: list[Listener] = []


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Within the block, `listener` gets every report; it must not take long, for a run waits for it."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def wanted() -> bool:
    """Whether anybody listens."""
    return bool(_listeners)


def tell(report: Report) -> None:
    """Give a report to everybody who listens."""
    for listener in tuple(_listeners):
        listener(report)
