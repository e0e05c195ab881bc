"""Servers as jobs of Slurm (https://slurm.schedmd.com): arrays of sbatch, squeue and scancel."""

import getpass
import os
import re
import secrets
import shlex
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field

from swarmwright.common.errors import InputError
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError
from swarmwright.servers.launchers._remote import RemoteOptions, called, prepared, unpacked
from swarmwright.servers.launchers._specification import Specification

ANSWER_S = 60.0
"""Seconds for Slurm's programs to answer."""
LEAVE_S = 60.0
"""Seconds that cancelled jobs have to leave the queue."""
BEFORE_LIMIT_S = 30
"""Seconds before its time limit at which a server is asked to end."""
_USUAL_TASKS = 1000
"""Tasks of an array, at most, where the cluster does not allow less (MaxArraySize)."""
ARCHIVE = "code.tar.gz"
_WAITING = {"PENDING", "CONFIGURING", "REQUEUED", "REQUEUE_HOLD", "REQUEUE_FED", "SPECIAL_EXIT", "SUSPENDED"}
_RUNNING = {"RUNNING", "COMPLETING", "STAGE_OUT", "SIGNALING", "RESIZING", "STOPPED"}


class _RefusedError(LauncherError):
    """A program of Slurm ended with an error."""


class SlurmOptions(RemoteOptions):
    """Jobs of Slurm."""

    launcher: Literal["slurm"] = "slurm"
    partition: str | None = Field(default=None, min_length=1)
    """Partition. Default: the cluster's."""
    account: str | None = Field(default=None, min_length=1)
    """Account that is charged."""
    qos: str | None = Field(default=None, min_length=1)
    """Quality of service."""
    time: str | int | None = None
    """Time limit of a job, minutes or as sbatch takes it, "8:00:00". A server is asked to end 30 s before it
    and is replaced by another job. Default: the partition's."""
    cpus: int = Field(default=1, ge=1, le=4096)
    """Processors of a server."""
    memory: str | None = Field(default=None, min_length=1)
    """Memory of a server, such as 2G."""
    gpus: int | None = Field(default=None, ge=1, le=64)
    """GPUs of a server."""
    constraint: str | None = Field(default=None, min_length=1)
    """Features of nodes."""
    requeue: bool = True
    """Whether jobs whose node failed, or that were preempted, go back to the queue."""
    arguments: list[str] = Field(default=[])
    """Further arguments of sbatch, such as --exclusive."""
    folder: str = Field(default="~/.cache/swarmwright", min_length=1)
    """Folder that the nodes share with this machine, for code, the servers' password and their output."""

    paths: ClassVar[tuple[str, ...]] = (*RemoteOptions.paths, "folder")


