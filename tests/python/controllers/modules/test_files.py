"""Behaviours and conditions that are named by their files, from the experiment to the export."""

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from swarmwright import Controller, Experiment, InputError, Run, RunError, optimize, resume, simulate
from swarmwright.cli._commands import program
from swarmwright.cli._main import run as run_program
from swarmwright.controllers.modules import registered
from swarmwright.controllers.modules.grammar import states_of
from swarmwright.experiment.derived import has_python_modules
from swarmwright.export.exporting import export_controller
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.repeat import repeat
from swarmwright.runs.replay import Replay
from swarmwright.servers.evaluation.module_code import is_in_python
from swarmwright.simulations.user_code import trust
from swarmwright.testing import check_behaviour, check_condition
from tests.python.controllers.modules.conftest import SPEED, forget, written

TEXT = """simulation: arena
parameters: {mission: aac, robot: e-puck-rm1.2, robots: 4, duration: 6}
controller:
  kind: modules
  behaviours: [parts/own.py:Wander, exploration]
  conditions: [parts/own.py:Timer, black_floor]
  states: 2
method: {kind: nnga, population: 6, generations: 2}
seed: 4
"""

pytestmark = pytest.mark.usefixtures("place")


@pytest.fixture(autouse=True)
def other_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(trust, "_granted", set())


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return an experiment, with two modules and what they import in the folder parts."""
    written(tmp_path / "parts")
    experiment = tmp_path / "wander.yaml"
    experiment.write_text(TEXT)
    return experiment


def test_verification_imports_nothing(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = optimize(Experiment.load(file), out=tmp_path / "run")
    values = json.loads((run.path / "best.json").read_text())
    values["controller"]["weights"][0] += 1
    (run.path / "best.json").write_text(json.dumps(values))
    forget()
    assert run_program(["runs", "verify", "run", "--json"]) == 0
    (said,) = json.loads(capsys.readouterr().out)["not_compared"]
    assert said.startswith("best.json: its weights, which only code of the run can decode from the genome")
    assert not registered._in_files
    values["genome"][0] += 1
    (run.path / "best.json").write_text(json.dumps(values))
    assert run_program(["runs", "verify", "run"]) == 1
    assert "its genome is not that of" in capsys.readouterr().out


@pytest.mark.slow
def test_a_run_has_the_code_with_it(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = Experiment.load(file)
    assert has_python_modules(experiment)
    run = optimize(experiment, out=tmp_path / "run")
    for part in ("behaviour-Wander", "condition-Timer"):
        assert (run.path / "code/1" / part / "own.py").read_text() == (
            file.parent / "parts/own.py"
        ).read_text()
        assert (run.path / "code/1" / part / "wheel_speeds.py").read_text() == SPEED
    text = (run.path / "experiment.yaml").read_text()
    assert "code/1/behaviour-Wander/own.py:Wander" in text
    best = run.best
    assert str(tmp_path) not in json.dumps(best.specification)
    used = {state.behaviour for state in states_of(best.specification)}
    assert used <= {"Wander", "exploration"}
    other = tmp_path / "elsewhere"
    other.mkdir()
    monkeypatch.chdir(other)
    assert optimize(Experiment.load(file), out=tmp_path / "again").digest == run.digest
    assert (tmp_path / "again/best.json").read_bytes() == (run.path / "best.json").read_bytes()
    fitness = simulate(experiment, best.controller, seed=3)

    # In another place, without the files, by another process of the same user.
    shutil.rmtree(file.parent / "parts")
    moved = Path(shutil.move(run.path, other / "moved"))
    forget()
    opened = Run.open(moved)
    assert opened.best.specification == best.specification
    assert simulate(opened.experiment, opened.best.controller, seed=3) == fitness
    forget()
    assert simulate(Run.open(moved).experiment, Controller.load(moved / "best.json"), seed=3) == fitness
    assert repeat(opened, generation=0, candidate=0).same
    episode = Replay.of(opened).engine_episode()
    while not episode.done:
        episode.step()
    longer = resume(moved, settings=["method.generations=3"])
    assert longer.generations == 3
    exported = export_controller(longer, to="machine", output=tmp_path / "machine", verify=True)
    assert exported.verification is not None
    assert exported.verification.ok
    names_ = set((tmp_path / "machine/controller.yaml").read_text().split())
    assert names_ & {"Wander", "exploration"}


def test_code_of_another_user_is_not_executed(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = optimize(Experiment.load(file), out=tmp_path / "run")
    ran = tmp_path / "ran"
    bad = (file.parent / "parts/own.py").read_text() + f"\nopen({str(ran)!r}, 'w').close()\n"
    (file.parent / "parts/own.py").write_text(bad)
    forget()
    again = optimize(Experiment.load(file), out=tmp_path / "again")
    assert ran.exists()
    ran.unlink()
    forget()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "nobody"))
    monkeypatch.setattr(trust, "_granted", set())
    opened = Run.open(again.path)
    assert opened.generations == 2
    for read in (
        lambda: opened.best,
        lambda: resume(again.path, settings=["method.generations=3"]),
        lambda: Controller.load(again.path),
        lambda: export_controller(again.path, to="machine", output=tmp_path / "machine"),
    ):
        with pytest.raises(InputError, match="is code named by a run folder"):
            read()
    assert not ran.exists()
    # Nor is a file that a run names instead of its copy.
    shutil.rmtree(run.path / "code")
    shutil.copy(file.parent / "parts/own.py", run.path / "own.py")
    with pytest.raises(InputError, match="is code named by a run folder"):
        _ = Run.open(run.path).best
    assert not ran.exists()
    assert Run.open(again.path, trust=True).best.fitness == again.best.fitness
    assert ran.exists()


def test_edits_are_noticed(file: Path, tmp_path: Path) -> None:
    run = optimize(Experiment.load(file), out=tmp_path / "run")
    speeds = file.parent / "parts/wheel_speeds.py"
    speeds.write_text("SPEED = -0.25\n")
    forget()
    with pytest.raises(InputError, match=r"behaviour-Wander own\.py:Wander has changed since .*wheel_speeds"):
        resume(run.path, settings=["method.generations=3"])
    assert repeat(Run.open(run.path), generation=0, candidate=1).same  # with the copy
    longer = resume(run.path, settings=["method.generations=3"], accept_changed_code=True)
    assert longer.generations == 3
    assert (run.path / "code/2/behaviour-Wander/wheel_speeds.py").read_text() == "SPEED = -0.25\n"
    assert (run.path / "code/1/behaviour-Wander/wheel_speeds.py").read_text() == SPEED
    forget()
    opened = Run.open(run.path)
    for generation, speed in ((0, SPEED), (2, "SPEED = -0.25\n")):
        used = vars(resolve_experiment(opened, generation).controller)["behaviours"][0]
        assert Path(used.rpartition(":")[0]).with_name("wheel_speeds.py").read_text() == speed
        assert repeat(opened, generation=generation, candidate=0).same
    first, last = (repeat_code(opened, generation) for generation in (0, 2))
    assert first != last


def repeat_code(run: Run, generation: int) -> str:
    """Return the SHA-256 of a behaviour with which a candidate of a generation is shown."""
    chosen = Replay.of(run, generation=generation, candidate=0).controller.specification
    return str(chosen["behaviours"][0]["sha256"])


def test_other_ranges_are_another_run(file: Path, tmp_path: Path) -> None:
    run = optimize(Experiment.load(file), out=tmp_path / "run")
    own = file.parent / "parts/own.py"
    own.write_text(own.read_text().replace("Parameter(1, 20", "Parameter(1, 30"))
    forget()
    with pytest.raises(
        InputError, match="its genomes would encode different state machines; start a new run"
    ):
        resume(run.path, settings=["method.generations=3"], accept_changed_code=True)
    assert Run.open(run.path).generations == 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("own.py:Wander", "own.py:Wandr", "own.py: has no class 'Wandr'; did you mean 'Wander'?"),
        (
            "own.py:Wander",
            "own.py:Timer",
            "own.py: Timer is not a subclass of swarmwright.controllers.modules.Behaviour",
        ),
        ("own.py:Wander", "owns.py:Wander", "owns.py: there is no such file"),
        ("exploration]", "own.py:stop]", "the engine has a module of this name; rename the class"),
        ("exploration]", "other.py:Wander]", "'Wander' occurs twice"),
    ],
)
def test_mistakes_have_file_and_line(file: Path, old: str, new: str, message: str) -> None:
    file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        Experiment.load(file)
    assert message in str(caught.value)
    assert "wander.yaml:5: controller.behaviours: " in str(caught.value)


def test_a_file_that_cannot_be_imported(file: Path) -> None:
    own = file.parent / "parts/own.py"
    own.write_text(f"import nothing_like_it\n{own.read_text()}")
    with pytest.raises(InputError, match=r"own\.py:1: ModuleNotFoundError while it is imported"):
        Experiment.load(file)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (
            "    def __init__(self, gain):\n        pass\n",
            r"own\.py.*: Wander: __init__: TypeError: .*'gain'",
        ),
        ("    def __init__(self):\n        1 / 0\n", r"own\.py:\d+: Wander: __init__: ZeroDivisionError"),
    ],
)
def test_a_module_that_cannot_be_made(file: Path, tmp_path: Path, code: str, message: str) -> None:
    own = file.parent / "parts/own.py"
    text = own.read_text()
    begin = text.index("    def act(")
    own.write_text(text[:begin] + code + text[begin:])
    with pytest.raises(InputError, match=message):
        optimize(Experiment.load(file), out=tmp_path / "run")


def test_a_module_that_exits(file: Path, tmp_path: Path) -> None:
    own = file.parent / "parts/own.py"
    text = own.read_text()
    begin = text.index("    def act(")
    end = text.index(":\n", begin) + 2
    own.write_text(f"{text[:end]}        raise SystemExit(0)\n{text[end:]}")
    with pytest.raises(RunError, match=r"own\.py:\d+: Wander: act: SystemExit: 0"):
        optimize(Experiment.load(file), out=tmp_path / "run")
    own.write_text(f"import sys\nsys.exit(3)\n{text}")
    with pytest.raises(InputError, match=r"own\.py:2: SystemExit while it is imported: 3"):
        Experiment.load(file)


def test_a_controller_does_not_take_other_code(file: Path, tmp_path: Path) -> None:
    run = optimize(Experiment.load(file), out=tmp_path / "run")
    saved = file.parent / "parts/controller.json"
    run.best.controller.save(saved)
    forget()
    with pytest.raises(
        InputError, match=r"own\.py \(SHA-256 .*\), has not been imported; load the controller"
    ):
        Controller(json.loads(saved.read_text()))
    assert is_in_python(Controller.load(saved).specification)  # its code lies beside it
    forget()
    (file.parent / "parts/wheel_speeds.py").write_text("SPEED = -0.3\n")
    with pytest.raises(InputError, match="has not been imported"):
        Controller.load(saved)


def test_the_program_and_the_checks_take_files(file: Path, tmp_path: Path) -> None:
    check_behaviour("parts/own.py:Wander")
    check_condition(str(tmp_path / "parts/own.py:Timer"))
    runner = CliRunner()
    for arguments in (
        ["optimize", str(file), "--out", "run", "--set", "controller.conditions=[parts/own.py:Timer]"],
        ["runs", "verify", "run"],
        ["runs", "show", "run"],
        ["replay", "run", "--save", "run.html"],
        ["evaluate", "run", "--episodes", "2"],
    ):
        result = runner.invoke(program, arguments)
        assert result.exit_code == 0, (arguments, result.output)
