"""One simulation server in its own process, started and watched by `_supervisor`.

Arguments: the file descriptor to which events go, then a JSON object with the arguments of `_engine.serve`.
Standard input is a pipe from the parent: when it closes, the parent is gone and so is this process.
"""

import json
import os
import signal
import sys
import threading
from typing import TextIO


def _end_with_parent() -> None:
    try:
        while os.read(0, 1):
            pass
    finally:
        os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait(2.0)  # time to say good-bye to the broker
        os._exit(0)


def _report(events: TextIO, line: str) -> None:
    try:
        events.write(line.rstrip("\n") + "\n")
        events.flush()
    except OSError:
        pass  # the parent is gone; `_end_with_parent` sees it too


def main() -> int:
    """Serve until the parent ends; 0, or the exit status of what went wrong."""
    events = os.fdopen(int(sys.argv[1]), "w", encoding="utf-8")
    settings = json.loads(sys.argv[2])
    # The parent may have been started with SIGINT ignored, as shells do in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    from swarmwright import _engine

    try:
        _engine.serve(**settings, on_event=lambda line: _report(events, line))
    except KeyboardInterrupt:
        return 0
    except (_engine.InputError, _engine.EngineError) as error:
        _report(events, json.dumps({"event": "error", "message": str(error)}))
        return 2 if isinstance(error, _engine.InputError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
