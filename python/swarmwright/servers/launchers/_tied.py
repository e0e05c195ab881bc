"""`swarmwright` as a child of a cluster's worker that ends with its parent and removes its folder.

Called as `python -m swarmwright.servers.launchers._tied PARENT FOLDER serve ..` with the process id of its
parent and the folder with its code and secrets.
"""

import ctypes
import os
import runpy
import shutil
import signal
import sys
import threading
import time

from swarmwright.servers.launchers._slot import GRACE_S

_SET_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG, <linux/prctl.h>
_POLL_S = 0.5


def main() -> None:
    """Run `swarmwright` in this process."""
    parent, folder = int(sys.argv[1]), sys.argv[2]
    ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGTERM)
    # Workers may block signals, which children inherit.
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    threading.Thread(target=_watch, args=(parent, folder), daemon=True, name="parent").start()
    del sys.argv[1:3]
    try:
        if os.getppid() == parent:  # else the parent ended before prctl
            runpy.run_module("swarmwright", run_name="__main__", alter_sys=True)
    finally:
        if os.getppid() != parent:
            shutil.rmtree(folder, ignore_errors=True)


def _watch(parent: int, folder: str) -> None:
    """Kill the process group if it does not end after its parent."""
    while os.getppid() == parent:
        time.sleep(_POLL_S)
    time.sleep(GRACE_S)
    shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main()
