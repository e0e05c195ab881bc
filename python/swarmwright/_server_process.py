"""One simulation server in a process of its own, started by `_local_servers`.

Arguments: a file descriptor, to which "ready" is written once, and the arguments of `_engine.serve` as JSON.
Standard input is a pipe from the parent: when it closes the parent is done or gone, however it ended, and so
is this process.
"""

import json
import os
import signal
import sys
import threading

from swarmwright import _engine

GRACE = 2.0
"""Seconds for saying good-bye to the broker."""


def _end_with_parent() -> None:
    try:
        while os.read(0, 1):
            pass
    finally:
        os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait(GRACE)
        os._exit(0)


def main() -> int:
    """Serve until the parent ends. Return the exit status."""
    ready = [int(sys.argv[1])]

    def on_event(line: str) -> None:
        # Only the first event is waited for; a pipe that nobody reads would fill up.
        if ready and json.loads(line).get("event") == "ready":
            descriptor = ready.pop()
            os.write(descriptor, b"ready\n")
            os.close(descriptor)

    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        _engine.serve(**json.loads(sys.argv[2]), on_event=on_event)
    except KeyboardInterrupt:
        return 0
    except (_engine.InputError, _engine.EngineError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
