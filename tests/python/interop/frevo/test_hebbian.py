"""Networks with Hebbian learning compute what FREVO's HebbNet computes, and get its fitness."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from swarmwright import Controller, InputError, frevo
from swarmwright.interop.frevo._document import open_session
from swarmwright.interop.frevo._score import read_networks

Edited = Callable[..., Path]


def test_outputs_are_those_of_frevos_class_to_the_bit(data: Path) -> None:
    learnt = 0
    for case in json.loads((data / "hebbian.json").read_text(encoding="utf-8")):
        specification = {
            "version": 1,
            "kind": "hebbian",
            "sensors": case["inputs"],
            "actuators": case["outputs"],
            "hidden": case["hiddenNodes"],
            "iterations": max(1, case["stepNumber"]),
            "weights": case["genes"],
        }
        controller, still = (
            Controller({**specification, "weights": [rate, *case["genes"][1:]]})
            for rate in (case["genes"][0], 0.0)
        )
        for step in case["steps"]:
            if step["reset"]:
                controller.reset()
                still.reset()
            sensors = np.array(step["inputs"], np.float32)
            outputs = np.array(step["outputs"], np.float32)
            expected = np.float32(2) * outputs - np.float32(1)
            assert controller(sensors).tolist() == expected.tolist()
            learnt += still(sensors).tolist() != expected.tolist()
    assert learnt > 60, "most steps differ from those of a network that does not learn"


def test_fitness_needs_the_learning(data: Path, edited: Edited) -> None:
    assert frevo.score(data / "hebbian.zre").max_difference == 0
    text = (data / "hebbian.zre").read_text(encoding="utf-8")
    rate = re.search(r'learningrate="[^"]*"', text)
    assert rate
    path = edited("hebbian.zre", (rate[0], 'learningrate="0"'))
    assert frevo.score(path).candidates[0].difference > 0


def test_networks_become_controllers(data: Path) -> None:
    found = read_networks(open_session(data / "hebbian.zre"))
    assert len(found) == 10
    for network in found:
        assert network.specification["kind"] == "hebbian"
        controller = Controller(network.specification)
        assert np.abs(controller(np.zeros(10, np.float32))).max() <= 1


@pytest.mark.parametrize(
    ("rate", "answer"),
    [
        ('learningrate="much"', "learningrate 'much' found, expected a finite number"),
        ('learningrate="1e39"', "learningrate '1e39' found, expected a finite number"),
        ("", "<hebbnet>: the attribute learningrate is missing"),
    ],
)
def test_a_malformed_learning_rate_is_refused(edited: Edited, data: Path, rate: str, answer: str) -> None:
    text = (data / "hebbian.zre").read_text(encoding="utf-8")
    first = re.search(r'learningrate="[^"]*"', text)
    assert first
    with pytest.raises(InputError, match=re.escape(answer)):
        frevo.score(edited("hebbian.zre", (first[0], rate)))
