"""Importing costs next to nothing, and the names are there."""

import subprocess
import sys
from types import ModuleType

import pytest

import swarmwright


@pytest.mark.slow
def test_importing_is_fast_and_lazy() -> None:
    # Processor time, because others may work beside the test.
    code = (
        "import sys, time; began = time.process_time(); import swarmwright; "
        "print(time.process_time() - began); "
        "print([name for name in ('numpy', 'pydantic', 'matplotlib') if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    seconds, heavy = result.stdout.splitlines()
    assert float(seconds) < 0.15
    assert heavy == "[]"


@pytest.mark.slow
def test_server_processes_of_built_in_simulations_start_without_large_libraries() -> None:
    """Each of them would take a tenth of a second of processor time and some megabytes more."""
    code = (
        "import sys, swarmwright.servers.evaluation.server_process; "
        "print({'numpy', 'pydantic', 'ruamel.yaml', 'matplotlib'} & set(sys.modules))"
    )
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stdout == "set()\n"


@pytest.mark.slow
def test_plotting_libraries_are_not_needed_to_optimize() -> None:
    uses = "swarmwright.optimize; swarmwright.Experiment"
    code = f"import sys, swarmwright; {uses}; assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", swarmwright.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(swarmwright, name) is not None
    assert name in dir(swarmwright)


@pytest.mark.slow
def test_modules_are_there_whatever_was_used_before() -> None:
    names = [name for name in swarmwright.__all__ if isinstance(getattr(swarmwright, name), ModuleType)]
    assert {"callbacks", "display", "methods", "modules", "rankings", "representations"} <= set(names)
    code = "import sys, swarmwright; assert hasattr(swarmwright, sys.argv[1])"
    for name in names:
        subprocess.run([sys.executable, "-c", code, name], check=True)


def test_other_names_are_not() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'optimise'"):
        _ = swarmwright.optimise


def test_errors_know_their_exit_status() -> None:
    assert swarmwright.InputError("x").exit_status == 2
    assert swarmwright.RunError("x").exit_status == 1
    assert issubclass(swarmwright.InputError, swarmwright.SwarmwrightError)
