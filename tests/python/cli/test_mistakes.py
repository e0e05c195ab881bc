"""Mistakes at the command line, and unusual surroundings, end in a message."""

import errno
import json
import os
import re
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, optimize
from swarmwright.cli._main import run as swarmwright
from swarmwright.runs.store.lock import Lock


def program(*arguments: str, **variables: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "swarmwright", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=60, env={**os.environ, **variables}, check=False
    )


@pytest.mark.slow
def test_closed_standard_output(finished: Run) -> None:
    words = " ".join([sys.executable, "-m", "swarmwright", "runs", "show", str(finished.path)])
    for closed in (">&-", "<&- >&-", "<&- >&- 2>&-"):
        done = subprocess.run(
            ["/bin/sh", "-c", f"{words} {closed}"], capture_output=True, text=True, timeout=60, check=False
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "status"), [("-Sn", 0), ("-n", 1)], ids=["soft", "hard"])
def test_the_limit_of_open_files_is_raised_as_far_as_allowed(limit: str, status: int, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text("simulation: minisim\nservers: 8\nmethod: {generations: 1}\n")
    words = f"ulimit {limit} 40; {sys.executable} -m swarmwright optimize x.yaml --out run"
    done = subprocess.run(
        ["/bin/bash", "-c", words], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == status, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "servers"), [(64, 40), (24, 2), (10, 1)])
def test_too_few_open_files_are_named_with_the_limit(tmp_path: Path, limit: int, servers: int) -> None:
    (tmp_path / "x.yaml").write_text(f"simulation: minisim\nservers: {servers}\n")
    words = f"ulimit -n {limit}; {sys.executable} -m swarmwright optimize x.yaml --out run"
    done = subprocess.run(
        ["/bin/sh", "-c", words], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode in (1, 2)
    told = f"Too many open files; the limit of this process is {limit}; raise it (ulimit -n 4096)"
    assert told in done.stderr


@pytest.mark.slow
def test_a_required_package_of_another_version_is_named(tmp_path: Path) -> None:
    """It is no bug in Swarmwright: another package may have installed it."""
    (tmp_path / "pydantic").mkdir()
    (tmp_path / "pydantic" / "__init__.py").write_text("")
    (tmp_path / "pydantic-1.9.0.dist-info").mkdir()
    (tmp_path / "pydantic-1.9.0.dist-info" / "METADATA").write_text("Name: pydantic\nVersion: 1.9.0\n")
    done = program("schema", PYTHONPATH=str(tmp_path))
    assert done.returncode == 1
    assert re.search(
        r"^swarmwright: the package pydantic 1\.9\.0 cannot be used \(cannot import name '\w+' from "
        r"'pydantic'.*: Swarmwright needs (pydantic>=\S+,<3): pip install '\1'$",
        done.stderr.strip(),
    )
    (tmp_path / "pydantic" / "__init__.py").write_text("import annotated_types_of_another_name")
    assert "internal error: ModuleNotFoundError" in program("schema", PYTHONPATH=str(tmp_path)).stderr


@pytest.mark.slow
def test_a_run_that_another_process_works_on_is_not_resumed(finished: Run) -> None:
    """Nothing is printed before that is said."""
    lock = Lock(finished.path)
    try:
        done = program("resume", str(finished.path), "--generations", "9")
    finally:
        lock.close()
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"swarmwright: {finished.path}: another process is writing this run; wait for it, or stop it\n"
    )


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", "1"])
def test_a_failed_episode_is_explained_once(servers: str, tmp_path: Path) -> None:
    (tmp_path / "failing.py").write_text(
        "from swarmwright import Simulation\n\n\n"
        "class Failing(Simulation):\n"
        "    sensors = actuators = 1\n"
        "    step = done = fitness = lambda self, *_: True\n"
        "    def reset(self, parameters, seed):\n"
        "        raise ValueError('no start')\n"
    )
    (tmp_path / "failing.yaml").write_text(f"simulation: failing.py:Failing\nservers: {servers}\n")
    done = program("simulate", str(tmp_path / "failing.yaml"))
    assert done.returncode == 1
    assert done.stderr.count("ValueError: no start") == 1, done.stderr


