"""The command line. One module per command, imported when its command runs.

Exit status: 0 done, 1 the run failed, 2 the input is wrong, 130 interrupted; finished
generations, if any, are kept.
"""

from collections.abc import Sequence


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status.

    arguments: without the program's name; by default those of the process.
    """
    from swarmwright.cli._main import run

    return run(arguments)


__all__ = ["run"]
