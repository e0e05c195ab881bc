"""Whatever goes wrong with a command is a failed evaluation with its reason, and no process is left."""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from swarmwright import InputError, RunError, evaluate, simulate
from swarmwright.simulations.command import simulation as command
from swarmwright.simulations.command.process import CommandFailure, Processes, explain_missing_script
from swarmwright.simulations.command.work_files import Instance
from tests.python.simulations.command.processes import WELL, Traced


@pytest.mark.slow
def test_well(traced: Traced) -> None:
    assert simulate(traced.shell(WELL)) == 1.5
    assert traced.left() == []
    # Its work folder is gone.
    assert [path for path in (traced.folder / "work").rglob("*") if path.is_file()] == []


def test_no_such_program(traced: Traced) -> None:
    """Known before any episode."""
    with pytest.raises(InputError, match=r"command: there is no program 'pyhton3' on the PATH.*'python3"):
        simulate(traced.experiment("pyhton3 sim.py"))
    with pytest.raises(InputError, match=r"on the PATH or beside the experiment file$"):
        simulate(traced.experiment("mysimulator --x"))  # of those on the PATH, none is near enough
    (traced.folder / "mysim.py").write_text("")
    with pytest.raises(InputError, match=r"; did you mean 'mysim\.py'\?$"):
        simulate(traced.experiment("mysimulator --x"))
    with pytest.raises(InputError, match=r"sims/run: there is no such file"):
        simulate(traced.experiment("sims/run {parameters}"))


@pytest.mark.slow
def test_program_that_cannot_be_executed(traced: Traced) -> None:
    script = traced.folder / "sim.py"
    script.write_text("#!/no/such/interpreter\n")
    with pytest.raises(
        InputError, match=r"not executable; write command: python3 sim\.py \.\., or chmod \+x"
    ):
        simulate(traced.experiment("sim.py {parameters}"))
    script.chmod(0o755)
    with pytest.raises(RunError, match=r"the program named in its first line \(#!\) does not exist"):
        simulate(traced.experiment("./sim.py {parameters}"))


@pytest.mark.slow
def test_a_program_that_goes_while_it_is_used(traced: Traced) -> None:
    program = traced.folder / "sim"
    program.write_text(f"#!/bin/sh\n{WELL}\nrm {program}\n")
    program.chmod(0o755)
    fitness = evaluate(traced.experiment("./sim"), [[0.0], [0.5]])
    assert [str(value) for value in fitness] == ["1.5", "nan"]


@pytest.mark.slow
def test_exit_status_with_the_end_of_the_output(traced: Traced) -> None:
    reason = traced.fails("for i in 1 2 3 4 5; do echo line $i; done; echo out of fuel >&2; exit 7")
    # Without a path: runs store it, and count failures with the same reason.
    assert reason.endswith("sh: ended with exit status 7; its last output: line 4 | line 5 | out of fuel")


@pytest.mark.slow
def test_the_work_folder_that_is_named_is_that_of_the_failure(
    traced: Traced, caplog: pytest.LogCaptureFixture
) -> None:
    """One for each kind of failure, whatever fails afterwards; their parameters tell them apart."""
    script = "read -r _ speed < parameters.yaml; case $speed in 0.2*|0.4*) exit 2;; *) exit 3;; esac"
    speeds = [0.1, 0.2, 0.3, 0.4]
    evaluate(traced.shell(script, fitness="fitness"), [[speed] for speed in speeds])
    said = [line for line in caplog.messages if "the work folder of this episode is kept: " in line]
    reasons, kept = zip(
        *(line.split("; the work folder of this episode is kept: ") for line in said), strict=True
    )
    assert reasons == ("sh: ended with exit status 3", "sh: ended with exit status 2")
    texts = [Path(folder).joinpath("parameters.yaml").read_text() for folder in kept]
    assert [float(text.split()[1]) for text in texts] == pytest.approx(speeds[:2], abs=1e-6)
    assert len(list((traced.folder / "work").rglob("failed-*"))) == 2


