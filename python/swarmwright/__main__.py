"""The program `swarmwright`, also as `python -m swarmwright`."""

import sys


def main() -> None:
    """Run the command line and leave with its exit status."""
    from swarmwright.cli import run

    sys.exit(run())


if __name__ == "__main__":
    main()
