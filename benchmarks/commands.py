"""Simulations that are commands: an episode beside the program's own time, and what a process costs."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measurement import Samples
from swarmwright import Experiment
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.opening import open_backend

PROGRAM = """
import json, sys, time

def work(milliseconds):
    # Of this process's own time, so that a busy machine costs both the same.
    end = time.process_time() + milliseconds / 1000
    while time.process_time() < end:
        pass

for line in sys.stdin:
    message = json.loads(line)
    if "reset" in message:
        left, agents = message["reset"]["parameters"]["steps"], [0.0] * 10
    else:
        left -= 1
        agents = [x + 0.1 * action[0] for x, action in zip(agents, message["actuators"])]
        work(1)
    if left:
        answer = {"sensors": [[x, 1.0, 0.0, -1.0] for x in agents]}
    else:
        answer = {"done": True, "fitness": -sum(map(abs, agents))}
    print(json.dumps(answer), flush=True)
"""
"""Ten robots, a millisecond a step."""
STEPS, EPISODES = 100, 20


class CommandSuite:
    """Episodes over stdin and stdout beside the program alone; processes with files beside bare ones."""

    def __init__(self, smaller: int) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._place = Path(self._folder.name)
        (self._place / "stepped.py").write_text(PROGRAM)
        self._episodes = max(1, EPISODES // smaller)
        self._bare = Samples("a program of 100 steps of 1 ms, alone", "s/episode")
        self._stepped = Samples(
            "the same as a simulation, over stdin and stdout", "s/episode", self._bare, "<= 1.2"
        )
        self._start = Samples("starting `true`", "s")
        self._files = Samples("an episode of a command with files", "s", self._start)

    def repeat(self) -> None:
        """Take one sample of everything."""
        self._bare.add(self._alone() / self._episodes)
        self._stepped.add(self._simulated() / self._episodes)
        began = time.perf_counter()
        for _ in range(self._episodes):
            subprocess.run(["true"], check=True)
        self._start.add((time.perf_counter() - began) / self._episodes)
        self._files.add(self._with_files() / self._episodes)

    def _alone(self) -> float:
        """Feed the program a conversation from a file; return seconds."""
        actuators = json.dumps({"actuators": [[0.12345678]] * 10})
        reset = json.dumps({"reset": {"parameters": {"steps": STEPS}, "seed": 0}})
        conversation = [reset, *[actuators] * STEPS]
        said = self._place / "said"
        said.write_text("\n".join(conversation * self._episodes) + "\n")
        began = time.perf_counter()
        with said.open() as stdin:
            subprocess.run(
                [sys.executable, "stepped.py"],
                stdin=stdin,
                stdout=subprocess.DEVNULL,
                cwd=self._place,
                check=True,
            )
        return time.perf_counter() - began

    def _simulated(self) -> float:
        definition = {
            "command": [sys.executable, "stepped.py"],
            "controller": "stepwise",
            "recycle": self._episodes,  # the program starts once, as alone
            "sensors": 4,
            "actuators": 1,
        }
        experiment = self._experiment(
            definition, {"kind": "layered", "hidden": [8]}, parameters={"steps": STEPS}
        )
        return self._timed(experiment, experiment.genome_size)

    def _with_files(self) -> float:
        definition = {"command": ["cp", "{here}/result.csv", "{log}"], "log": "log.csv"}
        (self._place / "result.csv").write_text("fitness\n1\n")
        speed = {"speed": {"type": "real", "range": [0, 1]}}
        return self._timed(self._experiment(definition, {"kind": "parameter_set", "parameters": speed}), 1)

    def _experiment(
        self, definition: dict[str, Any], controller: dict[str, Any], **values: Any
    ) -> Experiment:
        simulation = {**definition, "folder": str(self._place)}
        return Experiment.from_mapping({"simulation": simulation, "controller": controller, **values})

    def _timed(self, experiment: Experiment, genes: int) -> float:
        """Evaluate as many candidates as episodes; return seconds, without the set-up of the run."""
        representation = experiment.representation()
        genomes = np.full((self._episodes, genes), 0.5, np.float32)
        with open_backend(experiment, servers="in-process") as backend:
            backend.evaluate(Controllers.from_genomes(representation, genomes[:1]), [0], _silent)
            began = time.perf_counter()
            results = backend.evaluate(Controllers.from_genomes(representation, genomes), [0], _silent)
            seconds = time.perf_counter() - began
        assert np.isfinite(results.fitness).all()
        return seconds

    def samples(self) -> list[Samples]:
        """Everything measured."""
        return [self._bare, self._stepped, self._start, self._files]

    def close(self) -> None:
        """Delete the programs."""
        self._folder.cleanup()


def _silent(_done: int, _total: int, _waiting_for: str) -> None:
    """Show nothing."""
