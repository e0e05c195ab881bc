"""Experiment files to start from."""

from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, templates
from swarmwright.common.yaml import parse
from swarmwright.experiment.validation import check


@pytest.mark.parametrize("name", templates.names())
def test_templates_load(name: str) -> None:
    text = templates.text(name)
    experiment = Experiment(**check(parse(text, name)))
    assert experiment.simulation == name
    # A file to start from explains itself: most lines have a comment.
    lines = [line for line in text.splitlines() if line.strip()]
    assert sum("#" in line for line in lines) > len(lines) / 2


def test_the_demo_is_the_template(root: Path) -> None:
    assert (root / "experiments" / "minisim.yaml").read_text(encoding="utf-8") == templates.minisim()


def test_the_template_is_the_published_example() -> None:
    # D6.1, Schema 10.
    assert Experiment(**check(parse(templates.minisim(), "x"))).parameters == {
        "mapWidth": 13,
        "mapHeight": 7,
        "numAgents": 1,
        "numDefenders": 1,
        "speedAgents": 1,
        "speedDefenders": 0.33,
        "agents": [[0.5, 3.5]],
        "defenders": [[8, 3.5]],
        "goal": [12.5, 3.5],
        "helloMessage": "Welcome to minisim",
        "stepSize": 250,
        "maxSteps": 15,
    }


def test_an_unknown_template() -> None:
    with pytest.raises(InputError, match="unknown template 'minisym'; did you mean 'minisim'"):
        templates.text("minisym")
    with pytest.raises(InputError, match="unknown template 'gazebo'; did you mean 'arena-gazebo'"):
        templates.text("gazebo")


@pytest.mark.parametrize("title", templates.simulators())
def test_the_arena_in_another_simulator(title: str) -> None:
    experiment = Experiment(**check(parse(templates.text(title), title)))
    assert (experiment.simulation, experiment.broker) == (title, "mqtt://localhost:1883")
    foraging = Experiment(**check(parse(templates.arena("foraging", title), title)))
    assert foraging.parameters["mission"] == "foraging"
    arena = Experiment(**check(parse(templates.arena("foraging"), title)))
    assert foraging.replace(simulation="arena", broker=None) == arena


def test_the_arena_in_an_unknown_simulator() -> None:
    with pytest.raises(InputError, match="unknown simulation 'gazebo'; did you mean 'arena-gazebo'"):
        templates.arena(simulation="gazebo")
