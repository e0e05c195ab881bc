"""The client of a Ray or Dask cluster, in a separate process that `_driven.DrivenLauncher` starts.

Ray takes over signals and ends its process when the cluster is lost, which must not affect the optimization
tool. When the tool ends, this process ends all servers and itself.

Called as `python -m swarmwright.servers.launchers._driver DESCRIPTOR PARENT`.
"""

import importlib
import os
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any, Protocol

from swarmwright.servers.launchers._base import Health, LauncherError

_POLL_S = 0.5
GRACE_S = 30.0
"""Seconds to end all servers after the tool has ended."""


class Cluster(Protocol):
    """Interface of clusters; the methods are those of `Launcher`."""

    def start(self, servers: Sequence[int]) -> None:
        """Begin to start servers."""

    def health(self) -> Mapping[int, Health]:
        """Return the state of each server."""

    def stop(self, servers: Sequence[int]) -> None:
        """End servers."""

    def logs(self, server: int, lines: int) -> Sequence[str]:
        """Return the last lines of a server."""

    def close(self) -> None:
        """End all servers, and the connection."""


def main() -> None:
    """Answer requests until the other side closes the connection."""
    pipe: Connection[Any, Any] = Connection(int(sys.argv[1]))
    os.set_inheritable(pipe.fileno(), False)
    threading.Thread(target=_watch, args=(int(sys.argv[2]),), daemon=True, name="parent").start()
    cluster: Cluster | None = None
    try:
        while True:
            number, name, arguments = pipe.recv()
            try:
                if name == "open":
                    module, *rest = arguments
                    cluster = importlib.import_module(module).Cluster(*rest)
                    answer: Any = None
                else:
                    assert cluster is not None
                    answer = getattr(cluster, name)(*arguments)
            except LauncherError as error:
                pipe.send((number, False, str(error)))
            except Exception as error:  # noqa: BLE001 - reported with the library's message
                pipe.send((number, False, _format_error(error)))
            else:
                pipe.send((number, True, answer))
            if name == "close":
                return
    except (EOFError, OSError):
        if cluster is not None:
            cluster.close()
    finally:
        sys.stderr.flush()
        os._exit(0)  # threads of the libraries may not end


def _format_error(error: BaseException) -> str:
    """Format an error and its causes."""
    words = str(error).strip() or type(error).__name__
    return words if error.__cause__ is None else f"{words}: {_format_error(error.__cause__)}"


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_POLL_S)
    time.sleep(GRACE_S)
    os._exit(1)


if __name__ == "__main__":
    main()
