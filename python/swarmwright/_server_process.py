"""One simulation server in a process of its own, for a run's own servers and for `swarmwright serve`.

Arguments: a file descriptor, to which events go as JSON lines (as `_engine.serve` reports them, and
{"event": "error", "message"} when it fails), then the arguments of `_engine.serve` as a JSON object. Standard
input is a pipe from the parent: when it closes the parent is done or gone, however it ended, and so is this
process.
"""

import json
import os
import signal
import sys
import threading
from contextlib import suppress

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
    """Serve until the parent ends; return 0, or the exit status of what went wrong."""
    events = int(sys.argv[1])

    def report(line: str) -> None:
        # Nobody reads: the parent wants no more, or it is gone, which `_end_with_parent` notices.
        with suppress(OSError):
            os.write(events, f"{line}\n".encode())

    # The parent may have been started with SIGINT ignored, as shells do in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        _engine.serve(**json.loads(sys.argv[2]), on_event=report)
    except KeyboardInterrupt:
        return 0
    except (_engine.InputError, _engine.EngineError) as error:
        report(json.dumps({"event": "error", "message": str(error)}))
        sys.stderr.write(f"{error}\n")
        return 2 if isinstance(error, _engine.InputError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
