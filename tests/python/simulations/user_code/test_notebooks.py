"""Classes of a notebook: their code is known by fingerprints."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

SESSION = """
import numpy as np
import swarmwright
from swarmwright import Experiment, InputError, Run, Simulation, optimize, post_evaluate, resume
from swarmwright.simulations.user_code.changes import fingerprint

def define(value, helper="return 1.0"):
    exec(f'''
LIMIT = {value!r}
seen = []
steps = 0
def helped():
    {helper}
class Mine(Simulation):
    sensors = actuators = 1
    def reset(self, parameters, seed):
        self.steps = 0
        seen.append(seed)
        return np.ones((1, 1))
    def step(self, actions):
        self.steps += 1
        self.at = float(actions[0, 0])
        return np.ones((1, 1))
    def done(self):
        return self.steps == 2
    def fitness(self):
        return self.at * LIMIT * helped()
''', globals())

def values(**more):
    method = {"kind": "random_search", "population": 6, "generations": 2}
    controller = {"hidden": []}
    return {"simulation": Mine, "controller": controller, "method": method, "servers": "in-process", **more}
"""

CASES = """
define(1.0)
first = fingerprint("__main__:Mine")
run = optimize(Experiment.from_mapping(values()), out="run")
steps = 99  # an attribute is called so, too
assert fingerprint("__main__:Mine") == first
assert len(seen) > 5
define(1.0)  # the same cell again
assert fingerprint("__main__:Mine") == first
run = resume("run", generations=3)
digest = run.digest
for change in (lambda: define(2.0), lambda: define(1.0, "return 3.0")):
    change()
    try:
        resume("run", generations=4)
    except InputError as error:
        assert "the class Mine was redefined since the run" in str(error), error
    else:
        raise AssertionError
assert Run.open("run").digest == digest
run = resume("run", generations=4, accept_changed_code=True)
assert run.generations == 4
assert any("the class Mine was redefined" in event.text for event in run.events())
run = resume("run", generations=5)
print("fine")
"""


def session(code: str, folder: Path) -> str:
    """Run code as an interactive session does, which has no file."""
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False, timeout=100
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_a_class_that_was_redefined_is_noticed(tmp_path: Path) -> None:
    assert session(SESSION + CASES, tmp_path).endswith("fine\n")
    # In another process, where it is the same and where it is another one.
    other = SESSION + "define(1.0, 'return 3.0')\nprint(resume('run', generations=6).generations)"
    assert session(other, tmp_path) == "6\n"
    changed = (
        SESSION + "define(4.0)\ntry:\n    resume('run', generations=7)\nexcept InputError as e:\n    print(e)"
    )
    assert "was redefined" in session(changed, tmp_path)


def test_evaluations_with_another_class_are_warned_of(tmp_path: Path) -> None:
    code = """
define(1.0)
run = optimize(Experiment.from_mapping(values()), out="run")
import logging
logging.basicConfig(format="%(message)s", stream=__import__("sys").stdout)
post_evaluate(run, episodes=2)
define(2.0)
post_evaluate(Run.open("run"), episodes=2)
"""
    said = session(SESSION + code, tmp_path)
    assert said.count("the class Mine was redefined since the run; using the present class") == 1
