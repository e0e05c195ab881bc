"""Designs with modules in Python, from the experiment to the export."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from swarmwright import Experiment, InputError, Run, evaluate, optimize, resume, simulate
from swarmwright.cli._commands import program
from swarmwright.common.random_numbers import Streams
from swarmwright.controllers.modules.grammar import states_of
from swarmwright.export import EXPORTERS
from swarmwright.export.exporting import export_controller
from swarmwright.runs.replay import Replay
from tests.python.controllers.modules.conftest import CODE

TEXT = """simulation: arena
parameters: {{mission: aac, robot: e-puck-rm1.2, robots: 4, duration: 6}}
controller:
  kind: modules
  form: {form}
  behaviours: [wander, exploration, stop]
  conditions: [timer, black_floor]
  states: 3
method: {method}
seed: 4
"""
METHODS = {
    "racing": "{kind: racing, evaluations: 120}",
    "nnga": "{kind: nnga, population: 8, generations: 3}",
}


@pytest.mark.slow
@pytest.mark.parametrize(("form", "method"), [("machine", "racing"), ("tree", "nnga"), ("machine", "nnga")])
def test_a_design_is_a_run_like_others(form: str, method: str, own: Path, tmp_path: Path) -> None:  # noqa: ARG001
    file = tmp_path / "wander.yaml"
    file.write_text(TEXT.format(form=form, method=METHODS[method]))
    experiment = Experiment.load(file)
    run = optimize(experiment, out=tmp_path / "run")
    again = optimize(experiment, out=tmp_path / "again")
    assert run.digest == again.digest
    best = run.best
    assert best.specification["kind"] == "python_modules"
    names = {state.behaviour for state in states_of(best.specification)}
    assert names <= {"wander", "exploration", "stop"}

    replay = Replay.of(run)
    episode = replay.engine_episode()
    while not episode.done:
        episode.step()
    seed = replay.seed
    assert episode.fitness == simulate(experiment, best.controller, seed=seed)
    with pytest.raises(InputError, match=r"broker: mqtt://127\.0\.0\.1:1: .* only in this process"):
        Replay.of(run, broker="mqtt://127.0.0.1:1")
    assert (run.path / "code/1/behaviour-wander/own_modules.py").read_text() == CODE
    reopened = Run.open(run.path)
    assert reopened.best.specification == best.specification

    exported = export_controller(run, to="machine", output=tmp_path / "machine", verify=True)
    assert exported.verification is not None
    assert exported.verification.ok
    assert exported.verification.episode_steps > 100
    start = Experiment.load(file, [f"controller.machine={tmp_path / 'machine/controller.yaml'}"])
    assert start.representation().initial is not None
    for form_ in sorted(EXPORTERS.built_in.keys() - {"machine", "python"}):
        with pytest.raises(
            InputError, match=r"are code in Python|have no C code|does not support|only mealy_fsm"
        ):
            export_controller(run, to=form_, output=tmp_path / form_)


def test_evaluations_do_not_depend_on_each_other(own: Path, tmp_path: Path) -> None:  # noqa: ARG001
    file = tmp_path / "wander.yaml"
    file.write_text(TEXT.format(form="machine", method=METHODS["nnga"]))
    experiment = Experiment.load(file)
    genomes = experiment.representation().initials(Streams(3, "x", 0, range(10)))
    together = evaluate(experiment, genomes)
    alone = np.array([evaluate(experiment, genome[np.newaxis])[0] for genome in genomes])
    assert together.tobytes() == alone.tobytes()


@pytest.mark.slow
def test_edited_modules_are_noticed(own: Path, tmp_path: Path, install: Callable[..., Path]) -> None:  # noqa: ARG001
    file = tmp_path / "wander.yaml"
    file.write_text(TEXT.format(form="machine", method=METHODS["nnga"]))
    run = optimize(Experiment.load(file), out=tmp_path / "run")
    install(CODE.replace("-0.5", "-0.25"))
    with pytest.raises(InputError, match=r"behaviour-wander wander has changed since the run began"):
        resume(run.path, settings=["method.generations=4"])
    longer = resume(run.path, settings=["method.generations=4"], accept_changed_code=True)
    assert longer.generations == 4
    assert (run.path / "code/2/behaviour-wander/own_modules.py").is_file()


@pytest.mark.slow
def test_the_program_shows_runs_with_own_modules(own: Path, tmp_path: Path) -> None:  # noqa: ARG001
    file = tmp_path / "wander.yaml"
    file.write_text(TEXT.format(form="machine", method=METHODS["nnga"]))
    runner = CliRunner()
    for arguments in (
        ["optimize", str(file), "--out", str(tmp_path / "run")],
        ["runs", "verify", str(tmp_path / "run")],
        ["runs", "show", str(tmp_path / "run")],
        ["draw", str(tmp_path / "run"), "--out", str(tmp_path / "machine.png")],
        ["replay", str(tmp_path / "run"), "--save", str(tmp_path / "run.html")],
    ):
        result = runner.invoke(program, arguments)
        assert result.exit_code == 0, (arguments, result.output)
    assert "state 0: " in runner.invoke(program, ["runs", "show", str(tmp_path / "run")]).output
