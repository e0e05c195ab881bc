"""The program `swarmwright`, also as `python -m swarmwright`."""

import gc
import os
import signal
import sys


def main() -> None:
    """Run the command line and leave with its exit status."""
    # What is imported is no garbage, yet would be looked through for some again and again.
    gc.set_threshold(100_000, 50, 50)
    # pydantic would look through all installed packages for plug-ins of its own.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        from swarmwright.cli import run

        status = run()
    except KeyboardInterrupt:  # while the program itself was loaded, or on the way out
        sys.stderr.write("swarmwright: interrupted\n")
        status = 130
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # what is left to do takes no time
    gc.freeze()  # nothing of worth is collected on the way out
    sys.exit(status)


if __name__ == "__main__":
    main()