class Slurm(Launcher):
    """Servers as tasks of job arrays.

    Jobs that end, for instance at their time limit, are replaced. Those that wait are reported with the
    scheduler's reason. At the end all are cancelled.
    """

    kind: ClassVar[str] = "slurm"
    options_model = SlurmOptions
    options: SlurmOptions
    interval: ClassVar[float] = 2.0

    def __init__(self, options: SlurmOptions, specification: Specification) -> None:
        super().__init__(options, specification)
        self._token = secrets.token_hex(4)
        self._jobs: dict[int, str] = {}
        self._ended: dict[int, str] = {}
        self._folder = Path(options.folder).expanduser() / "run" / self._token
        self._may_have_jobs = False
        self._most: int | None = None
        """Tasks of an array, at most; None as long as that is not known."""

    @property
    def name(self) -> str:
        """What the jobs are called."""
        return re.sub(r"[^\w.-]+", "-", f"{self.specification.label}-{self._token}")

    def open(self) -> None:
        """Write what servers read into the shared folder."""
        missing = [name for name in ("sbatch", "squeue", "scancel") if shutil.which(name) is None]
        if missing:
            raise InputError(
                f"servers: slurm needs the programs sbatch, squeue and scancel; {missing[0]} is not here: "
                "run this on a machine from which jobs are submitted"
            )
        try:
            self._folder.mkdir(parents=True, mode=0o700)
            for name, data in self.specification.files().items():
                (self._folder / name).touch(0o600)
                (self._folder / name).write_bytes(data)
            if self.specification.code is not None:
                (self._folder / ARCHIVE).write_bytes(self.specification.code.archive)
        except OSError as error:
            raise LauncherError(
                f"{error.filename or self._folder}: cannot be written: {error.strerror}; name a folder "
                "that the nodes share with the option folder"
            ) from error

    def start(self, servers: Sequence[int]) -> None:
        """Submit arrays with a task for each server."""
        if self._most is None and len(servers) > 1:
            self._most = self._most_tasks()
        most = self._most or 1
        for first in range(0, len(servers), most):
            self._start(servers[first : first + most])

    def _most_tasks(self) -> int:
        """Return how many tasks an array of this cluster has at most."""
        most = _USUAL_TASKS
        with suppress(LauncherError):  # not all may ask for it
            found = re.search(r"(?m)^MaxArraySize\s*=\s*(\d+)", self._slurm("scontrol", "show", "config"))
            most = min(most, int(found[1])) if found else most
        return max(most, 1)

    def _start(self, servers: Sequence[int]) -> None:
        job = self._submit(self._arguments(len(servers)), self._script(servers))
        number = job.strip().partition(";")[0]
        if not number.isdecimal():
            raise LauncherError(f"sbatch answered {job.strip()!r} where the number of a job was expected")
        self._jobs |= {server: f"{number}_{index}" for index, server in enumerate(servers)}

    def _submit(self, arguments: Sequence[str], script: str) -> str:
        before, self._may_have_jobs = self._may_have_jobs, True
        try:
            return self._slurm("sbatch", *arguments, script=script)
        except _RefusedError as error:
            # A controller that did not answer in time may have taken the job.
            self._may_have_jobs = before or "timed out" in str(error).lower()
            raise

    def health(self) -> Mapping[int, Health]:
        """Ask squeue for the jobs."""
        if not self._jobs:
            return {}
        found = {job: (state, reason) for job, state, reason in self._listed()}
        return {server: _health(job, found.get(job)) for server, job in self._jobs.items()}

    def stop(self, servers: Sequence[int]) -> None:
        """Cancel jobs."""
        leaving = {server: self._jobs[server] for server in servers if server in self._jobs}
        if not leaving:
            return
        self._slurm("scancel", "--quiet", *leaving.values())
        for server, job in leaving.items():
            self._ended[server] = job
            del self._jobs[server]

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:
        """Return the end of a job's output."""
        job = self._jobs.get(server) or self._ended.get(server)
        if job is None:
            return ()
        with suppress(OSError):
            return (
                (self._folder / f"{job}.log")
                .read_text(encoding="utf-8", errors="replace")
                .splitlines()[-lines:]
            )
        return ()

    def close(self) -> None:
        """Cancel all jobs, and wait until they have left the queue; remove what they have read."""
        if not self._folder.exists():
            return
        try:
            if self._may_have_jobs:
                self._cancel_all()
        except LauncherError as error:
            words = f"{error}; cancel what is left with `scancel --name={self.name}`"
            raise LauncherError(words) from error
        finally:
            # No password stays there, and jobs that begin later end at once, without this folder.
            shutil.rmtree(self._folder, ignore_errors=True)

    def _cancel_all(self) -> None:
        self._slurm("scancel", "--quiet", f"--name={self.name}", f"--user={getpass.getuser()}")
        deadline = time.monotonic() + LEAVE_S
        while left := [job for job, state, _ in self._listed() if state in _WAITING | _RUNNING]:
            if time.monotonic() > deadline:
                raise LauncherError(f"the jobs {', '.join(left)} were cancelled and are still in the queue")
            time.sleep(0.2)
        self._jobs, self._may_have_jobs = {}, False

    def _listed(self) -> list[tuple[str, str, str]]:
        """Return id, state and reason of all jobs of this run, also of those that have ended recently."""
        text = self._slurm(
            "squeue",
            "--noheader",
            "--array",
            "--states=all",
            f"--name={self.name}",
            "--format=%i|%T|%r",
        )
        rows = [line.strip().split("|", 2) for line in text.splitlines() if line.count("|") >= 2]
        return [(job, state, reason) for job, state, reason in rows]

    def _arguments(self, count: int) -> list[str]:
        options = self.options
        given = {
            "partition": options.partition,
            "account": options.account,
            "qos": options.qos,
            "time": options.time,
            "mem": options.memory,
            "gpus-per-task": options.gpus,
            "constraint": options.constraint,
        }
        return [
            "--parsable",
            f"--job-name={self.name}",
            f"--array=0-{count - 1}",
            "--ntasks=1",
            f"--cpus-per-task={options.cpus}",
            f"--output={self._folder}/%A_%a.log",
            "--open-mode=append",
            f"--chdir={self._folder}",
            # To the program itself, in whose place the shell of the script is.
            f"--signal=B:TERM@{BEFORE_LIMIT_S}",
            "--requeue" if options.requeue else "--no-requeue",
            *(f"--{name}={value}" for name, value in given.items() if value is not None),
            *options.arguments,
        ]

    def _script(self, servers: Sequence[int]) -> str:
        folder, option = shlex.quote(str(self._folder)), self.options.code
        code = None if option is None else shlex.quote(option)
        unpack = []
        if self.specification.code is not None:
            # What the simulation writes there, no other server finds.
            code = f'{folder}/"code-${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID"'
            unpack = unpacked(f"{folder}/{ARCHIVE}", self.specification.code.sha256, code)
        variables = self.specification.variables(str(self._folder))
        marked = called(self.options, self.specification, 0).replace("--id 0", '--id "$server"')
        return "\n".join(
            [
                "#!/bin/sh",
                f"servers={shlex.quote(' '.join(map(str, servers)))}",
                *unpack,
                *prepared(self.options, variables, code or folder, code),
                'server=$(echo $servers | cut -d " " -f $((SLURM_ARRAY_TASK_ID + 1)))',
                f"exec {marked}",
                "",
            ]
        )

    def _slurm(self, *command: str, script: str | None = None) -> str:
        """Return what a program of Slurm prints. Raises LauncherError with what it says."""
        try:
            result = subprocess.run(
                command,
                input=script,
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                timeout=ANSWER_S,
                env={**os.environ, "LC_ALL": "C"},
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise LauncherError(f"{command[0]} has not answered within {ANSWER_S:g} s") from error
        except OSError as error:
            raise LauncherError(f"{command[0]}: {error.strerror}") from error
        if result.returncode != 0:
            raise _RefusedError(
                result.stderr.strip() or f"{command[0]} ended with status {result.returncode}"
            )
        return result.stdout


def _health(job: str, found: tuple[str, str] | None) -> Health:
    if found is None:
        return Health("ended", f"job {job} has left the queue")
    state, reason = found
    why = "" if reason in {"None", ""} else f" ({reason})"
    if state in _WAITING:
        return Health("waiting", f"{state.lower()}{why}")
    if state in _RUNNING:
        return Health("running")
    return Health("ended", f"job {job}: {state.lower()}{why}")
