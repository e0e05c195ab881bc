"""Machines and trees that people write in files are controllers."""

from pathlib import Path

import pytest

from swarmwright import Controller, Experiment, InputError, simulate
from swarmwright.common.yaml import dump
from swarmwright.controllers.modules import grammar


@pytest.mark.parametrize("form", ["machine", "tree"])
def test_a_machine_in_a_file_is_a_controller(form: str, tmp_path: Path) -> None:
    if form == "machine":
        written = {
            "states": [
                {
                    "behaviour": "exploration",
                    "rwm": 30,
                    "transitions": [{"to": 1, "condition": "black_floor", "probability": 1.0}],
                },
                {"behaviour": "stop"},
            ]
        }
    else:
        written = {
            "subtrees": [
                {"condition": "black_floor", "probability": 1.0, "behaviour": "exploration", "rwm": 30}
            ]
        }
    file = tmp_path / "mine.yaml"
    file.write_text(dump(written))
    controller = Controller.load(file)
    specification = controller.specification
    assert (specification["kind"], specification["sensors"]) == ("modules", 9)
    states = grammar.states_of(specification)
    assert states[0].behaviour == "exploration"
    # As one that evolution starts from.
    options = {"kind": "modules", "form": form, "machine": str(file)}
    values = {"simulation": "arena", "parameters": {"robot": "e-puck-rm1.2", "duration": 10}}
    experiment = Experiment.from_mapping({**values, "controller": options})
    representation = experiment.representation()
    assert representation.start_genome is not None
    started = Controller(representation.specification(representation.start_genome))
    assert simulate(experiment, controller, seed=3, servers="local") == simulate(
        experiment, started, seed=3, servers="local"
    )
    file.write_text(dump(written).replace("exploration", "eksploration"))
    with pytest.raises(InputError, match=r"mine.yaml:\d+: .*'eksploration'"):
        Controller.load(file)
    file.write_text("x: 1\n")
    with pytest.raises(InputError, match=r"mine.yaml: is not a controller; expected a machine"):
        Controller.load(file)
