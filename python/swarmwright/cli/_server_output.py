"""`--server-output`: the last that started servers printed."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from swarmwright.cli._output import aside

LINES = 20


@contextmanager
def _shown() -> Iterator[None]:
    from swarmwright.servers.supervision import listening_to_output

    last: deque[str] = deque(maxlen=LINES)
    try:
        with listening_to_output(last.append):
            yield
    finally:
        if last:
            aside(f"The last output of the servers ({LINES} lines at most):", last)


def _wanted(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        context.with_resource(_shown())


def server_output_option(command: Any) -> Any:  # noqa: ANN401 - click's decorators
    """`--server-output`, which a command need not know of."""
    option = click.option(
        "--server-output",
        is_flag=True,
        expose_value=False,
        callback=_wanted,
        help=f"At the end, show the last {LINES} lines that servers started here printed, on standard error.",
    )
    return option(command)
