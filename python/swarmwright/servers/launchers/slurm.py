"""Servers as Slurm job arrays (https://slurm.schedmd.com), through sbatch, squeue and scancel."""

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
from swarmwright.servers.launchers._base import Health, Launcher, LauncherError, Specification
from swarmwright.servers.launchers._remote import RemoteOptions, format_command, format_setup, format_unpack

ANSWER_S = 60.0
"""Time limit for answers of Slurm's programs, seconds."""
LEAVE_S = 60.0
"""Seconds for cancelled jobs to leave the queue."""
BEFORE_LIMIT_S = 30
"""Seconds before its time limit when a server is asked to end."""
_USUAL_TASKS = 1000
"""Upper limit of tasks per array, unless the cluster allows fewer (MaxArraySize)."""
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
    """Account to charge."""
    qos: str | None = Field(default=None, min_length=1)
    """Quality of service."""
    time: str | int | None = None
    """Time limit of a job, in minutes or as for sbatch ("8:00:00"). A server ends 30 s before and is replaced
    by another job. Default: the partition's."""
    cpus: int = Field(default=1, ge=1, le=4096)
    """Processors per server."""
    memory: str | None = Field(default=None, min_length=1)
    """Memory per server, such as 2G."""
    gpus: int | None = Field(default=None, ge=1, le=64)
    """GPUs per server."""
    constraint: str | None = Field(default=None, min_length=1)
    """Required features of nodes."""
    requeue: bool = True
    """Whether preempted jobs and jobs of failed nodes return to the queue."""
    arguments: list[str] = Field(default=[])
    """Further arguments of sbatch, such as --exclusive."""
    folder: str = Field(default="~/.cache/swarmwright", min_length=1)
    """Folder shared with the nodes, for code, the servers' password and their output."""

    paths: ClassVar[tuple[str, ...]] = (*RemoteOptions.paths, "folder")


