"""Objects of results: compared by their values, and short when they are printed."""

import re
from copy import deepcopy
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from swarmwright import (
    Episodes,
    compare,
    evaluate_episodes,
    export_controller,
    optimize,
    post_evaluate,
    repeat,
    transfer,
)
from swarmwright.common.html import facts
from swarmwright.common.values import ComparedByValue
from swarmwright.results import Observation
from tests.python.records import EXPERIMENT


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One object of each class, by its name."""
    folder = tmp_path_factory.mktemp("results")
    experiment = EXPERIMENT.replace(
        servers="in-process", fitness="-distance", validate={"episodes": 20, "candidates": 3}
    )
    run = optimize(experiment, out=folder / "run")
    genome = run.record.genomes[:2]
    exported = export_controller(run, to="python", output=folder / "out")
    objects = [
        *(run.record, run.evaluation(), run.best, run.validation),
        *(evaluate_episodes(experiment, genome), post_evaluate(run, episodes=3), repeat(run)),
        *(post_evaluate(run, controller=run.best.controller, episodes=3), exported),
        *(compare([run]), run.history[0], run.sessions[0]),
        transfer([run], vary={"parameters.speedAgents": (0.01, 0.02)}, seeds=3),
        Episodes(experiment, seeds=[1, 2]).observe(),
    ]
    return {type(one).__name__: one for one in objects}


def test_results_are_compared_by_their_values(results: dict[str, Any]) -> None:
    for name, one in results.items():
        other = deepcopy(one)
        assert one == one
        assert ((one == other), (one != other)) in {(True, False), (False, True)}, name
        assert one in [None, one]
        assert one != name
        if isinstance(one, ComparedByValue | Observation):
            assert one == other, name
            with pytest.raises(TypeError, match="unhashable"):
                hash(one)
    for name in ("EpisodeResults", "Validation", "ExportResult", "Best", "Session"):
        assert results[name] == deepcopy(results[name]), name


@dataclass(frozen=True, eq=False)
class Values(ComparedByValue):
    """Values of several types."""

    array: Any
    others: Any = ()


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (np.array([1.0, np.nan]), np.array([1.0, np.nan]), True),
        (np.array([1.0, 2.0]), np.array([1.0, np.nan]), False),
        (np.array([1.0]), np.array([1.0, 1.0]), False),
        (np.array([1.0]), np.array([1.0], dtype=np.float32), False),
        (np.array(["a"]), np.array(["a"]), True),
        (np.array([1.0]), 1.0, False),
        (float("nan"), float("nan"), True),
        ([1, {"a": np.array([np.nan])}], [1, {"a": np.array([np.nan])}], True),
        ([1, {"a": np.array([1.0])}], [1, {"b": np.array([1.0])}], False),
        ((1, 2), [1, 2], False),
        ("ab", "ab", True),
        (1, 1.0, True),
    ],
)
def test_equality_of_values(one: Any, other: Any, same: bool) -> None:
    assert (Values(one) == Values(other)) is same
    assert (Values(one) != Values(other)) is not same
    assert (Values(0, (one,)) == Values(0, (other,))) is same


def test_equality_of_observations() -> None:
    noisy = {"placement": "random"}
    seen = Episodes("minisim", noisy, seeds=[1, 2]).observe()
    assert seen == tuple(seen)
    assert tuple(seen) == seen
    assert seen != Episodes("minisim", noisy, seeds=[1, 3]).observe()
    assert seen != seen[:2]
    episodes, agents, sensors = seen
    assert (episodes.shape, agents.shape, sensors.shape) == ((2,), (2,), (2, 4))


def test_printed_results_are_short_and_the_same_in_every_session(results: dict[str, Any]) -> None:
    for name, one in results.items():
        assert len(repr(one)) < 1200, name
        assert " at 0x" not in repr(one), name
    assert repr(results["PostEvaluation"]).startswith("<PostEvaluation of ")
    words = r"mean fitness -\d.*, 95 % confidence interval -\d.* to -\d.*, 3 episodes>"
    assert re.search(words, repr(results["PostEvaluation"]))
    assert re.fullmatch(f"<ControllerEvaluation: {words}", repr(results["ControllerEvaluation"]))
    assert repr(results["Validation"]).startswith("<Validation of 3 candidates; the best, ")


@pytest.mark.parametrize("name", ["PostEvaluation", "ControllerEvaluation", "Validation", "Transfer"])
def test_notebooks_show_results(results: dict[str, Any], name: str) -> None:
    shown = results[name]._repr_html_()
    ET.fromstring(f"<div>{shown}</div>")
    assert "fitness" in shown


def test_methods_representations_and_episodes_name_what_they_are() -> None:
    method = EXPERIMENT.new_method()
    method.tell(np.zeros(len(method.ask())))
    assert repr(method) == "<Nnga: generation 1, 12 evaluations>"
    assert repr(EXPERIMENT.representation()) == "<Layered: 4 sensors, 1 actuators>"
    episodes = Episodes("minisim", {"maxSteps": 1}, seeds=[1, 2])
    assert repr(episodes) == "<Episodes of minisim: 2>"
    while not episodes.done:
        episodes.step(np.zeros((len(episodes.observe().sensors), 1)))
    assert repr(episodes) == "<Episodes of minisim: 2, all ended>"


def test_a_title_without_rows_has_no_table() -> None:
    assert facts("title", []) == "<div><strong>title</strong></div>"
