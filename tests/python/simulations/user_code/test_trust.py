"""Code that comes with a run folder of somebody else's is executed when it is trusted, and not before."""

import contextlib
import errno
import json
import os
import pty
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Experiment, InputError, Run, optimize, post_evaluate, repeat, resume, simulate
from swarmwright.common import warn_once
from swarmwright.runs.store.database import seal_facts
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.permission import require_named
from swarmwright.simulations.user_code.trust import digest_of
from tests.conftest import PROGRAM, environment
from tests.python.simulations.user_code.conftest import EXPERIMENT, GATHER

Program = Callable[..., "subprocess.CompletedProcess[str]"]

MARK = "import pathlib; pathlib.Path({mark!r}).touch()\n"
"""Shows that code was executed."""


@pytest.fixture
def received(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run folder that somebody else has made; whoever works on in the test has never seen its code."""
    (project / "gather.py").write_text(MARK.format(mark=str(tmp_path / "executed")) + GATHER)
    out = optimize(
        Experiment.load("gather.yaml"), lambda generation: generation.generation < 1, out="run"
    ).path
    folder = tmp_path / "received" / "run"
    shutil.copytree(out, folder)
    shutil.rmtree(project)
    (tmp_path / "executed").unlink()
    monkeypatch.chdir(tmp_path)
    another_user(tmp_path / "state", monkeypatch)
    return folder


def another_user(state: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(state))
    monkeypatch.setattr(trust, "_granted", set())
    monkeypatch.setattr(warn_once, "_given", set())


USES: dict[str, Callable[[Path], object]] = {
    "resume": resume,
    "repeat": lambda folder: repeat(Run.open(folder)),
    "post_evaluate": lambda folder: post_evaluate(Run.open(folder), episodes=2),
    "simulate": lambda folder: simulate(Experiment.load(folder / "experiment.yaml")),
    "optimize": lambda folder: optimize(folder / "experiment.yaml", out="another"),
}


@pytest.mark.slow
@pytest.mark.parametrize("use", USES)
def test_nothing_of_it_is_executed_before_it_is_trusted(use: str, received: Path, tmp_path: Path) -> None:
    words = r"simulation/gather\.py \(SHA-256 [0-9a-f]{16}\.\.\) is code named by a run folder, with 1 more"
    with pytest.raises(InputError, match=f"{words} files.*--trust .*trust=True"):
        USES[use](received)
    assert Run.open(received).evaluations, "reading executes nothing"
    assert not (tmp_path / "executed").exists()
    Run.open(received, trust=True)
    USES[use](received)
    assert (tmp_path / "executed").exists()


@pytest.mark.slow
def test_what_is_trusted_is_remembered_for_this_code(
    received: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resume(received, trust=True)
    monkeypatch.setattr(trust, "_granted", set())  # another process
    shutil.move(received, tmp_path / "moved")
    assert repeat(Run.open(tmp_path / "moved")).same
    helper = tmp_path / "moved" / "code" / "1" / "simulation" / "helper.py"
    helper.write_text(helper.read_text() + "\n")
    with pytest.raises(InputError, match="was edited"):
        repeat(Run.open(tmp_path / "moved"))


@pytest.mark.slow
def test_a_state_that_cannot_be_written_holds_for_the_process(
    received: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "state").write_text("no folder")
    run = Run.open(received, trust=True)
    assert repeat(run).same
    assert "later commands will ask whether to trust the code of this run, or need --trust" in caplog.text


def no_home(monkeypatch: pytest.MonkeyPatch, _folder: Path) -> None:
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.delenv("HOME")
    monkeypatch.setattr(os, "getuid", lambda: 3_999_999_999)


def home_of_another(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    def refuse(path: Path) -> bool:  # to root, all folders are open
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "another"))
    for name in ("is_file", "exists"):
        monkeypatch.setattr(Path, name, refuse)


@pytest.mark.parametrize("lacking", [no_home, home_of_another])
def test_without_a_state_a_process_knows_what_it_was_told(
    lacking: Callable[[pytest.MonkeyPatch, Path], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    code = {"simulation.py": "0" * 64}
    with monkeypatch.context() as patched:
        lacking(patched, tmp_path)
        assert not trust.is_trusted(code)
        monkeypatch.setattr(warn_once, "_given", set())
        trust.remember(code, "it")
        assert trust.is_trusted(code)
        trust.remember({"simulation.py": "1" * 64}, "it, with other files")
    assert caplog.text.count("later commands will ask whether to trust the code of this run") == 1


@pytest.mark.parametrize("relative", ["state", ""])
def test_a_relative_state_is_ignored(relative: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is trusted does not depend on the folder in which a command is run."""
    monkeypatch.setenv("XDG_STATE_HOME", relative)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert trust.folder() == tmp_path / ".local" / "state" / "swarmwright" / "trusted-code"


@pytest.mark.journey
def test_the_program_asks_or_refuses(received: Path, tmp_path: Path, program: Program) -> None:
    for command in ("replay", "evaluate", "resume"):
        refused = program(command, received)
        assert (refused.returncode, refused.stdout.count("Fitness")) == (2, 0)
        assert "so it is not executed" in refused.stderr
        assert "--trust" in refused.stderr
    assert not (tmp_path / "executed").exists()
    shown = on_terminal("evaluate", str(received), answer="n")
    assert "Trust it from now on, and execute it? [y/N]" in shown
    assert "so it is not executed" in shown
    assert not (tmp_path / "executed").exists()
    assert "The fitness is the same, to the bit." in on_terminal("evaluate", str(received), answer="y")
    assert program("evaluate", received).returncode == 0


@pytest.mark.slow
def test_the_option_of_the_program(received: Path, program: Program) -> None:
    assert program("evaluate", received, "--servers", "1", "--trust").returncode == 0
    assert program("replay", received, "--json").returncode == 2, "it has nothing to show"
    assert program("resume", received).returncode == 0


def on_terminal(*arguments: str, answer: str) -> str:
    ours, its = pty.openpty()
    process = subprocess.Popen([*PROGRAM, *arguments], stdin=its, stdout=its, stderr=its, env=environment())
    os.close(its)
    os.write(ours, f"{answer}\n".encode())
    said = b""
    with contextlib.suppress(OSError):
        while got := os.read(ours, 65536):
            said += got
    process.wait(30)
    os.close(ours)
    return said.decode().replace("\r", "")


@pytest.mark.slow
@pytest.mark.parametrize("disguise", ["", "x.dist-info", "site-packages"])
@pytest.mark.parametrize("simulation", ["lib.gather:Gather", "lib/gather.py:Gather"])
def test_modules_and_files_beside_it(
    simulation: str, disguise: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Found in the working folder, where the archive was unpacked."""
    monkeypatch.chdir(tmp_path)
    lib = tmp_path / "lib"
    lib.mkdir()
    (lib / "gather.py").write_text(MARK.format(mark=str(tmp_path / "executed")) + GATHER)
    (lib / "helper.py").write_text("GAIN = 0.1\n")
    (tmp_path / "helper.py").write_text("GAIN = 0.1\n")
    if disguise:
        (lib / disguise).mkdir()
        (tmp_path / disguise).mkdir()
    (tmp_path / "x.yaml").write_text(EXPERIMENT.replace("gather.py:Gather", simulation))
    optimize("x.yaml", lambda _: False, out="run")
    (tmp_path / "executed").unlink()
    another_user(tmp_path / "state", monkeypatch)
    shutil.rmtree("run/code")
    with contextlib.closing(sqlite3.connect("run/run.sqlite")) as store, store:
        store.execute("DELETE FROM fact WHERE name = 'code.1'")
        named = simulation.replace("lib/", "../lib/")
        (kept,) = store.execute("SELECT value FROM fact WHERE name = 'experiment'").fetchone()
        values = json.loads(kept) | {"simulation": named}
        store.execute("UPDATE fact SET value = ? WHERE name = 'experiment'", (json.dumps(values),))
        seal_facts(store)  # whoever writes a store can write its digests
    Path("run/experiment.yaml").unlink()
    for use in ("repeat", "resume"):
        with pytest.raises(InputError, match="so it is not executed"):
            USES[use](tmp_path / "run")
    assert not (tmp_path / "executed").exists()
    assert repeat(Run.open("run", trust=True)).same


@pytest.mark.slow
def test_environments_of_other_libraries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    another_user(tmp_path / "state", monkeypatch)
    (tmp_path / "evil").mkdir()
    (tmp_path / "evil" / "env.py").write_text("")
    (tmp_path / "evil" / "deep" / "er").mkdir(parents=True)
    (tmp_path / "evil" / "deep" / "er" / "env.py").write_text("")
    for name in ("gymnasium:evil.env:E-v0", "pettingzoo:evil.env?N=2", "pettingzoo:evil.deep.er.env"):
        with pytest.raises(InputError, match=r"env\.py"):
            require_named(name)
    for name in ("gymnasium:CartPole-v1", "pettingzoo:mpe2.simple_spread_v3"):
        require_named(name)
    for name in ("json:Decoder", "numpy:ndarray", "swarmwright:Simulation"):
        require_named(name)


@pytest.mark.slow
def test_another_class_is_the_users_own_order(received: Path, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(GATHER.replace("from helper import GAIN", "GAIN = 0.1"))
    assert repeat(Run.open(received), simulation="own.py:Gather").same
    assert not (tmp_path / "executed").exists()


files = st.dictionaries(st.text(), st.text())


@given(one=files, other=files)
def test_digests_differ_where_files_do(one: dict[str, str], other: dict[str, str]) -> None:
    assert (digest_of(one) == digest_of(other)) == (one == other)
    assert digest_of(dict(reversed(one.items()))) == digest_of(one)


BESIDE: dict[str, str] = {
    "slow": "ranking: {kind: multi_fidelity, slow: {simulation: beside.py:Gather}}\n",
    "transfer": "validate: {episodes: 0, seeds: 2, to: [{simulation: beside.py:Gather}]}\n",
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", BESIDE)
def test_nor_is_what_a_run_names_beside_its_own(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only reading what the sender has made, and going on with it, are ways to it."""
    (tmp_path / "beside.py").write_text(MARK.format(mark=str(tmp_path / "executed")) + GATHER)
    (tmp_path / "helper.py").write_text("GAIN = 0.1\n")
    (tmp_path / "gather.py").write_text(GATHER)
    (tmp_path / "x.yaml").write_text(EXPERIMENT + BESIDE[kind])
    run = optimize(tmp_path / "x.yaml", lambda now: now.generation < 1, out=tmp_path / "run")
    assert (tmp_path / "executed").exists()
    assert len(run.transferred) == (kind == "transfer")
    (tmp_path / "executed").unlink()
    another_user(tmp_path / "state", monkeypatch)
    Run.open(run.path, trust=True)  # its own code, that is
    for name in [name for name, module in sys.modules.items() if hasattr(module, "Gather")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr("swarmwright.simulations.names.files", {})
    refused = r"beside\.py \(SHA-256 .*is code named by a run folder"
    with pytest.raises(InputError, match=refused):
        optimize(Experiment.load(run.path / "experiment.yaml"), out=tmp_path / "again")
    if kind == "slow":
        with pytest.raises(InputError, match=refused):
            resume(run.path)
    else:
        resume(run.path, settings=["validate.seeds=3"])
        assert Run.open(run.path).transfer_is_due, "it was refused, which is a warning by then"
    assert not (tmp_path / "executed").exists()