class Slurm(Launcher):
    """Launcher of servers as tasks of job arrays.

    Ended jobs are replaced, for instance at their time limit. Waiting ones are reported with the scheduler's
    reason. At the end, all jobs are cancelled.
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
        """Upper limit of tasks per array; None before it is known."""

    @property
    def name(self) -> str:
        """Name of the jobs."""
        return re.sub(r"[^\w.-]+", "-", f"{self.specification.label}-{self._token}")

    def open(self) -> None:
        """Write the servers' files into the shared folder."""
        missing = [name for name in ("sbatch", "squeue", "scancel") if shutil.which(name) is None]
        if missing:
            raise InputError(
                f"servers: slurm needs the programs sbatch, squeue and scancel, but {missing[0]} was not "
                "found; use a login node of the cluster"
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
                f"{error.filename or self._folder}: cannot be written: {error.strerror}; set the option "
                "folder to a folder shared with the nodes"
            ) from error

    def start(self, servers: Sequence[int]) -> None:
        """Submit arrays with a task per server."""
        if self._most is None and len(servers) > 1:
            self._most = self._find_max_tasks()
        most = self._most or 1
        for first in range(0, len(servers), most):
            self._start(servers[first : first + most])

    def _find_max_tasks(self) -> int:
        """Return the maximum number of tasks in an array of this cluster."""
        most = _USUAL_TASKS
        with suppress(LauncherError):  # not all users may query it
            match = re.search(
                r"(?m)^MaxArraySize\s*=\s*(\d+)", self._run_program("scontrol", "show", "config")
            )
            most = min(most, int(match[1])) if match else most
        return max(most, 1)

    def _start(self, servers: Sequence[int]) -> None:
        job = self._submit(self._arguments(len(servers)), self._format_script(servers))
        number = job.strip().partition(";")[0]
        if not number.isdecimal():
            raise LauncherError(f"sbatch answered {job.strip()!r}; expected the number of a job")
        self._jobs |= {server: f"{number}_{index}" for index, server in enumerate(servers)}

    def _submit(self, arguments: Sequence[str], script: str) -> str:
        before, self._may_have_jobs = self._may_have_jobs, True
        try:
            return self._run_program("sbatch", *arguments, script=script)
        except _RefusedError as error:
            # A controller that timed out may have accepted the job.
            self._may_have_jobs = before or "timed out" in str(error).lower()
            raise

    def health(self) -> Mapping[int, Health]:
        """Query the jobs with squeue."""
        if not self._jobs:
            return {}
        states = {job: (state, reason) for job, state, reason in self._list_jobs()}
        return {server: _health(job, states.get(job)) for server, job in self._jobs.items()}

    def stop(self, servers: Sequence[int]) -> None:
        """Cancel jobs."""
        leaving = {server: self._jobs[server] for server in servers if server in self._jobs}
        if not leaving:
            return
        self._run_program("scancel", "--quiet", *leaving.values())
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
        """Cancel all jobs, wait until they have left the queue, and remove their files."""
        if not self._folder.exists():
            return
        try:
            if self._may_have_jobs:
                self._cancel_all()
        except LauncherError as error:
            words = f"{error}; cancel remaining jobs with `scancel --name={self.name}`"
            raise LauncherError(words) from error
        finally:
            # Removes passwords; jobs that begin later end at once without this folder.
            shutil.rmtree(self._folder, ignore_errors=True)

    def _cancel_all(self) -> None:
        self._run_program("scancel", "--quiet", f"--name={self.name}", f"--user={getpass.getuser()}")
        deadline = time.monotonic() + LEAVE_S
        while remaining := [job for job, state, _ in self._list_jobs() if state in _WAITING | _RUNNING]:
            if time.monotonic() > deadline:
                raise LauncherError(
                    f"the jobs {', '.join(remaining)} were cancelled but are still in the queue"
                )
            time.sleep(0.2)
        self._jobs, self._may_have_jobs = {}, False

    def _list_jobs(self) -> list[tuple[str, str, str]]:
        """List id, state and reason of all jobs of this run, including recently ended ones."""
        text = self._run_program(
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
        options_by_name = {
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
            # Signal the batch shell, which execs the program.
            f"--signal=B:TERM@{BEFORE_LIMIT_S}",
            "--requeue" if options.requeue else "--no-requeue",
            *(f"--{name}={value}" for name, value in options_by_name.items() if value is not None),
            *options.arguments,
        ]

    def _format_script(self, servers: Sequence[int]) -> str:
        folder, option = shlex.quote(str(self._folder)), self.options.code
        code = None if option is None else shlex.quote(option)
        unpack = []
        if self.specification.code is not None:
            # A folder per server, as the simulation may write into it.
            code = f'{folder}/"code-${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID"'
            unpack = format_unpack(f"{folder}/{ARCHIVE}", self.specification.code.sha256, code)
        variables = self.specification.variables(str(self._folder))
        marked = format_command(self.options, self.specification, 0).replace("--id 0", '--id "$server"')
        return "\n".join(
            [
                "#!/bin/sh",
                f"servers={shlex.quote(' '.join(map(str, servers)))}",
                *unpack,
                *format_setup(self.options, variables, code or folder, code),
                'server=$(echo $servers | cut -d " " -f $((SLURM_ARRAY_TASK_ID + 1)))',
                f"exec {marked}",
                "",
            ]
        )

    def _run_program(self, *command: str, script: str | None = None) -> str:
        """Run a program of Slurm and return its output. Raises LauncherError with its message."""
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
            raise LauncherError(f"{command[0]} did not answer within {ANSWER_S:g} s") from error
        except OSError as error:
            raise LauncherError(f"{command[0]}: {error.strerror}") from error
        if result.returncode != 0:
            raise _RefusedError(
                result.stderr.strip() or f"{command[0]} ended with status {result.returncode}"
            )
        return result.stdout


def _health(job: str, entry: tuple[str, str] | None) -> Health:
    if entry is None:
        return Health("ended", f"job {job} has left the queue")
    state, reason = entry
    suffix = "" if reason in {"None", ""} else f" ({reason})"
    if state in _WAITING:
        return Health("waiting", f"{state.lower()}{suffix}")
    if state in _RUNNING:
        return Health("running")
    return Health("ended", f"job {job}: {state.lower()}{suffix}")
