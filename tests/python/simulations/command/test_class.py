"""The class that people derive from, with the functions of D6.1."""

import contextlib
import stat
import sys
from pathlib import Path
from typing import Any

import pytest

from swarmwright import (
    CommandSimulation,
    Experiment,
    InputError,
    SwarmwrightError,
    evaluate,
    optimize,
    repeat,
    simulate,
)
from tests.python.records import same_record
from tests.python.simulations.command.processes import WELL, Traced

CLASS = '''
from pathlib import Path
from swarmwright import CommandSimulation

HERE = Path(__file__).parent


class Rescue(CommandSimulation):
    """Logs in words, and a parameter file of its own."""

    title = "rescue"
    definition = {
        "command": ["sh", "rescue.sh"],
        "log": ["rescue.txt", "more.txt"],
        "environment": {"SPEED": "{speed}"},
        "work": "work",
        "keep": "none",
    }
    metrics = ["rescued"]
    parameters = {"speed": 1.0, "robots": 3}

    def note(self, name):
        with open(HERE / "calls", "a") as calls:
            calls.write(f"{name} ")

    def setEnvironment(self, environment):
        self.note("setEnvironment")
        super().setEnvironment({**environment, "ROBOTS": "{robots}"})

    def setParameters(self, parameters):
        self.note("setParameters")
        lines = [f"{name}={value}" for name, value in parameters.items()]
        (self.folder / "parameters.ini").write_text("\\n".join(lines))

    def run(self):
        self.note("run")
        super().run()

    def readLogs(self):
        self.note("readLogs")
        logs = self.getLogs()
        return {"rescued": logs["rescue.txt"].count("RESCUED"), "fitness": float(logs["more.txt"])}
'''
SCRIPT = """
grep -q "^seed=$((10 - 3))$" parameters.ini
for robot in $(seq $ROBOTS); do echo "robot $robot RESCUED someone" >> rescue.txt; done
echo "$SPEED" > more.txt
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "rescue.py").write_text(CLASS)
    (tmp_path / "rescue.sh").write_text(SCRIPT)
    return tmp_path


def experiment(folder: Path, **values: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": f"{folder}/rescue.py:Rescue",
            "controller": {
                "kind": "parameter_set",
                "parameters": {"speed": {"type": "real", "range": [0, 2]}},
            },
            "method": {"population": 3, "generations": 1},
            "parameters": {"robots": 4, "seed": 7},
            **values,
        }
    )


@pytest.mark.slow
def test_its_functions_are_called_in_their_order(folder: Path) -> None:
    one = experiment(folder, fitness="fitness + 10 * rescued")
    assert evaluate(one, [[0.25]], servers="in-process").tolist() == [40.5]
    assert (folder / "calls").read_text() == "setEnvironment setParameters run readLogs "
    assert not list((folder / "work").rglob("rescue.txt"))


@pytest.mark.journey
def test_runs_of_it(folder: Path, tmp_path: Path) -> None:
    runs = [optimize(experiment(folder), out=tmp_path / str(one), servers=one) for one in ("in-process", 2)]
    same_record(*runs)
    assert repeat(runs[0]).same


def test_its_definition_is_checked() -> None:
    class Wrong(CommandSimulation):
        definition = {"command": "x", "log": "a.csv", "tmeout": 5}  # noqa: RUF012 - as users write it

    with pytest.raises(InputError, match=r"Wrong\.definition: tmeout: unknown key; did you mean 'timeout'"):
        Wrong()
    with pytest.raises(InputError, match=r"Empty\.definition: command: is missing"):
        type("Empty", (CommandSimulation,), {})()


INSTANCES = """
import os, sys, time
with open(sys.argv[1], "a") as seen:
    print(*sys.argv[2:], os.environ["ROS_MASTER_URI"], file=seen)
time.sleep(0.3)
open("log.csv", "w").write("fitness\\n1\\n")
"""


@pytest.mark.slow
def test_instances_side_by_side_share_nothing(traced: Traced) -> None:
    (traced.folder / "sim.py").write_text(INSTANCES)
    one = traced.experiment(
        [sys.executable, "sim.py", f"{traced.folder}/seen", "{instance}", "{port}", "{folder}"],
        environment={"ROS_MASTER_URI": "http://localhost:{port}"},
    )
    evaluate(one, [[0.25], [0.5], [0.75], [1.0]], servers=2)
    rows = [line.split() for line in (traced.folder / "seen").read_text().splitlines()]
    assert len(rows) == 4
    by_instance = {number: {row[2] for row in rows if row[0] == number} for number, *_ in rows}
    assert len(by_instance) == 2
    assert all(len(folders) == 1 for folders in by_instance.values())
    assert len({row[2] for row in rows}) == 2
    ports = {number: {row[1] for row in rows if row[0] == number} for number in by_instance}
    first, second = ports.values()
    assert not first & second
    assert all(uri == f"http://localhost:{port}" for _, port, _, uri in rows)
    assert simulate(one) == 1


@pytest.mark.slow
@pytest.mark.parametrize("level", ["folder", "instance"])
def test_a_program_that_replaces_its_folder_by_a_link_changes_nothing_there(
    traced: Traced, tmp_path: Path, level: str
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "log.csv").write_text("fitness\n1.5\n")
    elsewhere.chmod(0o555)
    replaced = "$PWD" if level == "folder" else "$(dirname $PWD)"
    script = f"folder={replaced}; cd /; rm -rf $folder; ln -s {elsewhere} $folder"
    experiment = traced.shell(script, work="work")
    with contextlib.suppress(SwarmwrightError):  # whether it finds a log there matters to nobody
        simulate(experiment)
    assert stat.S_IMODE(elsewhere.stat().st_mode) == 0o555
    assert (elsewhere / "log.csv").exists()
    assert simulate(traced.shell(WELL, work="work")) == simulate(traced.shell(WELL))
