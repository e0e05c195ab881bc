import json
import os
import pty
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Run, _engine
from tests.conformance.sound import SoundServer
from tests.python.cli.processes import children, gone

pytestmark = pytest.mark.slow

QUICK = """\
simulation: minisim
method: {kind: nnga, population: 12, generations: 4}
seed: 3
"""
TOY = """\
from swarmwright import Simulation
from swarmwright.display import Body, Scene


class Toy(Simulation):
    sensors, actuators = 2, 1

    def reset(self, parameters, seed):
        self.steps = 0
        return [[0.0, 0.0]]

    def step(self, actions):
        self.steps += 1
        return [[0.0, 0.0]]

    def done(self):
        return self.steps == 3

    def fitness(self):
        return 1.0

    def scene(self):
        return Scene(2, 2, step=self.steps, message="toy", bodies=[Body("agent", 1.0, 1.0, "free")])
"""
ENDLESS = """\
simulation: minisim
method: {kind: nnga, population: 30, generations: 1000000}
servers: local
"""


@pytest.fixture
def quick(tmp_path: Path) -> Path:
    path = tmp_path / "quick.yaml"
    path.write_text(QUICK)
    return path


@pytest.mark.usefixtures("plots")
def test_plain_lines_tell_how_far_it_is_and_what_to_do_next(program: Any, quick: Path) -> None:
    result = program("optimize", quick, "--servers", "2", "--out", "result")
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    told = [line.split("  ")[0] for line in lines if " of 4 generations  best " in line]
    assert (told[0], told[-1]) == ("1 of 4 generations", "4 of 4 generations")
    assert "\x1b" not in result.stdout
    assert "swarmwright replay result" in result.stdout
    for name in ("best.json", "fitness.png", "run.sqlite", "experiment.yaml"):
        assert name in result.stdout
        assert (quick.parent / "result" / name).stat().st_size > 0
    replayed = program("replay", "result")
    assert replayed.returncode == 0


def test_a_simulation_of_a_server_elsewhere_is_shown_from_the_broker_of_the_run(
    program: Any, tmp_path: Path
) -> None:
    (tmp_path / "toy.yaml").write_text(
        "simulation: toy\nrequirements: {dimensions: 1}\nmethod: {population: 3, generations: 1}\n"
        "controller: {kind: layered, hidden: []}\nvalidate: false\n"
    )
    broker = _engine.Broker()
    server = SoundServer(broker.url)
    try:
        result = program("optimize", "toy.yaml", "--broker", broker.url, "--out", "result")
        assert result.returncode == 0, result.stderr
        hint, instead = (line for line in result.stdout.splitlines() if "replay" in line)
        words = hint.rpartition("swarmwright ")[2].split()
        assert words == ["replay", "result", "--broker", broker.url]
        shown = program(*words, "--save", "best.html")
        assert shown.returncode == 0, shown.stderr
        words = instead.rpartition("swarmwright ")[2].split()
        assert words == ["replay", "result", "--simulation", "NAME"]
    finally:
        server.close()
        broker.stop()
    # Without the broker, in a simulation that is here.
    (tmp_path / "toy.py").write_text(TOY)
    shown = program("replay", "result", "--simulation", "toy.py:Toy", "--save", "here.html")
    assert shown.returncode == 0, shown.stderr


def test_a_plot_that_is_not_wanted_is_not_listed(program: Any, quick: Path) -> None:
    result = program("optimize", quick, "--servers", "local", "--out", "result")
    assert "run.sqlite" in result.stdout
    assert "fitness.png" not in result.stdout
    assert not (quick.parent / "result" / "fitness.png").exists()


def test_the_last_json_line_sums_up(program: Any, quick: Path) -> None:
    result = program("optimize", quick, "--servers", "local", "--json", "--out", "result")
    assert result.returncode == 0, result.stderr
    *generations, last = [json.loads(line) for line in result.stdout.splitlines()]
    assert [g["generation"] for g in generations] == [0, 1, 2, 3]
    assert set(last) == {"best", "evaluations", "generations", "seconds", "run"}
    assert set(last["best"]) == {"fitness", "candidate", "generation"}
    assert last["best"]["fitness"] == generations[-1]["best_so_far"]
    assert last["evaluations"] == generations[-1]["evaluations"]
    assert last["generations"] == 4
    exported = program("runs", "export", last["run"], "table.csv", "--json")
    assert json.loads(exported.stdout)["file"] == "table.csv"
    assert len((quick.parent / "table.csv").read_text().splitlines()) == 1 + last["evaluations"]


def test_the_seed_option_counts(program: Any, quick: Path) -> None:
    records = []
    for folder, seed in (("a", "7"), ("b", "7"), ("c", "8")):
        assert (
            program("optimize", quick, "--servers", "local", "--seed", seed, "--out", folder).returncode == 0
        )
        records.append(Run.open(quick.parent / folder).digest)
    assert records[0] == records[1] != records[2]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_runs_keep_their_results(start: Any, program: Any, tmp_path: Path, number: int) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS.replace("servers: local", "servers: 2"))
    process = start("optimize", "endless.yaml", "--json", "--out", "result")
    for _ in range(3):
        assert json.loads(process.stdout.readline())["best_so_far"] <= 0
    servers = children(process.pid)
    assert len(servers) >= 2
    process.send_signal(number)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in err
    last = json.loads(out.splitlines()[-1])
    assert last["generations"] >= 3
    assert gone(servers)
    assert program("replay", "result").returncode == 0


