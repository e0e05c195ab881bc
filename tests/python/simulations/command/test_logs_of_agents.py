"""Logs that agents write without names of columns."""

import sys
from pathlib import Path

import pytest

from swarmwright import Experiment, evaluate
from swarmwright.simulations.command import logs
from swarmwright.simulations.command.process import CommandFailure

PROGRAM = """
import sys

gain, folder = float(sys.argv[1]), sys.argv[2]
for agent in range(3):
    with open(f"{folder}/agent_{agent}.log", "w") as log:
        log.write("# step, distance\\n")
        for step in range(agent + 2):
            log.write(f"{step}\\t{gain * (agent + step)}\\n")
"""


def read(*texts: str) -> logs.Columns:
    return logs.read({f"{i}.log": text.encode() for i, text in enumerate(texts)}, "agents", ["steps", "last"])


def test_each_file_is_a_row() -> None:
    found = read("# t\td\n1\t0.5\n3\t2.5\n2\t9\n", "7\t-1e3\n\n7\t4\n")
    assert found == {"steps": [3.0, 1.0], "last": [2.5, 4.0]}


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("1 2\n", "0.log:1: '1 2' found, expected a whole number, a tab and a number"),
        ("1\t2\t3\n", "expected a whole number, a tab and a number"),
        ("#\n1.5\t2\n", "0.log:2: '1.5.t2' found"),
        ("1\tfar\n", "value is 'far', expected a number"),
        ("", "has no column 'last'; available: steps"),
    ],
)
def test_what_is_wrong_is_named(text: str, answer: str) -> None:
    with pytest.raises(CommandFailure, match=answer):
        read(text)


@pytest.mark.slow
def test_fitness_over_the_logs_of_agents(tmp_path: Path) -> None:
    (tmp_path / "swarm.py").write_text(PROGRAM)
    (tmp_path / "x.yaml").write_text(
        f"""
simulation:
  command: [{sys.executable}, swarm.py, "{{gain}}", "{{folder}}"]
  log: "agent_*.log"
  log_format: agents
  metrics: {{time: mean(steps), distance: mean(last)}}
fitness: "-distance - 0.1 * time"
controller: {{kind: parameter_set, parameters: {{gain: {{type: real, range: [0, 2]}}}}}}
"""
    )
    experiment = Experiment.load(tmp_path / "x.yaml")
    (fitness,) = evaluate(experiment, [[0.5]], servers="local")
    assert fitness == pytest.approx(-(1 + 3 + 5) / 3 - 0.1 * 3)