@pytest.mark.slow
def test_signal(traced: Traced) -> None:
    assert "was ended by SIGSEGV" in traced.fails("kill -SEGV $$")


@pytest.mark.slow
def test_hang(traced: Traced) -> None:
    """It is asked to end first, as by Ctrl-C, so that it can clean up."""
    script = "trap 'echo cleaning up; exit 0' TERM; echo before; setsid sleep 1000 & sleep 1000 & wait"
    reason = traced.fails(script, timeout=0.5)
    assert "has not ended after 0.5 s (simulation.timeout), and was killed" in reason
    assert "its last output: before | cleaning up" in reason


@pytest.mark.slow
def test_hang_that_ignores_being_asked_to_end(traced: Traced) -> None:
    assert "has not ended" in traced.fails("trap '' TERM INT; while :; do sleep 0.05; done", timeout=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("log", "reason"),
    [
        (
            "time,fitness\\n1,2\\n2",
            r"log.csv:3: has 1 value, expected 2 columns; was the log cut off\?",
        ),
        ("time,fitness\\n", "log.csv: has no rows"),
        ("", "log.csv: has no rows"),
        ("fitness\\nnan\\n", "log.csv:2: fitness is nan, expected a finite number"),
        ("fitness\\n-inf\\n", "log.csv:2: fitness is -inf, expected a finite number"),
        ("fitness,fitness\\n1,2\\n", "log.csv: has several columns 'fitness'; give each a different name"),
        (
            "Simulator 3\\ntime,fitness\\n1,2\\n",
            "2: has 2 values, expected 1 column; their names were read from this line: 'Simulator 3'",
        ),
        ("time,fit\\rness\\n1,2\\n", "log.csv:1: has a carriage return without a line feed"),
        ("# Simulator 3\\ntime,fit\\rness\\n1,2\\n", "log.csv:2: has a carriage return without a line feed"),
        ("# 50\\r100\\nfitness\\nbad\\n", "log.csv:3: fitness is 'bad', expected a number"),
        ("fitness\\n1_000\\n", "log.csv:2: fitness is '1_000', expected a number"),
        ("fitness\\n\u0661\u0662\\n", "log.csv:2: fitness is '\u0661\u0662', expected a number"),
        ("time,fitness\\n1,2\\n# the end\\n3\\n", "log.csv:4: has 1 value, expected 2 columns"),
        ("fitness\\nbad\\n", "log.csv:2: fitness is 'bad', expected a number"),
        ("time,Fitnes\\n1,2\\n", "has no column 'fitness'; did you mean 'Fitnes'\\? available: time, Fitnes"),
    ],
)
def test_log(traced: Traced, log: str, reason: str) -> None:
    with pytest.raises(RunError, match=reason):
        simulate(traced.shell(f"printf '{log}' > log.csv"))
    assert traced.left() == []


@pytest.mark.slow
@pytest.mark.parametrize("log", ["time,fitness\\n1,2\\n# 3\\n4,5\\n", "fitness\\n2\\n# done\\n5\\n#\\n"])
def test_lines_of_comments_are_no_rows(traced: Traced, log: str) -> None:
    assert simulate(traced.shell(f"printf '{log}' > log.csv", metrics={"fitness": "mean"})) == 3.5


def test_folders_of_failed_episodes_stay_for_other_processes(tmp_path: Path) -> None:
    instance = Instance(tmp_path)
    try:
        for number in range(12):
            other = instance.folder / f"failed-{number}"
            other.mkdir()
            os.utime(other, (number, number))
        own = []
        for name in ("first", "second"):
            assert instance.is_first_of_kind(name)
            folder = instance.new_folder("episode")
            (folder / name).touch()
            own.append(instance.keep_failed(folder))
        assert (own[0] / "first").exists()
        assert (own[1] / "second").exists()
        others = [f"failed-{number}" for number in range(4, 12)]
        assert sorted(one.name for one in instance.folder.iterdir()) == sorted(
            [*others, *(one.name for one in own)]
        )
    finally:
        instance.close()


