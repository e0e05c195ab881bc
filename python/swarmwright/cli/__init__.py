"""The command line. One module per command, imported when its command runs.

Exit status: 0 success, 1 failure, 2 invalid input, 130 interrupted (finished generations are kept).
"""

from collections.abc import Sequence


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status.

    arguments: without the program's name; by default those of the process.
    """
    from swarmwright.cli._main import run

    return run(arguments)


__all__ = ["run"]
