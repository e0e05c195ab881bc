"""Commands that come with somebody else's run folder are run when they are trusted, and not before."""

import shutil
from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, Run, optimize, repeat, simulate
from swarmwright.simulations.user_code import trust
from tests.python.records import change, seal
from tests.python.simulations.command.processes import WELL, Traced

pytestmark = pytest.mark.slow


@pytest.fixture
def received(traced: Traced, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run folder that another user has made, whose command marks that it was run."""
    run = optimize(traced.shell(f"touch {tmp_path}/executed; {WELL}"), out=tmp_path / "run")
    (tmp_path / "executed").unlink()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(trust, "_granted", set())
    return run.path


def again(folder: Path) -> bool:
    return repeat(Run.open(folder)).same


@pytest.mark.parametrize("without_copy", [False, True])
def test_it_is_not_run_before_it_is_trusted(received: Path, tmp_path: Path, without_copy: bool) -> None:
    if without_copy:  # the command names no file, so that none is missing
        shutil.rmtree(received / "code")
        (received / "code" / "1" / "simulation").mkdir(parents=True)
    with pytest.raises(InputError, match="is code named by a run folder"):
        again(received)
    assert Run.open(received).evaluations, "reading executes nothing"
    assert not (tmp_path / "executed").exists()
    Run.open(received, trust=True)
    assert again(received)
    assert (tmp_path / "executed").exists()


def test_another_command_beside_a_trusted_copy_is_not_trusted(received: Path, tmp_path: Path) -> None:
    Run.open(received, trust=True)
    file = received / "experiment.yaml"
    file.write_text(file.read_text().replace(f"touch {tmp_path}/executed", f"touch {tmp_path}/evil"))
    with pytest.raises(InputError, match="is code named by a run folder"):
        simulate(Experiment.load(file))
    change(
        received,
        "UPDATE fact SET value = replace(value, '/executed', '/evil') WHERE value LIKE '%/executed%'",
    )
    seal(received)
    with pytest.raises(InputError, match="is code named by a run folder"):
        again(received)
    assert not (tmp_path / "evil").exists()


def test_a_run_of_a_file_named_by_its_whole_path_is_trusted_by_who_made_it(tmp_path: Path) -> None:
    """Also where the file lies in a folder beside that of the experiment."""
    for name in ("models", "project"):
        (tmp_path / name).mkdir()
    program = tmp_path / "models" / "simulation.sh"
    program.write_text(WELL)
    run = optimize(Traced(tmp_path / "project").experiment(["sh", str(program)]), out=tmp_path / "run")
    assert (run.path / "code/1/simulation" / str(program).lstrip("/")).is_file()
    assert again(run.path)