def test_a_later_instance_of_the_process_replaces_no_folder(tmp_path: Path) -> None:
    kept = []
    for name in ("first", "second"):
        instance = Instance(tmp_path)
        try:
            assert instance.is_first_of_kind(name)
            folder = instance.new_folder("episode")
            (folder / name).touch()
            kept.append(instance.keep_failed(folder) / name)
        finally:
            instance.close()
    assert all(file.exists() for file in kept)


def test_kinds_of_failures_are_bounded(tmp_path: Path) -> None:
    instance = Instance(tmp_path)
    try:
        first = [instance.is_first_of_kind(f"log.csv:{row}: fitness is nan") for row in range(3)]
        assert first == [True, False, False], "they differ in numbers alone"
        assert sum(instance.is_first_of_kind(f"ended with exit status {number}") for number in range(9)) == 4
    finally:
        instance.close()


@pytest.mark.slow
@pytest.mark.parametrize("most", [1000, 10], ids=["short", "too long for sockets"])
def test_temporary_files_go_with_the_work_folder(
    traced: Traced, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    # How long the path of the work folder is depends on that of the system's temporary folder.
    monkeypatch.setattr(command, "_LONGEST_TEMPORARY", most)
    where = traced.folder / "where"
    traced.fails(f"mktemp > {where}; kill -9 $$", keep="none")
    made = Path(where.read_text().strip())
    goes_with_it = traced.folder / "work" in made.parents
    assert goes_with_it == (most == 1000)
    assert made.exists() != goes_with_it
    made.unlink(missing_ok=True)


@pytest.mark.slow
def test_a_script_that_is_misspelt_is_known_before(traced: Traced) -> None:
    (traced.folder / "sim.py").touch()
    words = r"command: simm\.py: there is no such file beside the experiment file; did you mean 'sim\.py'\?"
    with pytest.raises(InputError, match=words):
        simulate(traced.experiment(f"{sys.executable} -u simm.py {{parameters}}"))
    (traced.folder / "other.py").write_text("open('log.csv', 'w').write('fitness\\n1.5\\n')")
    # In the work folder it has another name.
    for script in ("simm.py", "./simm.py"):
        assert simulate(traced.experiment(f"python3 {script}", files={"simm.py": "other.py"})) == 1.5


@pytest.mark.parametrize(
    ("command", "missing"),
    [
        ("python3 sims/run.py", True),
        ("java -jar sim.jar", True),
        ("node dist/app", False),  # Node adds .js
        ("java com/example/Main", False),  # a class
        ("java sim.jar", False),
    ],
)
def test_words_that_an_interpreter_does_not_take_for_files(
    tmp_path: Path, command: str, *, missing: bool
) -> None:
    assert (explain_missing_script(command.split(), tmp_path, []) is not None) == missing


@pytest.mark.slow
def test_a_field_that_is_too_long(traced: Traced) -> None:
    (traced.folder / "content").write_text(f"fitness,{'a' * (1 << 18)}\n1,2\n")
    with pytest.raises(RunError, match=r"log\.csv:1: is not a table: field larger than field limit"):
        simulate(traced.shell(f"cp {traced.folder}/content log.csv"))


@pytest.mark.slow
def test_no_log(traced: Traced) -> None:
    reason = traced.fails("echo > result.csv; echo written")
    assert (
        "without writing log.csv (simulation.log); its work folder contains: parameters.yaml, result.csv"
        in reason
    )
    assert "its last output: written" in reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "log", "reason"),
    [
        ("mkfifo log.csv", "log.csv", "log.csv: is a named pipe, expected a file"),
        ("ln -s /dev/zero log.csv", "log.csv", "log.csv: is a device, expected a file"),
        ("mkfifo one.csv", "*.csv", "one.csv: is a named pipe, expected a file"),
        ("mkdir bag.csv; mkfifo bag.csv/x", "bag.csv", "bag.csv/x: is a named pipe, expected a file"),
    ],
)
def test_a_log_that_is_not_a_file(traced: Traced, script: str, log: str, reason: str) -> None:
    """Reading it might never end, whatever the time-out is."""
    assert reason in traced.fails(script, log=log)


