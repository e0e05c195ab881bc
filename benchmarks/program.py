"""The program as its users meet it: start-up, the example from start to end, memory."""

import json
import subprocess
import sys
import tempfile
import time

from benchmarks.measurement import Samples
from benchmarks.processes import PROGRAM, ROOT, Broker, embedded, peak_memory, servers

# Starts a program and prints its peak memory in KiB. It is small: a child begins with the peak of its parent.
LAUNCHER = """
import os, sys
quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=quiet)
_, status, usage = os.wait4(child, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""
EXAMPLE = ROOT / "experiments" / "minisim.yaml"


def start_up(*arguments: str) -> float:
    """Milliseconds of one run of Python."""
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, timeout=60)
    return (time.perf_counter() - start) * 1e3


def help_start_up() -> float:
    """Milliseconds of `swarmwright --help`."""
    return start_up(*PROGRAM[1:], "--help")


def whole_run() -> tuple[float, int]:
    """Seconds of the example with two servers of its own on the embedded broker; and its evaluations."""
    with tempfile.TemporaryDirectory() as folder:
        command = [*PROGRAM, "optimize", str(EXAMPLE), "--servers", "2", "--out", f"{folder}/run", "--json"]
        start = time.perf_counter()
        output = subprocess.run(command, check=True, capture_output=True, text=True, timeout=300).stdout
        seconds = time.perf_counter() - start
    return seconds, int(json.loads(output.splitlines()[-1])["evaluations"])


def peak_memories(broker: Broker) -> tuple[float, float]:
    """Peak memory in MB of the optimization tool and of a server, in the example with two servers."""
    with servers(broker, 2, "") as pids, tempfile.TemporaryDirectory() as folder:
        command = [
            *PROGRAM,
            "optimize",
            str(EXAMPLE),
            "--broker",
            broker.url,
            "--out",
            f"{folder}/run",
            "--json",
        ]
        launched = subprocess.run(
            [sys.executable, "-S", "-c", LAUNCHER, *command],
            check=True,
            capture_output=True,
            text=True,
            timeout=300,
        )
        return int(launched.stdout) * 1024 / 1e6, max(map(peak_memory, pids))


class ProgramSuite:
    """What does not depend on the broker."""

    def __init__(self) -> None:
        self._python = Samples("python -c pass", "ms")
        self._import = Samples("python -c 'import swarmwright'", "ms", self._python, "< 150 ms")
        self._help = Samples("swarmwright --help", "ms", self._python, "< 300 ms")
        self._whole = Samples("swarmwright optimize experiments/minisim.yaml --servers 2", "s")
        self._rate = Samples("its evaluations", "evaluations/s")

    def repeat(self) -> None:
        """Take one sample of everything."""
        self._python.add(start_up("-c", "pass"))
        self._import.add(start_up("-c", "import swarmwright"))
        self._help.add(help_start_up())
        seconds, evaluations = whole_run()
        self._whole.add(seconds)
        self._rate.add(evaluations / seconds)

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table; the example's memory after all of it."""
        with embedded() as broker:
            tool, server = peak_memories(broker)
        return [
            *(self._python, self._import, self._help, self._whole, self._rate),
            Samples("peak memory, optimization tool", "MB", values=[tool]),
            Samples("peak memory, simulation server", "MB", values=[server]),
        ]

    def close(self) -> None:
        """Nothing is left open."""