@pytest.mark.slow
def test_settings_of_matplotlib_do_not_count(finished: Run, tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\naxes.facecolor: red\nbackend: nothing\n")
    (tmp_path / "empty").touch()
    pictures = []
    for number, variables in enumerate(
        [
            {"MATPLOTLIBRC": str(tmp_path / "empty")},
            {"MATPLOTLIBRC": str(tmp_path / "matplotlibrc"), "MPLBACKEND": "bogus"},
        ]
    ):
        file = tmp_path / f"{number}.png"
        done = program("plot", str(finished.path), "--out", str(file), **variables)
        assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
        still = tmp_path / f"still-{number}.png"
        done = program("replay", str(finished.path), "--save", str(still), **variables)
        assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
        pictures.append((file.read_bytes(), still.read_bytes()))
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize(("options", "words"), [("--every 2", "--watch"), ("--watch --wait 2", "--wait")])
def test_options_of_servers_that_would_have_no_effect(
    options: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert swarmwright(["servers", *options.split()]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("wait", ["nan", "inf", "-1"])
def test_what_is_no_time_to_wait(
    wait: str, finished: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert swarmwright(["resume", str(finished.path), "--wait", wait]) == 2
    assert "Invalid value for '--wait'" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"^wait: is .*, expected seconds: a finite number, at least 0"):
        optimize(
            Experiment.from_mapping({"simulation": "minisim", "servers": 1}),
            wait=float(wait),
            broker="mqtt://127.0.0.1:1",
            out=tmp_path / "run",
        )


def test_deleting_a_link_deletes_nothing(
    copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link = tmp_path / "link"
    link.symlink_to(copy)
    before = sorted(copy.iterdir())
    assert swarmwright(["runs", "delete", str(link), "--yes"]) == 2
    assert f"link: is a symbolic link to {copy}. Name that folder" in capsys.readouterr().err
    assert sorted(copy.iterdir()) == before
    assert link.is_symlink()


def test_a_run_that_may_not_be_read_is_not_called_damaged(
    copy: Path, finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    read = Path.open

    def refuse(self: Path, *arguments: Any, **options: Any) -> Any:
        if self.parent == copy:
            raise PermissionError(13, "Permission denied", str(self))
        return read(self, *arguments, **options)

    monkeypatch.setattr(Path, "open", refuse)
    assert swarmwright(["runs", "verify", str(copy), str(finished.path), "--json"]) == 2
    found = capsys.readouterr()
    assert f"{copy}/run.sqlite: cannot be read, so it was not verified: Permission denied" in found.err
    assert [json.loads(line)["run"] for line in found.out.splitlines()] == [str(finished.path)]


def test_a_run_of_a_newer_format_is_not_called_damaged(
    copy: Path, finished: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    with closing(sqlite3.connect(copy / "run.sqlite")) as store:
        store.execute("PRAGMA user_version = 99")
    assert swarmwright(["runs", "verify", str(copy), str(finished.path), "--json"]) == 2
    found = capsys.readouterr()
    assert "has format 99, but this version of Swarmwright reads format " in found.err
    assert [json.loads(line)["run"] for line in found.out.splitlines()] == [str(finished.path)]


TALKATIVE = """
from swarmwright import Simulation

print("imported")


class Talkative(Simulation):
    title, sensors, actuators = "talkative", 2, 1

    def reset(self, parameters, seed):
        print("reset")
        self.result = None
        return [[0.5, -0.5]]

    def step(self, actuators):
        self.result = float(actuators[0][0])
        return [[0.5, -0.5]]

    def done(self):
        return self.result is not None

    def fitness(self):
        return self.result
"""


def test_what_code_prints_is_not_among_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "talkative.py").write_text(TALKATIVE)
    (tmp_path / "talkative.yaml").write_text(
        "simulation: talkative.py:Talkative\ncontroller: {kind: layered, hidden: []}\n"
        "method: {population: 4, generations: 1}\nservers: in-process\n"
    )
    monkeypatch.chdir(tmp_path)
    assert swarmwright(["optimize", "talkative.yaml", "--out", "run", "--json"]) == 0
    found = capsys.readouterr()
    lines = [json.loads(line) for line in found.out.splitlines()]
    assert lines[-1]["run"] == "run"
    assert "reset\n" in found.err
    assert swarmwright(["evaluate", "run", "--json"]) == 0
    found = capsys.readouterr()
    assert json.loads(found.out)["same"] is True
    assert "reset\n" in found.err
    # Without --json it is where it was.
    assert swarmwright(["evaluate", "run"]) == 0
    assert "reset\n" in capsys.readouterr().out


@pytest.mark.slow
def test_what_c_code_prints_is_not_among_json(tmp_path: Path, program: Any) -> None:
    prints = 'ctypes.CDLL(None).puts(b"from C")\n        os.write(1, b"written\\n")'
    code = TALKATIVE.replace('print("reset")', prints).replace("class", "import ctypes, os\n\n\nclass", 1)
    (tmp_path / "talkative.py").write_text(code)
    (tmp_path / "talkative.yaml").write_text(
        "simulation: talkative.py:Talkative\ncontroller: {kind: layered, hidden: []}\n"
        "method: {population: 4, generations: 1}\nservers: in-process\n"
    )
    done = program("optimize", "talkative.yaml", "--out", "run", "--json")
    assert [json.loads(line) for line in done.stdout.splitlines()][-1]["run"] == "run"
    assert "from C\n" in done.stderr
    assert "written\n" in done.stderr
    assert "from C\n" in program("evaluate", "run").stdout


def test_too_little_memory_is_no_bug(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> object:
        raise MemoryError

    monkeypatch.setattr("swarmwright.cli._main._invoke", fail)
    assert swarmwright(["runs", "list"]) == 1
    assert "out of memory: use a smaller population" in capsys.readouterr().err


class PanicException(BaseException):
    """One of the engine."""


PanicException.__module__ = "pyo3_runtime"


@pytest.mark.parametrize(
    "error",
    [
        RuntimeError("can't start new thread"),
        OSError(errno.EAGAIN, "Resource temporarily unavailable"),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        PanicException("The global thread pool has not been initialized.: ThreadPoolBuildError { code: 11 }"),
    ],
)
def test_that_no_thread_can_be_started_is_no_bug(
    error: BaseException, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> object:
        raise error

    monkeypatch.setattr("swarmwright.cli._main._invoke", fail)
    assert swarmwright(["runs", "list"]) == 1
    shown = capsys.readouterr().err
    assert "no memory or threads are left for this process; raise its limits (ulimit -v, ulimit -u" in shown
    assert "bug" not in shown


@pytest.mark.slow
def test_an_experiment_whose_name_is_not_utf8_leaves_no_folder(tmp_path: Path) -> None:
    (tmp_path / "übung 1.yaml").write_text("simulation: minisim\n")
    done = subprocess.run(
        [sys.executable, "-m", "swarmwright", "optimize", "übung 1.yaml".encode()],
        cwd=tmp_path,
        capture_output=True,
        timeout=60,
        env={**os.environ, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
        check=False,
    )
    assert done.returncode == 2
    assert b"bung 1: is not valid UTF-8" in done.stderr
    assert done.stderr.endswith(b"; set PYTHONUTF8=1, or a locale with UTF-8 (LC_ALL=C.UTF-8)\n")
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_names_that_are_not_utf8(program: Any, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text("simulation: minisim\n")
    for arguments in (["optimize", "x.yaml", "--out", "b\udce4d"], ["broker", "--init", "b\udce4d"]):
        result = program(*arguments)
        assert result.returncode == 2
        assert "\\xe4d" in result.stderr
        assert "is not valid UTF-8, in which files of runs and brokers are written; use another name" in (
            result.stderr
        )
    assert not list(tmp_path.glob("b*"))


@pytest.mark.slow
def test_what_a_picture_shows_needs_a_picture(program: Any, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(
        "simulation: minisim\nmethod: {kind: nnga, population: 4, generations: 1}\n"
    )
    assert program("optimize", "x.yaml", "--servers", "in-process", "--out", "run").returncode == 0
    for option in (["--show", "rays"], ["--colors", "controller"]):
        for more in ([], ["--json"]):
            result = program("replay", "run", *option, *more)
            assert result.returncode == 2
            assert f"{option[0]} needs --save; add it" in result.stderr
    assert program("replay", "run", "--show", "rays", "--save", "x.png").returncode == 0
    for option in (["--set", "parameters.seed=3"],):
        assert "set the seed of episodes with --seed" in program("replay", "run", *option).stderr
        assert "set the seed of episodes with --seed" in program("evaluate", "run", *option).stderr


@pytest.mark.slow
def test_nobody_is_there_to_confirm(program: Any, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(
        "simulation: minisim\nmethod: {kind: nnga, population: 4, generations: 1}\n"
    )
    assert program("optimize", "x.yaml", "--servers", "in-process", "--out", "run").returncode == 0
    result = program("runs", "delete", "run")
    assert result.returncode == 2
    assert "there is no terminal to confirm on; give --yes. Nothing was deleted." in result.stderr
    assert (tmp_path / "run" / "run.sqlite").exists()
    assert program("runs", "delete", "run", "--yes").returncode == 0