@pytest.mark.slow
def test_half_an_object(traced: Traced) -> None:
    reason = traced.fails('printf \'{"fitness": 1}\\n{"fitne\' > log.jsonl', log="log.jsonl")
    assert "log.jsonl:2: is not valid JSON" in reason
    assert "was the log cut off?" in reason


@pytest.mark.slow
@pytest.mark.parametrize(
    "script",
    [
        "sleep 1000 &",
        "setsid sleep 1000 &",  # in a session of its own
        "(setsid sh -c 'sleep 1000 & sleep 1000' > /dev/null 2>&1 &);",  # and nobody's child
    ],
)
def test_children_left_behind(traced: Traced, script: str) -> None:
    reason = traced.fails(f"{script} {WELL}")
    assert "left processes behind, which were killed: " in reason
    assert "sleep" in reason


@pytest.mark.slow
def test_children_that_are_ended_without_failure(traced: Traced) -> None:
    assert simulate(traced.shell(f"setsid sleep 1000 & {WELL}", children="end")) == 1.5
    assert traced.left() == []


@pytest.mark.slow
def test_children_that_end_soon_after(traced: Traced) -> None:
    assert simulate(traced.shell(f"sleep 0.1 & {WELL}")) == 1.5


@pytest.mark.slow
def test_one_large_file(traced: Traced) -> None:
    reason = traced.fails("exec head -c 100000000 /dev/zero > large", disk=2)
    assert "was ended by SIGXFSZ: a file of more than 2 MB (simulation.disk)" in reason
    assert not any(path.stat().st_size > 2_000_000 for path in (traced.folder / "work").rglob("large"))


@pytest.mark.slow
def test_many_files(traced: Traced) -> None:
    script = "i=0; while :; do i=$((i+1)); head -c 900000 /dev/zero > part-$i; done"
    assert "wrote more than 5 MB into its work folder (simulation.disk)" in traced.fails(script, disk=5)


@pytest.mark.slow
def test_a_gigabyte_of_output(traced: Traced) -> None:
    began = time.monotonic()
    reason = traced.fails("echo begins; exec head -c 1000000000 /dev/zero", output=1)
    assert "printed more than 1 MB (simulation.output), and was killed" in reason
    assert time.monotonic() - began < 10


@pytest.mark.slow
def test_one_failure_does_not_stop_the_others(traced: Traced) -> None:
    experiment = traced.shell(
        "if grep -q 'speed: 0.0$' parameters.yaml; then exit 3; fi; " + WELL, fitness="fitness"
    )
    fitness = evaluate(experiment, [[0.0], [0.5]])
    assert (str(fitness[0]), fitness[1]) == ("nan", 1.5)


