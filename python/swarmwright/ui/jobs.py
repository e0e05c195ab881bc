"""Commands that the window starts: runs, resumed runs, deletions, servers, brokers.

Each is a command that a person could type. Its session is its own, so that it survives the window; SIGINT
ends it as Ctrl-C does; what it prints is in a file. The queue is in the user's state folder, so that a window
that starts later goes on with it, and never in the folder of runs, which may come from somebody else.

As many runs go on at once as there are processors. A run that names a broker leaves its computations to the
broker's servers: it occupies a server there instead, and as many of these go on as the broker has servers, at
least one. Servers, brokers and deletions occupy nothing, since runs would wait for them.

Several machines may share the state folder, and a window on each the queue: a job belongs to the machine on
which it was started.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import re
import secrets
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from swarmwright import InputError, Run
from swarmwright.common import yaml
from swarmwright.common.files import make_private_folder, state_folder
from swarmwright.experiment.broker_address import PREFIX_VARIABLE
from swarmwright.runs.optimization.resuming import extend_experiment

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
ID = re.compile(r"[0-9]{20}-[0-9a-f]{8}")
MOST_SEEDS = 200
MOST_JOBS = 500
"""Jobs that are kept; the oldest ones that have ended are forgotten."""
OUTPUT_BYTES = 20_000
"""Of the end of what a job has printed."""
LINE_BYTES = 300
MOST_OUTPUTS = 20
"""Of jobs, that an answer has."""
MOST_SERVERS = 256
MOST_PORT = 65535
MOST_CHARACTERS = 500
CHECK_S = 20.0
EXPERIMENT_BYTES = 1 << 20
# The shell stays to write down the exit status, which nobody learns when the window is gone.
SHELL = ("/bin/sh", "-c", 'status=$0; trap : INT; "$@"; echo $? > "$status"')
CHECK = """
import sys
answer, sys.stdout = sys.stdout, sys.stderr  # the experiment's code may print while it is imported
from pathlib import Path
from swarmwright import Experiment, InputError
try:
    if len(sys.argv) > 2:
        from swarmwright.analysis.sweep import Sweep
        Sweep.load(sys.argv[2], out=Path(sys.argv[2]).with_suffix(""))
    else:
        Experiment.load(sys.argv[1])
except InputError as error:
    print(error, file=answer)
"""


@dataclass(frozen=True)
class Job:
    """A command of the queue."""

    id: str
    arguments: list[str]
    """Of `swarmwright`."""
    run: str
    """The run that it works on, below the folder; empty for several."""
    created: float
    state: str = "waiting"
    """waiting, running, done, failed, or stopped: by SIGINT, or before its turn."""
    status: int | None = None
    """Exit status, once it has ended."""
    line: str = ""
    """The last that it has printed."""
    host: str = ""
    """The machine on which it was started, where that is another one."""
    broker: str = ""
    """Of a run, the broker whose servers it uses."""
    prefix: str = ""
    """Of the broker's topics."""

    @property
    def is_service(self) -> bool:
        """Whether the job runs until it is stopped."""
        return self.arguments[:1] in (["serve"], ["broker"])

    @property
    def is_free(self) -> bool:
        """Whether the job occupies neither a processor nor a server."""
        return self.is_service or self.arguments[:1] == ["runs"]


@dataclass(frozen=True)
class Process:
    """Where the process of a job is."""

    pid: int
    start_time: str
    """In clock ticks since the machine started, which tells it from later processes with its number."""
    boot_id: str
    """Of the start of the machine, after which the numbers begin anew."""
    host: str

    @classmethod
    def of(cls, pid: int) -> "Process":
        """Return where a process of this machine is."""
        return cls(pid, read_start_time(pid), read_boot_id(), socket.gethostname())

    @property
    def is_local(self) -> bool:
        """Whether it was started on this machine."""
        return self.host == socket.gethostname()

    @property
    def is_running(self) -> bool:
        """Whether it still runs; one of another machine counts as running, since nothing is known of it."""
        if not self.is_local:
            return True
        is_same_boot = self.boot_id == read_boot_id()
        return is_same_boot and self.start_time != "" and read_start_time(self.pid) == self.start_time


