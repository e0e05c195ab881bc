"""Forked processes: a child of one that has used the engine's threads is told so, and does not wait."""

import subprocess
import sys

import pytest

SCRIPT = """
import multiprocessing, warnings
import numpy as np
import swarmwright

warnings.simplefilter("ignore", DeprecationWarning)  # since Python 3.12, of forks beside threads
EXPERIMENT = swarmwright.Experiment.from_mapping({"simulation": "minisim", "servers": "local"})

def evaluated(_):
    genomes = np.zeros((3, EXPERIMENT.representation().genome_size), dtype=np.float32)
    try:
        return swarmwright.evaluate(EXPERIMENT, genomes).tolist()
    except swarmwright.RunError as error:
        return str(error)

def in_a_child():
    with multiprocessing.get_context("fork").Pool(1) as pool:
        return pool.map_async(evaluated, [0]).get(timeout=30)[0]

child = in_a_child()
assert child == evaluated(0), child
print(in_a_child())
"""


@pytest.mark.slow
def test_a_child_of_a_process_that_used_the_engine_is_told() -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=55, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "was forked from process" in done.stdout
    assert "spawn" in done.stdout