PROGRAM = """
import sys
from swarmwright import simulate
from tests.python.simulations.command.processes import Traced
from pathlib import Path
traced = Traced(Path(sys.argv[1]))
traced.mark = sys.argv[2]
print(simulate(traced.shell("touch begun; (setsid sleep 1000 &) ; sleep 1000", disk=9), servers=sys.argv[3]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", "local"])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_the_tool_ends(traced: Traced, servers: str, end: signal.Signals) -> None:
    """However it ends, its commands end with it."""
    arguments = [sys.executable, "-c", PROGRAM, str(traced.folder), traced.mark, servers]
    tool = subprocess.Popen(arguments, stderr=subprocess.DEVNULL)
    try:
        _wait_for_sleepers(traced, 2)
        tool.send_signal(end)
        tool.wait(20)
        assert traced.left(within=10) == []
    finally:
        tool.kill()
        tool.wait()


POLITE = """
import sys
from swarmwright import simulate
from tests.python.simulations.command.processes import Traced
from pathlib import Path
traced = Traced(Path(sys.argv[1]))
traced.mark = sys.argv[2]
asked = traced.folder / "asked"
# Nobody reads what it prints then: a shell that reports the end of its `sleep` would end by that.
script = f"exec 2>&-; trap 'touch {asked}; exit' TERM; touch {traced.folder}/begun; "
script += "while :; do sleep 0.05; done"
print(simulate(traced.shell(script), servers=sys.argv[3]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", "local"])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_commands_are_asked_to_end(traced: Traced, servers: str, end: signal.Signals) -> None:
    """However the tool ends: a command that drives robots stops them then."""
    arguments = [sys.executable, "-c", POLITE, str(traced.folder), traced.mark, servers]
    tool = subprocess.Popen(arguments, stderr=subprocess.DEVNULL)
    try:
        until = time.monotonic() + 30
        while not (traced.folder / "begun").exists():
            assert time.monotonic() < until
            time.sleep(0.05)
        tool.send_signal(end)
        tool.wait(20)
        assert traced.left(within=10) == []
        assert (traced.folder / "asked").exists()
    finally:
        tool.kill()
        tool.wait()


def _wait_for_sleepers(traced: Traced, count: int) -> None:
    """Wait until so many `sleep` run: what is between its start and its program counts as a shell, or not."""
    until = time.monotonic() + 30
    while sum(line.startswith("sleep") for line in traced.left()) < count:
        assert time.monotonic() < until, traced.describe()
        time.sleep(0.05)


@pytest.mark.slow
def test_the_keeper_is_killed(traced: Traced) -> None:
    """As by a system that runs out of memory: the process notices, and ends what was left."""
    processes = Processes()
    script = ["sh", "-c", "(setsid sleep 1000 &) ; sleep 1000"]
    processes.start(script, traced.folder, {"TRACED": traced.mark}, 1000, (0, 1, 2))
    _wait_for_sleepers(traced, 2)
    os.kill(processes._keeper.pid, signal.SIGKILL)
    with pytest.raises(CommandFailure, match="the process that starts commands has ended"):
        processes.report()
    assert traced.left(within=5) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("kill -KILL $PPID; sleep 1000", "the process that starts commands has ended"),
        ("kill -STOP $PPID; sleep 1000", "the process that starts commands was stopped by a signal"),
        (f"kill -STOP $PPID; {WELL}", "the process that starts commands was stopped by a signal"),
    ],
)
def test_a_command_that_kills_or_stops_the_keeper_fails_at_once(
    traced: Traced, script: str, words: str
) -> None:
    began = time.monotonic()
    with pytest.raises(RunError, match=words):
        simulate(traced.shell(script, timeout=1000.0))
    assert time.monotonic() - began < 25, "not the time-out of the episode, nor that of an answer"
    assert traced.left(within=5) == []
    assert simulate(traced.shell(WELL)) == 1.5


@pytest.mark.slow
def test_the_keeper_ends_where_a_report_was_not_read(
    traced: Traced, capfd: pytest.CaptureFixture[str]
) -> None:
    processes = Processes()
    # What starts is said, and that it has ended: neither is read here.
    processes.start(["sh", "-c", "exit 3"], traced.folder, {"TRACED": traced.mark}, 1000, (0, 1, 2))
    assert select.select([processes.channel], [], [], 20.0)[0]
    processes.channel.close()
    assert processes._keeper.wait(20.0) == 0
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.slow
def test_an_interrupt_is_no_failure_of_the_episode(
    traced: Traced, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def interrupted(*_arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        simulate(traced.shell(WELL))
    assert not [line for line in caplog.messages if "is kept" in line]
    assert [path for path in (traced.folder / "work").rglob("*") if path.is_file()] == []
