"""Runs that end with a transfer, as their `validate` says: the numbers of `swarmwright transfer`, once."""

import logging
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, optimize, resume, transfer
from swarmwright.analysis.transfer.transfer import load_run_transfer

NOISY: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 3, "placement": "random", "speedDefenders": 0.5},
    "method": {"kind": "random_search", "population": 20, "generations": 3},
    "ranking": {"episodes": 2},
    "servers": "local",
}
OTHER = {"simulation": "other.py:Other", "name": "other"}
SLOWER = """
from swarmwright import Parameter, Simulation


class Other(Simulation):
    sensors, actuators = 4, 1
    parameters = {"gain": Parameter(2.0)}

    def reset(self, parameters, seed):
        self.gain, self.sum, self.left = parameters["gain"], 0.0, 3
        return [[seed % 7 / 7, 0.5, 0.25, -0.5]]

    def done(self):
        return self.left == 0

    def step(self, actions):
        self.left -= 1
        self.sum += self.gain * float(actions[0][0])
        return [[0.5, 0.1 * self.left, 0.2, 0.3]]

    def fitness(self):
        return self.sum
"""


def experiment(folder: Path, **validate: Any) -> Experiment:
    """One whose file names others beside it."""
    (folder / "harder.yaml").write_text("parameters: {numDefenders: 4, speedDefenders: 0.6}\n")
    (folder / "other.py").write_text(SLOWER)
    path = folder / "noisy.yaml"
    Experiment.from_mapping({**NOISY, "validate": {"episodes": 0}}).save(path)
    text = path.read_text()
    assert "  episodes: 0\n" in text
    path.write_text(text.split("validate:")[0] + f"validate: {validate}\n")
    return Experiment.load(path)


@pytest.mark.journey
def test_a_run_ends_with_the_numbers_of_transfer(tmp_path: Path) -> None:
    asked: dict[str, Any] = {"candidates": 4, "random": 2, "seeds": 6}
    ranges = {"parameters.speedDefenders": [0.4, 1]}
    made = experiment(tmp_path, to=["harder.yaml", OTHER], vary=ranges, episodes=20, **asked)
    run = optimize(made, out=tmp_path / "run")
    harder, other, sampled = run.transferred
    (tmp_path / "same.yaml").write_text("parameters: {numDefenders: 4, speedDefenders: 0.6}\n")
    (tmp_path / "class.yaml").write_text("simulation: other.py:Other\n")
    expected = transfer(
        [run],
        [str(tmp_path / "same.yaml"), str(tmp_path / "class.yaml")],
        vary={"parameters.speedDefenders": (0.4, 1)},
        **asked,
    )
    for one, same in zip((harder, other, sampled), expected.runs, strict=True):
        assert one.candidates == same.candidates
        assert one.source_episodes.tolist() == same.source_episodes.tolist()
        assert one.target_episodes.tolist() == same.target_episodes.tolist()
    assert [one.target for one in run.transferred] == ["harder.yaml", "other", "pseudo-reality"]
    assert harder.losses[0].mean == expected.runs[0].losses[0].mean
    found = load_run_transfer(run)
    assert found is not None
    assert found.seeds == expected.seeds
    assert str(found).count("Rank correlation of the 6 candidates") == 3
    assert run.validation is not None
    assert not run.transfer_is_due
    assert "in harder.yaml" in run._repr_html_()
    again = Run.open(run.path).transferred
    assert [one.target_fitness for one in again] == [one.target_fitness for one in run.transferred]


@pytest.mark.slow
def test_it_changes_nothing_of_the_record_and_does_not_depend_on_servers(tmp_path: Path) -> None:
    one = optimize(experiment(tmp_path, to="harder.yaml", episodes=0, seeds=4), out=tmp_path / "one")
    other = optimize(one.experiment.replace(servers=2), out=tmp_path / "other")
    plain = optimize(one.experiment.replace(validate=None), out=tmp_path / "plain")
    assert one.digest == other.digest == plain.digest
    assert one.validation is None
    assert one._store.transfer() == other._store.transfer()
    assert plain.transferred == ()