def test_a_killed_run_leaves_no_server_behind(start: Any, program: Any, tmp_path: Path) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS.replace("servers: local", "servers: 2"))
    process = start("optimize", "endless.yaml", "--json", "--out", "result")
    process.stdout.readline()
    process.stdout.readline()
    servers = children(process.pid)
    process.kill()
    process.wait(10)
    assert gone(servers)
    assert program("replay", "result").returncode == 0, "finished generations are there"


def test_a_reader_that_leaves_ends_the_run_with_its_results_kept(tmp_path: Path) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS)
    script = f"set -o pipefail; {sys.executable} -m swarmwright optimize endless.yaml --out result | head -1"
    result = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=40, check=False
    )
    first, second = result.stderr.splitlines()
    assert first.startswith("swarmwright: standard output was closed by its reader, so the run ended early;")
    assert second.endswith("resume result")
    assert len(result.stdout.splitlines()) == 1
    assert result.returncode == 130
    assert (tmp_path / "result" / "best.json").exists()
    run = Run.open(tmp_path / "result")
    assert (run.state, run._store.validation()) == ("interrupted", None)


@pytest.mark.parametrize("option", [[], ["--json"]])
def test_output_that_cannot_be_written_ends_the_run_with_its_results_kept(
    tmp_path: Path, option: list[str]
) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS)
    command = [sys.executable, "-m", "swarmwright", "optimize", "endless.yaml", "--out", "result", *option]
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, timeout=40, check=False
        )
    assert result.returncode == 1
    assert "standard output cannot be written: No space left on device, so the run ended" in result.stderr
    assert "resume result" in result.stderr
    assert Run.open(tmp_path / "result").generations > 0


def on_terminal(arguments: list[str], folder: Path, *, columns: int, **variables: str) -> str:
    """What the program shows on a terminal of so many columns."""
    master, slave = pty.openpty()
    environment = {
        **os.environ,
        "TERM": "xterm-256color",
        "COLUMNS": str(columns),
        "LINES": "24",
        **variables,
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "swarmwright", *arguments],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        cwd=folder,
        env=environment,
        start_new_session=True,
    )
    os.close(slave)
    shown = b""
    try:
        while chunk := os.read(master, 65536):
            shown += chunk
    except OSError:
        pass  # the program has ended and with it the terminal
    finally:
        os.close(master)
        process.wait(20)
    assert process.returncode == 0, shown.decode(errors="replace")
    return shown.decode("utf-8")


@pytest.mark.parametrize("columns", [20, 40, 80, 200])
def test_a_terminal_shows_a_bar_that_fits(quick: Path, columns: int) -> None:
    shown = on_terminal(
        ["optimize", quick.name, "--servers", "local", "--out", "result"], quick.parent, columns=columns
    )
    assert "\x1b[" in shown
    assert ("4 of 4 generations" if columns >= 50 else "4/4") in shown
    assert "best" in shown
    assert "Traceback" not in shown


def test_no_color_and_no_utf8_are_respected(quick: Path) -> None:
    shown = on_terminal(
        ["optimize", quick.name, "--servers", "local", "--out", "result"],
        quick.parent,
        columns=80,
        NO_COLOR="1",
        PYTHONIOENCODING="ascii",
    )
    assert shown.isascii()
    # Moving the cursor is needed to draw in place; colours (CSI 3x m) are not.
    assert "\x1b[32m" not in shown
    assert "\x1b[1;32m" not in shown


@pytest.mark.parametrize(
    ("text", "answers"),
    [
        ("simulation: minisym\n", ["minisym", "minisim"]),
        ("simulation: minisim\nmethod: {kind: nnag}\n", ["bad.yaml:2", "nnga"]),
        ("simulation: minisim\nparameters: {mapWitdh: 3}\n", ["bad.yaml:2", "mapWidth"]),
        ("simulation: minisim\nparameters: {mapWidth: wide}\n", ["bad.yaml:2", "mapWidth"]),
        ("simulation: [minisim\n", ["bad.yaml:"]),
        ("", ["bad.yaml", "simulation"]),
    ],
)
def test_wrong_experiments_are_answered_with_file_and_line(
    program: Any, tmp_path: Path, text: str, answers: list[str]
) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    result = program("optimize", "bad.yaml")
    assert result.returncode == 2
    for answer in answers:
        assert answer in result.stderr


def test_no_broker_there(program: Any, quick: Path, unused_port: int) -> None:
    result = program("optimize", quick, "--broker", f"mqtt://127.0.0.1:{unused_port}")
    assert result.returncode == 1
    assert str(unused_port) in result.stderr


def test_a_run_in_the_background_of_a_script_can_be_interrupted(tmp_path: Path) -> None:
    (tmp_path / "endless.yaml").write_text(ENDLESS)
    script = f"""
        {sys.executable} -m swarmwright optimize endless.yaml --out result > shown & run=$!
        trap 'kill -KILL $run 2> /dev/null' EXIT
        until grep -q generation shown; do kill -0 $run || exit 1; sleep 0.05; done
        kill -INT $run
        wait $run
    """
    result = subprocess.run(
        ["timeout", "50", "bash", "-c", script], cwd=tmp_path, stderr=subprocess.PIPE, timeout=55, check=False
    )
    assert result.returncode == 130
    assert b"Traceback" not in result.stderr
