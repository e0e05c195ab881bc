"""A real sshd on a port of its own, with keys of its own; also in network namespaces."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import free_port

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if os.environ.get("SWARMWRIGHT_SSH"):
        return
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.skip(reason="SWARMWRIGHT_SSH is not set: run `make test-ssh`"))


@dataclass
class Machine:
    """An sshd that admits one key."""

    folder: Path
    port: int
    process: "subprocess.Popen[bytes]"
    address: str = "127.0.0.1"
    slots: int = 4

    @property
    def options(self) -> dict[str, Any]:
        """What the launcher needs to log in."""
        return {
            "hosts": [{"host": self.address, "port": self.port, "slots": self.slots}],
            "key": str(self.folder / "key"),
            "known_hosts": str(self.folder / "known_hosts"),
            "config": str(self.folder / "config"),
            "command": f"{sys.executable} -m swarmwright",
            "folder": str(self.folder / "cache"),
            "broker_host": "127.0.0.1",
        }

    def sessions(self) -> list[int]:
        """Process ids of the sshd's sessions."""
        listed = subprocess.run(
            ["pgrep", "-P", str(self.process.pid)], capture_output=True, text=True, check=False
        )
        return [int(word) for word in listed.stdout.split()]

    def servers(self) -> list[str]:
        """Command lines of the servers that were started through it."""
        found = []
        for place in Path("/proc").glob("[0-9]*/environ"):
            try:
                if f"XDG_LABEL={self.folder}".encode() in place.read_bytes().split(b"\0"):
                    found.append((place.parent / "cmdline").read_bytes().replace(b"\0", b" ").decode())
            except OSError:
                continue
        return [line for line in found if line]


@contextmanager
def running(
    folder: Path,
    address: str = "127.0.0.1",
    inside: Sequence[str] = (),
    slots: int = 4,
    subsystem: str = "sftp internal-sftp",
) -> Iterator[Machine]:
    """Start an sshd that listens on an address; `inside` is a command that runs others, in a namespace."""
    program = shutil.which("sshd", path="/usr/sbin:/usr/bin")
    assert program, "sshd is missing; `make test-ssh` installs it"
    Path("/run/sshd").mkdir(exist_ok=True)
    folder.mkdir(mode=0o700)
    for name in ("key", "host_key", "other_key"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)], check=True)
    port = free_port()
    shutil.copy(folder / "key.pub", folder / "authorized_keys")
    host_key = (folder / "host_key.pub").read_text().split()
    (folder / "known_hosts").write_text(f"[{address}]:{port} {host_key[0]} {host_key[1]}\n")
    (folder / "config").write_text("")
    (folder / "sshd_config").write_text(
        f"ListenAddress {address}:{port}\nHostKey {folder}/host_key\nPidFile none\nUsePAM no\n"
        f"AuthorizedKeysFile {folder}/authorized_keys\nStrictModes no\nPasswordAuthentication no\n"
        f"Subsystem {subsystem}\nSetEnv XDG_LABEL={folder}\nPermitRootLogin yes\n"
        f"MaxSessions {slots + 8}\n"
    )
    arguments = [program, "-D", "-f", str(folder / "sshd_config"), "-E", str(folder / "log")]
    process = subprocess.Popen([*inside, *arguments])
    try:
        while "Server listening" not in ((folder / "log").read_text() if (folder / "log").exists() else ""):
            assert process.poll() is None
            time.sleep(0.05)
        yield Machine(folder, port, process, address, slots)
    finally:
        process.terminate()
        process.wait()


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    with running(tmp_path / "machine") as made:
        yield made
