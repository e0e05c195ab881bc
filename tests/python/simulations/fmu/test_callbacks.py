"""What an FMU of FMI 2.0 gets from the importer: memory, a logger, time for a step in the background."""

import io
import json
import subprocess
import sys
from pathlib import Path

import pytest

from swarmwright.cli import run
from swarmwright.simulations.command.fmu_definition import FmuOptions
from swarmwright.simulations.fmu.description import describe
from swarmwright.simulations.fmu.instances import FmuError, Instance, unpack
from swarmwright.simulations.fmu.program import Coupled, ExchangeInstance
from swarmwright.simulations.fmu.ssp import describe as described_system
from swarmwright.simulations.fmu.ssp import read_system
from tests.python.simulations.fmu.built import MEMORY, build

CALM, LATE, FAILING, SILENT = range(4)
"""Modes of memory.c."""

pytestmark = pytest.mark.slow  # compiles FMUs


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("memory"), "memory", MEMORY)


def total(instance: Instance, file: Path, mode: int = CALM) -> float:
    """Run an episode of eight steps with the input 2 and check the memory that the FMU got."""
    known = describe(file).variables
    instance.begin({"mode": mode, "input": 2.0}, 0.0, 1.0)
    for step in range(8):
        assert not instance.step(step * 0.125, 0.125)
    found, is_sound = instance.numbers([known["total"], known["sound"]])
    assert is_sound == 1.0
    return found


@pytest.mark.slow
@pytest.mark.parametrize("solver", [None, "CVode", "Euler"])
def test_memory_of_the_importer(file: Path, tmp_path: Path, solver: str | None) -> None:
    """Zeroed and checked for overflows, for co-simulation and model exchange.

    Each episode begins at 0, although fmi2Reset of this FMU does nothing.
    """
    known, folder = describe(file), unpack(str(file), tmp_path)
    instance = (
        Instance(known, folder, "one") if solver is None else ExchangeInstance(known, folder, "one", solver)
    )
    assert [total(instance, file) for _ in range(3)] == pytest.approx([2.0] * 3, abs=1e-9)
    instance.end()


def test_steps_in_the_background(file: Path, tmp_path: Path) -> None:
    """The step returns fmi2Pending; without stepFinished the FMU is asked for its status."""
    instance = Instance(describe(file), unpack(str(file), tmp_path), "one")
    assert total(instance, file, LATE) == 2.0
    instance.end()


@pytest.mark.parametrize("mode", [FAILING, SILENT])
def test_messages_are_those_of_their_instance(file: Path, tmp_path: Path, mode: int) -> None:
    """Also with a later instance, by componentEnvironment, or by name where an FMU does not pass it on."""
    known, folder = describe(file), unpack(str(file), tmp_path)
    logs = [io.StringIO(), io.StringIO()]
    first, second = (Instance(known, folder, name, log) for name, log in zip(("a", "b"), logs, strict=True))
    first.begin({"mode": mode, "input": 2.0}, 0.0, 1.0)
    second.begin({"input": 2.0}, 0.0, 1.0)
    with pytest.raises(FmuError, match=r"^the step from 0 s: total of a is 0\.25, that is 25% #$"):
        first.step(0.0, 0.125)
    second.step(0.0, 0.125)
    assert [log.getvalue() for log in logs] == ["total of a is 0.25, that is 25% #\n", ""]
    for instance in (first, second):
        instance.end()


def test_memory_in_a_coupled_system(file: Path, tmp_path: Path) -> None:
    """Two components that `swarmwright couple` has connected; the message is that of the one that fails."""
    words = ["couple", f"a={file}", f"b={file}", "--connect", "a.total:b.input"]
    assert run([*words, "--output", str(tmp_path / "both.ssp")]) == 0
    known = described_system(tmp_path / "both.ssp").variables
    system = Coupled(
        str(tmp_path / "both.ssp"), read_system(tmp_path / "both.ssp"), tmp_path / "work", "gauss_seidel"
    )
    names = ["a.total", "b.total", "a.sound", "b.sound"]
    for _ in range(2):
        system.begin({"a.input": 2.0}, 0.0, 1.0)
        for step in range(8):
            system.step(step * 0.125, 0.125)
        assert system.numbers([known[name] for name in names]) == [2.0, 1.125, 1.0, 1.0]
    system.begin({"a.mode": FAILING}, 0.0, 1.0)
    with pytest.raises(FmuError, match=r"^a: the step from 0 s: total of a is 0\.00, that is 0% #$"):
        system.step(0.0, 0.125)
    system.end()


@pytest.mark.slow
def test_the_process_of_fmus_that_it_can_have_once_ends_where_a_second_one_fails(tmp_path: Path) -> None:
    """Without an answer: the episode begins again in a new process."""
    once = MEMORY.replace('guid="memory"', 'guid="once"').replace('PerProcess="false"', 'PerProcess="true"')
    options = FmuOptions(fmu=str(build(tmp_path, "memory", once)), steps=1, metrics={"sound": "min(sound)"})
    (tmp_path / "fmu.json").write_text(json.dumps(options.attachment()))
    words = [sys.executable, "-m", "swarmwright.simulations.fmu", "fmu.json"]
    message = json.dumps({"reset": {"parameters": {}, "seed": 1}, "id": 1})
    ended = subprocess.run(
        words,
        check=False,
        cwd=tmp_path,
        input=f"{message}\n{message}\n",
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (ended.returncode, json.loads(ended.stdout)["id"]) == (0, 1)
    assert "there was one before" in ended.stderr