@pytest.mark.slow
def test_files_are_read_once(tmp_path: Path) -> None:
    made = experiment(tmp_path, to=["harder.yaml", OTHER], seeds=2)
    first, second = made.validate.to
    assert first == {"name": "harder.yaml", "parameters": {"numDefenders": 4, "speedDefenders": 0.6}}
    assert second == {"name": "other", "simulation": f"{tmp_path}/other.py:Other"}
    (tmp_path / "harder.yaml").unlink()
    assert Experiment.from_mapping(made.to_mapping()) == made
    made.save(tmp_path / "saved.yaml")
    assert Experiment.load(tmp_path / "saved.yaml").validate == made.validate
    assert [one.target for one in optimize(made, out=tmp_path / "run").transferred] == [
        "harder.yaml", "other",
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("after", ["source", "a target"])
def test_a_run_that_is_killed_meanwhile_goes_on(after: str, tmp_path: Path) -> None:
    made = experiment(tmp_path, to=["harder.yaml", OTHER], seeds=6)
    whole = optimize(made, out=tmp_path / "whole")
    made.save(tmp_path / "again.yaml")
    code = f"""if True:
        import os, signal
        from pathlib import Path
        from swarmwright import Experiment, optimize
        from swarmwright.runs.store import StoreWriter
        note = StoreWriter.note_transfer
        def ends(self, values):
            note(self, values)
            self.keep()
            if len(values["targets"]) == {int(after == "a target")}:
                os.kill(os.getpid(), signal.SIGKILL)
        StoreWriter.note_transfer = ends
        optimize(Experiment.load({str(tmp_path / "again.yaml")!r}), out=Path({str(tmp_path / "run")!r}))
    """
    environment = {**os.environ, "SWARMWRIGHT_PLOT": "0"}
    ended = subprocess.run([sys.executable, "-c", code], env=environment, timeout=50, check=False)
    assert ended.returncode == -signal.SIGKILL
    run = Run.open(tmp_path / "run")
    assert (run.state, run.transfer_is_due) == ("done", True)
    assert len(run.transferred) == (after == "a target")
    evaluated: list[int] = []
    run = resume(run, on_progress=lambda done, *_: evaluated.append(done))
    assert run._store.transfer() == whole._store.transfer()
    assert not run.transfer_is_due
    assert resume(run)._store.transfer() == whole._store.transfer()
    assert len(run.sessions) == 1, "nothing was added to the run itself"


@pytest.mark.slow
def test_a_simulation_that_is_missing_at_the_end_is_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, any_broker: str
) -> None:
    entries = [
        {"name": "robots", "simulation": "robots", "broker": any_broker, "timeouts": {"discovery": 0.2}},
        "harder.yaml",
    ]
    made = experiment(tmp_path, to=entries, seeds=3, episodes=0)
    with caplog.at_level(logging.WARNING, "swarmwright"):
        run = optimize(made, out=tmp_path / "run")
    (said,) = [one.getMessage() for one in caplog.records if "transferred" in one.getMessage()]
    assert "robots" in said
    assert f"`swarmwright resume {run.path}` repeats the transfer" in said
    assert run.state == "done"
    assert [one.target for one in run.transferred] == ["harder.yaml"]
    assert run.transfer_is_due


@pytest.mark.slow
def test_a_finished_run_can_get_one(tmp_path: Path) -> None:
    run = optimize(experiment(tmp_path, episodes=0), out=tmp_path / "run")
    assert run.transferred == ()
    settings = [f"validate.to=[{tmp_path / 'harder.yaml'}]", "validate.seeds=3"]
    run = resume(run, settings=settings)
    assert [one.target_episodes.shape for one in run.transferred] == [(5, 3)]
    assert len(Run.open(run.path).transferred) == 1
    assert run.experiment.validate.seeds == 3
    run = resume(run, generations=5)
    assert run.generations == 5
    assert len(run.transferred) == 1, "of the best ones of the longer run"


@pytest.mark.parametrize(
    ("validate", "said"),
    [
        ({"to": "gone.yaml"}, r"noisy\.yaml:\d+: validate\.to.*gone\.yaml: there is no such file"),
        (
            {"to": ["emergency_exit"]},
            r"(?s)noisy\.yaml:\d+: validate\.to\[0\]: emergency_exit: .*numDefenders: .*give a .yaml file",
        ),
        (
            {"to": [{"simulation": "emergency_exit"}]},
            "controllers have 4 sensors and 1 actuators, but agents of",
        ),
        (
            {"to": [{"parameters": {"speed": 1}}]},
            r"noisy\.yaml:\d+: validate\.to\[0\]\.parameters\.speed: unknown",
        ),
        (
            {"to": [{"method": {}}]},
            r"noisy\.yaml:\d+: validate\.to\[0\]\.method: does not belong to a target",
        ),
        (
            {"to": ["harder.yaml", "harder.yaml"]},
            r"noisy\.yaml:\d+: validate\.to: harder\.yaml is given twice",
        ),
        ({"to": 3}, r"validate\.to: must list simulations or files"),
        ({"seeds": 1}, r"validate\.seeds: must be at least 2"),
        ({"vary": {"parameters.speedDefenders": 3}}, "must be the lowest and the highest value"),
        (
            {"vary": {"parameters.speedy": [0, 1]}},
            r"noisy\.yaml:\d+: validate\.vary: parameters\.speedy=0\.\.1: unknown parameter",
        ),
        ({"vary": {"method.step": [0, 1]}}, "only parameters of the simulation can be varied"),
        ({"pseudo_reality": True}, r"noisy\.yaml:\d+: validate\.pseudo_reality: .*needs robots of one kind"),
    ],
)
def test_mistakes_are_found_when_the_file_is_read(
    tmp_path: Path, validate: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError, match=said) as found:
        experiment(tmp_path, **validate)
    assert "Traceback" not in str(found.value)


def test_a_simulation_that_is_nowhere_is_found_before_the_run(tmp_path: Path) -> None:
    made = experiment(tmp_path, to=["minisin"])
    with pytest.raises(InputError, match=r"noisy\.yaml:\d+: validate: minisin: .*did you mean 'minisim'"):
        optimize(made, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()
