"""The command line. One module per command, imported when its command runs.

Exit status: 0 done, 1 the run failed, 2 the input is wrong, 130 interrupted with results kept.
"""

from swarmwright.cli._main import run

__all__ = ["run"]
