"""Runs an experiment on brokers of other makes: `python -m tests.brokers [NAME ..]`, all when none is named.

Each is installed into build/brokers, started with its settings as it comes, and stopped. In every mode, and
with a generation that is more than some take in a packet, the run record must be the one that is made without
a broker. The table goes to build/brokers.md. Exit status 1 when a record differs, a run fails, or a named
broker cannot be installed; of the others, those that cannot be installed are told and left out.
"""

import json
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.brokers.catalogue import BROKERS, Entry
from tests.conftest import PROGRAM, ROOT, environment, free_port
from tests.system.brokers import reachable
from tests.system.processes import Servers
from tests.system.runs import record

EXPERIMENT = """\
simulation: minisim
parameters: {{numAgents: 3, numDefenders: 2, placement: random, speedDefenders: 0.5}}
controller: {controller}
method: {{kind: nnga, population: {population}, generations: 2}}
mode: {mode}
seed: 11
"""
SMALL, WIDE = "{kind: fully_meshed, hidden: 2}", "{kind: layered, hidden: [16, 16]}"
# mode, population, controller; in the last one, a generation has some 300 kB
SHAPES = {
    "stepwise": ("stepwise", 20, SMALL),
    "batched": ("batched", 100, SMALL),
    "offloaded": ("offloaded", 100, SMALL),
    "large": ("offloaded", 200, WIDE),
}
LIMIT = 60
"""Seconds of one run."""


def version_spoken(port: int) -> str:
    """Ask for MQTT 5; what does not take it is spoken to in 3.1.1."""
    connect = b"\x10\x10\x00\x04MQTT\x05\x02\x00\x0a\x00\x00\x03ask"
    with socket.create_connection(("127.0.0.1", port), 2) as asking:
        asking.sendall(connect)
        try:
            answer = asking.recv(4)
        except OSError:
            answer = b""
    return "5" if len(answer) == 4 and answer[0] == 0x20 and answer[3] == 0 else "3.1.1"


def optimize(folder: Path, shape: str, *where: str) -> tuple[float, str]:
    """Run it; evaluations per second, and why it failed ("" where it did not)."""
    mode, population, controller = SHAPES[shape]
    file = folder / f"{shape}.yaml"
    file.write_text(EXPERIMENT.format(population=population, mode=mode, controller=controller))
    out = folder / f"{shape}-{where[0].strip('-')}"
    command = [*PROGRAM, "optimize", str(file), *where, "--out", str(out), "--json"]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=LIMIT,
            env=environment(),
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 0.0, f"not done after {LIMIT} s"
    if done.returncode:
        return 0.0, done.stderr.strip().rpartition("\n")[2][:100]
    end = json.loads(done.stdout.strip().rpartition("\n")[2])
    return end["evaluations"] / end["seconds"], ""


def not_started(entry: Entry, home: Path, why: str) -> list[str]:
    """A row of the table."""
    return [entry.name, entry.release(home), *("-" * 5), "no", f"did not start: {why}"]


def measure(entry: Entry, home: Path, folder: Path) -> tuple[list[str], bool]:
    """A row of the table, and whether everything was as it must be."""
    port = free_port()
    command = entry.command(home, folder, port)
    try:
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=folder)
    except OSError as error:
        return not_started(entry, home, str(error)), False
    rates, remarks = [], []
    version = "-"
    try:
        limit = time.monotonic() + 30
        while not reachable(port):
            if process.poll() is not None or time.monotonic() > limit:
                said = (folder / "log").read_text(errors="replace").strip()[-200:]
                return not_started(entry, home, said), False
            time.sleep(0.05)
        version = version_spoken(port)
        url = f"mqtt://127.0.0.1:{port}"
        servers = Servers(url, cwd=folder)
        try:
            for shape in SHAPES:
                rate, failure = optimize(folder, shape, "--broker", url)
                if not failure and record(folder / f"{shape}-broker") != record(folder / f"{shape}-servers"):
                    failure = "another record"
                rates.append("-" if failure else f"{rate:.0f}")
                remarks += [f"{shape}: {failure}"] if failure else []
        finally:
            servers.stop()
    finally:
        process.terminate()
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(10)
    row = [entry.name, entry.release(home), version, *rates, "no" if remarks else "yes", "; ".join(remarks)]
    return row, not remarks


def main(names: list[str]) -> int:
    """Measure these brokers, or all."""
    known = {entry.name: entry for entry in BROKERS}
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"no such broker: {', '.join(unknown)}; there are {', '.join(known)}", file=sys.stderr)
        return 2
    good = True
    rows = []
    for entry in [known[name] for name in names] or BROKERS:
        home = ROOT / "build" / "brokers" / entry.name
        try:
            home.mkdir(parents=True, exist_ok=True)
            entry.install(home)
        except (OSError, RuntimeError, subprocess.SubprocessError) as error:
            print(f"{entry.name}: cannot be installed: {error}", file=sys.stderr)
            good &= not names
            continue
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            for shape in SHAPES:
                _, failure = optimize(folder, shape, "--servers", "local")
                assert not failure, failure
            row, fine = measure(entry, home, folder)
        good &= fine
        rows.append(row)
        print(" | ".join(row), flush=True)
    head = ["broker", "release", "MQTT", "stepwise", "batched", "offloaded", "large", "same bytes", "remarks"]
    table = [head, ["---"] * len(head), *rows]
    text = "".join(f"| {' | '.join(row)} |\n" for row in table)
    (ROOT / "build" / "brokers.md").write_text(text)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
