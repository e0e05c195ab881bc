"""Processes that are started have the same hash seed, so that sets have the same order in all of them."""

import os
import subprocess
import sys

import pytest

from swarmwright.common import processes


@pytest.mark.parametrize(
    ("given", "expected"), [({}, "0"), ({"PYTHONHASHSEED": "random"}, "0"), ({"PYTHONHASHSEED": "5"}, "5")]
)
def test_started_processes_have_the_seed_of_the_environment_or_a_fixed_one(
    given: dict[str, str], expected: str
) -> None:
    assert processes.child_hash_seed(given) == expected
    assert processes.hash_seed_variables(given) == {"PYTHONHASHSEED": expected}


@pytest.mark.slow
@pytest.mark.parametrize("given", ["0", "5", "random", None])
def test_the_seed_of_a_process_is_known(given: str | None) -> None:
    environment = {name: value for name, value in os.environ.items() if name != processes.VARIABLE}
    if given is not None:
        environment[processes.VARIABLE] = given
    code = "from swarmwright.common import processes; print(processes.current_hash_seed())"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == (given or processes.RANDOM)
