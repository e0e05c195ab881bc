from pathlib import Path

import pytest

from swarmwright import Controller, Experiment, InputError, simulate
from swarmwright.display import Recording
from swarmwright.servers.evaluation.shown import ShownEpisode

VALUES = {"simulation": "arena", "parameters": {"mission": "foraging", "robots": 3, "duration": 2}}


@pytest.mark.parametrize("controller", ["layered", "evostick"])
@pytest.mark.parametrize("seed", [None, 7])
def test_it_is_the_episode_that_simulate_runs(controller: str, seed: int | None) -> None:
    experiment = Experiment.from_mapping(
        {**VALUES, "controller": {"kind": controller}, "fitness": "2 * order"}
    )
    shown = ShownEpisode.from_experiment(experiment, seed=seed)
    recording = shown.recording()
    assert recording.fitness == simulate(experiment, seed=seed, servers="in-process")
    assert shown.metrics(recording) == {"order": recording.fitness / 2}
    assert len(recording.scenes) == 20
    assert f"arena: a random controller, simulation seed {seed or 0}" == shown.title


def test_a_controller_is_taken_from_a_file_and_named(tmp_path: Path) -> None:
    experiment = Experiment.from_mapping(VALUES)
    file = tmp_path / "some.json"
    ShownEpisode.from_experiment(experiment.replace(seed=5)).controller.save(file)
    shown = ShownEpisode.from_experiment(experiment, file)
    assert shown.controller.specification == Controller.load(file).specification
    recording = shown.save(tmp_path / "some.png")
    assert isinstance(recording, Recording)
    facts = dict(shown.caption(recording).facts)
    assert facts["mission"] == "Foraging"
    assert facts["fitness of this episode"] == f"{recording.fitness:.6g}"
    assert shown.controller_text == f"controller of {file}"


def test_mistakes_are_named(tmp_path: Path) -> None:
    experiment = Experiment.from_mapping(VALUES)
    with pytest.raises(InputError, match="seed: must be from 0 to"):
        ShownEpisode.from_experiment(experiment, seed=-1)
    with pytest.raises(InputError, match=r"the simulation 'elsewhere' is not built in; give a broker"):
        ShownEpisode.from_experiment(Experiment.from_mapping({"simulation": "elsewhere"}))
    with pytest.raises(InputError, match=r"missing/some\.png: cannot be written: No such file"):
        ShownEpisode.from_experiment(experiment).save(tmp_path / "missing" / "some.png")