class Jobs:
    """The queue of a folder.

    Args:
        folder: of the runs; the queue belongs to it.
        slots: runs at once that compute on this machine; default: one for each processor.
        count_servers: returns how many servers a broker has under a prefix; None where that is not known.
    """

    def __init__(
        self,
        folder: Path,
        slots: int | None = None,
        count_servers: Callable[[str, str], int | None] = lambda _broker, _prefix: None,
    ) -> None:
        self.folder = folder
        state = state_folder() or Path(tempfile.mkdtemp(prefix="swarmwright-"))
        digest = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:32]
        self._jobs = state / "ui-jobs" / digest
        self._slots = slots or len(os.sched_getaffinity(0))
        self._count_servers = count_servers
        self._children: list[subprocess.Popen[bytes]] = []
        """Those that this window started, to be reaped."""
        self._ended: dict[str, Job] = {}
        """Jobs that have ended, of which nothing changes any more."""

    def list_jobs(self) -> list[Job]:
        """Return the jobs, the newest first."""
        try:
            names = sorted((path.name for path in self._jobs.iterdir() if path.is_dir()), reverse=True)
        except OSError:
            return []
        return [job for job in map(self._read, names) if job is not None]

    def read_outputs(self, jobs: Collection[str]) -> dict[str, str]:
        """Return the end of what jobs have printed, by id; at most `MOST_OUTPUTS` of them."""
        return {job: tail(self._jobs / job / "output.txt") for job in list(jobs)[:MOST_OUTPUTS] if is_id(job)}

    def check(self, text: str, write_sweep: Callable[[str], str] | None = None) -> list[dict[str, Any]]:
        """Return what is wrong with an experiment, as `optimize` says it: the line or None, the message.

        It is loaded in a process of its own, in the folder, since it may name code.

        Args:
            text: of the experiment.
            write_sweep: returns the sweep file of an experiment file, whose variants are checked as well.
        """
        try:
            size = len(text.encode())
        except UnicodeEncodeError as error:
            return [{"line": None, "message": f"is not valid Unicode: {error.reason}"}]
        if size > EXPERIMENT_BYTES:
            return [{"line": None, "message": "is larger than 1 MiB"}]
        name = f".check-{secrets.token_hex(8)}"
        file = self.folder / f"{name}.yaml"
        files = {file: text}
        if write_sweep is not None:
            files[self.folder / f"{name}-sweep.yaml"] = write_sweep(file.name)
        try:
            for path, content in files.items():
                path.write_text(content, encoding="utf-8")
            loaded = run_python(CHECK, [path.name for path in files], self.folder)
        except subprocess.TimeoutExpired:
            return [{"line": None, "message": f"took more than {CHECK_S:.0f} s to load"}]
        except OSError as error:
            return [{"line": None, "message": f"cannot be checked: {error}"}]
        finally:
            for path in files:
                path.unlink(missing_ok=True)
        output = loaded.stdout.strip() or ("" if loaded.returncode == 0 else loaded.stderr.strip()[-2000:])
        return list(problems(output, file.name))

    def start(self, text: str, name: str, seeds: list[int]) -> list[Job]:
        """Write an experiment into the folder, and put a run of each seed into the queue.

        Args:
            text: of the experiment.
            name: of its file, `name.yaml`, and of the runs, `name-seed`.
            seeds: of the runs, from 0 on; none for that of the experiment.

        Raises InputError when the name is taken or no name, or a seed is out of range.
        """
        require_name(name)
        if len(seeds) > MOST_SEEDS or any(not 0 <= seed < 2**63 for seed in seeds):
            raise InputError(f"seeds: at most {MOST_SEEDS}, each from 0 to {2**63 - 1}")
        runs = {f"{name}-{seed}": ["--seed", str(seed)] for seed in seeds} or {name: []}
        file = self._write(name, text, runs)
        broker = read_broker(text)
        return [
            self._add(["optimize", file.name, *options, "--out", run], run, broker)
            for run, options in runs.items()
        ]

    def start_sweep(self, text: str, name: str, write_sweep: Callable[[str], str]) -> Job:
        """Write an experiment and its sweep into the folder, and put the sweep into the queue.

        Args:
            text: of the experiment.
            name: of its file, `name.yaml`, and of the folder of the runs; the sweep is in `name-sweep.yaml`.
            write_sweep: returns the sweep file of an experiment file.

        Raises InputError when the name is taken or no name.
        """
        require_name(name)
        file = self._write(name, text, [name])
        sweep = self._write(f"{name}-sweep", write_sweep(file.name), [])
        return self._add(["sweep", sweep.name, "--out", name], name, read_broker(text))

    def _write(self, name: str, text: str, runs: Iterable[str]) -> Path:
        """Write a file for runs into the folder. Raises InputError when a name is taken."""
        queued = self._list_queued()
        existing = [run for run in runs if run in queued or (self.folder / run).exists()]
        if existing:
            raise InputError(
                f"name: {existing[0]} exists already in {self.folder} or in the queue; choose another name"
            )
        file = self.folder / f"{name}.yaml"
        try:
            with file.open("x", encoding="utf-8") as stream:
                stream.write(text)
        except FileExistsError:
            is_same = file.is_file() and file.read_text("utf-8", errors="replace") == text
            if not is_same:
                raise InputError(f"name: {file} exists already; choose another name") from None
        except OSError as error:
            raise InputError(f"name: {file} cannot be written: {error.strerror}") from None
        return file

    def resume(self, run: str, generations: int | None) -> Job:
        """Put a run into the queue that was interrupted, or that goes on to more generations.

        Raises InputError as `check_resumption` does.
        """
        opened = self.check_resumption(run, generations)
        options = [] if generations is None else ["--generations", str(generations)]
        broker = read_broker(yaml.dump(opened.experiment.to_mapping()))
        return self._add(["resume", *options, "--", run], run, broker)

    def check_resumption(self, run: str, generations: int | None) -> Run:
        """Return a run that can be resumed.

        Raises InputError when it is in the queue or goes on, or the generations are not more than it has.
        """
        opened = Run(self.folder / run)
        if run in self._list_queued() or opened.state == "running":
            raise InputError(f"{run}: is in the queue or goes on already; wait for it, or stop it")
        if generations is None:
            return opened
        if generations <= opened.generations:
            raise InputError(
                f"generations: {generations} is not more than the {opened.generations} that {run} has; enter "
                "more, or nothing to complete it as planned"
            )
        extend_experiment(opened, opened.experiment, (), {"generations": generations})
        return opened

    def _list_queued(self) -> set[str]:
        """Return the runs of jobs that wait or go on."""
        return {job.run for job in self.list_jobs() if job.run and job.state in {"waiting", "running"}}

    def delete(self, runs: list[str]) -> Job:
        """Delete runs, as `runs delete` does it: files that Swarmwright did not write stay."""
        return self._add(["runs", "delete", "--yes", "--", *runs], runs[0] if len(runs) == 1 else "")

    def serve(self, simulation: str, count: int, broker: str, prefix: str) -> Job:
        """Start servers on a broker.

        Args:
            simulation: as `swarmwright serve` takes it; paths are relative to the folder.
            count: of servers, from 1 to 256.
            broker: its address.
            prefix: of its topics.

        Raises InputError when one of them cannot be.
        """
        if not simulation.isprintable() or not 1 <= len(simulation) <= MOST_CHARACTERS:
            raise InputError("simulation: enter its title, or file.py:Class")
        if not 1 <= count <= MOST_SERVERS:
            raise InputError(f"count: must be from 1 to {MOST_SERVERS}, not {count}")
        options = ["--broker", broker, "--count", str(count), *(["--prefix", prefix] if prefix else [])]
        return self._add(["serve", *options, "--", simulation], "")

    def start_broker(self, port: int) -> Job:
        """Start a broker for this user's programs alone. Raises InputError for an impossible port."""
        if not 1 <= port <= MOST_PORT:
            raise InputError(f"port: must be from 1 to {MOST_PORT}, not {port}")
        return self._add(["broker", "--port", str(port)], "")

    def stop(self, job: str) -> Job:
        """Interrupt a job, which keeps what it has; one that waits leaves the queue.

        Raises InputError when there is no such job, or another machine has it.
        """
        if self._read(job) is None:
            raise InputError(f"{job[:100]}: there is no such job")
        with self._lock():
            current = self._read(job)
            process = self._read_process(job)
            if current is not None and current.state == "running" and process is not None:
                if not process.is_local:
                    raise InputError(f"the job runs on {process.host}; stop it in a window there")
                (self._jobs / job / "stopped").touch()
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGINT)
            elif current is not None and current.state == "waiting":
                (self._jobs / job / "stopped").touch()
                (self._jobs / job / "status").write_text("130\n")
        stopped = self._read(job)
        if stopped is None:
            raise InputError(f"{job}: the job is gone")
        return stopped

    def advance(self) -> None:
        """Start jobs that wait, as many as there are free processors and servers."""
        if not self._jobs.is_dir():
            return
        with self._lock():
            self._children = [child for child in self._children if child.poll() is None]
            jobs = self.list_jobs()
            for job in self._choose(jobs):
                self._run(job)
            for job in jobs[MOST_JOBS:]:
                if job.state not in {"waiting", "running"}:
                    shutil.rmtree(self._jobs / job.id, ignore_errors=True)
                    self._ended.pop(job.id, None)

    def _choose(self, jobs: list[Job]) -> Iterator[Job]:
        """Yield the jobs whose turn it is, the oldest first."""
        used = Counter(
            (job.broker, job.prefix)
            for job in jobs
            if job.state == "running" and not job.is_free and (job.broker or not job.host)
        )
        for job in reversed(jobs):
            if job.state != "waiting":
                continue
            if job.is_free:
                yield job
                continue
            kind = (job.broker, job.prefix)
            if used[kind] < (self._slots if not job.broker else max(self._count_servers(*kind) or 1, 1)):
                used[kind] += 1
                yield job

    def _add(self, arguments: list[str], run: str, broker: tuple[str, str] = ("", "")) -> Job:
        name = f"{time.time_ns():020d}-{secrets.token_hex(4)}"
        job = Job(name, arguments, run, time.time(), broker=broker[0], prefix=broker[1])
        folder = self._jobs / job.id
        try:
            make_private_folder(folder)
            (folder / "job.json.new").write_text(json.dumps(asdict(job)), encoding="utf-8")
            (folder / "job.json.new").rename(folder / "job.json")
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
        return job

    def _run(self, job: Job) -> None:
        folder = (self._jobs / job.id).absolute()
        command = [sys.executable, "-P", "-m", "swarmwright", *job.arguments]
        with (folder / "output.txt").open("wb") as output:
            output.write(f"$ swarmwright {shlex.join(job.arguments)}\n".encode())
            output.flush()
            try:
                process = subprocess.Popen(
                    [*SHELL, str(folder / "status"), *command], cwd=self.folder, stdin=subprocess.DEVNULL,
                    stdout=output, stderr=subprocess.STDOUT, start_new_session=True,
                )  # fmt: skip
            except OSError as error:  # no more processes, no folder: the others shall not wait for this job
                output.write(f"cannot be started: {error}\n".encode())
                (folder / "status").write_text("126\n")
                return
        self._children.append(process)
        (folder / "process").write_text(json.dumps(asdict(Process.of(process.pid))), encoding="utf-8")

    def _read(self, name: str) -> Job | None:
        if name in self._ended:
            return self._ended[name]
        folder = self._jobs / name
        try:
            if not is_id(name):
                return None
            job = Job(**json.loads((folder / "job.json").read_text("utf-8")))
        except (OSError, ValueError, TypeError):
            return None
        status = self._status(folder)
        process = self._read_process(name)
        is_started = (folder / "process").exists()
        if status is None and is_started and (process is None or not process.is_running):
            status = self._status(folder)  # between the two looks it may have ended
            state = "failed"
        else:
            state = "running" if is_started else "waiting"
        if status is not None:
            state = "done" if status == 0 else "stopped" if (folder / "stopped").exists() else "failed"
        host = "" if process is None or process.is_local else process.host
        line = last_line(tail(folder / "output.txt", LINE_BYTES))
        job = replace(job, state=state, status=status, line=line, host=host)
        if status is not None:
            self._ended[name] = job
        return job

    @staticmethod
    def _status(folder: Path) -> int | None:
        try:
            return int((folder / "status").read_text())
        except (OSError, ValueError):
            return None

    def _read_process(self, name: str) -> Process | None:
        """Return where the process of a job is, or was; None before it is started."""
        try:
            values = json.loads((self._jobs / name / "process").read_text("utf-8"))
            process = Process(**{**values, "pid": int(values["pid"])})
        except (OSError, ValueError, TypeError, KeyError):
            return None
        return process if process.pid > 1 else None  # the others mean many processes at once

    @contextlib.contextmanager
    def _lock(self) -> Iterator[None]:
        file = self._jobs / "lock"
        try:
            make_private_folder(self._jobs)
            lock = file.open("w")
            fcntl.flock(lock, fcntl.LOCK_EX)
        except OSError as error:
            raise InputError(f"{file}: cannot be locked: {error.strerror}") from None
        with lock:
            yield


