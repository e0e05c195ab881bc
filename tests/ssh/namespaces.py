"""Two machines with networks of their own: network namespaces of this kernel, joined by virtual cables."""

import itertools
import os
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.ssh.conftest import Machine, running

_NUMBERS = itertools.count()


def ip(*arguments: str) -> None:
    """Run the command `ip`."""
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)


@dataclass
class Networks:
    """Here, `near` and `far`, in a row; SSH reaches `far` through `near` only."""

    near: Machine
    far: Machine
    broker_host: str
    """This machine's address, as both reach it."""
    namespace: str
    """That of `near`."""

    def cable(self, state: str) -> None:
        """Pull the cable between here and `near` (down), or plug it in again (up)."""
        ip("-n", self.namespace, "link", "set", "here", state)

    def config(self, folder: Path) -> Path:
        """Write a configuration of SSH with both, `far` behind a jump host; return its file."""
        lines = []
        for name, machine in (("near", self.near), ("far", self.far)):
            lines += [
                f"Host {name}",
                f"  HostName {machine.address}",
                f"  Port {machine.port}",
                f"  IdentityFile {machine.folder}/key",
                f"  UserKnownHostsFile {machine.folder}/known_hosts",
            ]
        file = folder / "ssh_config"
        file.write_text("\n".join([*lines, "  ProxyJump near"]) + "\n")
        return file


@contextmanager
def joined(folder: Path) -> Iterator[Networks]:
    """Make both namespaces with an sshd in each; skips the test where this is not permitted."""
    # A number of its own: the links of the networks before go a moment after their namespaces.
    mark = f"sw{os.getpid()}{next(_NUMBERS)}"
    near, far = f"{mark}near", f"{mark}far"
    # A range for tests of networks (RFC 2544); four networks of four addresses for each process.
    net = f"198.18.{os.getpid() % 256}"
    with ExitStack() as stack:
        for name in (near, far):
            try:
                ip("netns", "add", name)
            except (OSError, subprocess.CalledProcessError) as error:
                words = getattr(error, "stderr", None) or str(error)
                pytest.skip(f"network namespaces cannot be made here: {words.strip()}")
            stack.callback(ip, "netns", "del", name)
            ip("-n", name, "link", "set", "lo", "up")
        ip("link", "add", f"{mark}n", "type", "veth", "peer", "name", "here", "netns", near)
        ip("-n", near, "link", "add", "far", "type", "veth", "peer", "name", "near", "netns", far)
        # What `far` reaches the broker by; its sshd does not listen there.
        ip("link", "add", f"{mark}f", "type", "veth", "peer", "name", "here", "netns", far)
        for where, link, number in (
            ([], f"{mark}n", 1),
            (["-n", near], "here", 2),
            (["-n", near], "far", 5),
            (["-n", far], "near", 6),
            ([], f"{mark}f", 9),
            (["-n", far], "here", 10),
        ):
            ip(*where, "address", "add", f"{net}.{number}/30", "dev", link)
            ip(*where, "link", "set", link, "up")
        ip("-n", far, "route", "add", f"{net}.1/32", "via", f"{net}.9")
        sshd = {
            space: stack.enter_context(
                running(folder / name, f"{net}.{last}", ["ip", "netns", "exec", space])
            )
            for name, last, space in (("near", 2, near), ("far", 6, far))
        }
        yield Networks(sshd[near], sshd[far], broker_host=f"{net}.1", namespace=near)