def run_python(code: str, arguments: list[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a few lines of Python in a folder, whose files cannot take the place of modules.

    Raises TimeoutExpired after `CHECK_S` seconds, and OSError where no process can be started.
    """
    return subprocess.run(
        [sys.executable, "-P", "-c", code, *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=CHECK_S,
        check=False,
    )


def require_name(name: str) -> None:
    """Raise InputError for what cannot be the name of a run."""
    if NAME.fullmatch(name) is None:
        raise InputError(
            f"name: {name[:100]!r}: use letters, digits, '_', '-' and '.', at most 100, and no '.' first"
        )


def read_start_time(process: int) -> str:
    """Return when a process was started, in ticks since the computer was; empty where it has ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] == "Z" else fields[19]


def read_boot_id() -> str:
    """Return what tells this start of the machine from all others; empty where that is not known."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def is_id(name: str) -> bool:
    """Return whether a text can be the id of a job: it becomes part of a path."""
    return ID.fullmatch(name) is not None


def tail(file: Path, most: int = OUTPUT_BYTES) -> str:
    """Return the end of what a job has printed."""
    try:
        with file.open("rb") as stream:
            stream.seek(max(0, file.stat().st_size - most))
            return stream.read(most).decode(errors="replace")
    except OSError:
        return ""


def last_line(text: str) -> str:
    """Return the last line of a text that is not empty."""
    return next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "")


def read_broker(text: str) -> tuple[str, str]:
    """Return the broker of an experiment and the prefix there; empty texts where it uses none.

    It is that of `optimize`: of the experiment, or of the environment.
    """
    try:
        values = yaml.parse(text, "experiment").values
    except InputError:
        return "", ""
    if not isinstance(values, dict) or values.get("servers") in ("local", "in-process"):
        return "", ""
    broker = values.get("broker") or os.environ.get("SWARMWRIGHT_BROKER", "")
    prefix = values.get("prefix") or os.environ.get(PREFIX_VARIABLE, "")
    return (str(broker), str(prefix)) if broker else ("", "")


def problems(output: str, file: str) -> Iterator[dict[str, Any]]:
    """Yield the lines of an error of `Experiment.load`, each with its line in the file if it has one."""
    for line in output.splitlines():
        match = re.match(rf"\s*(?:\S*/)?{re.escape(file)}:(\d+): (.*)", line)
        if match:
            yield {"line": int(match[1]), "message": match[2]}
        elif line.strip():
            message = line.strip().replace(f"{file}: ", "").replace(file, "the file")
            yield {"line": None, "message": re.sub(r"\.check-\w+-sweep\.yaml:(\d+: )?", "", message).strip()}
