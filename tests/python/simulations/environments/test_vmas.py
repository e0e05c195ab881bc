"""VMAS's scenarios, where it is installed: it brings gigabytes, so it is not among what tests need."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, evaluate, optimize
from swarmwright.simulations import attached, catalogue
from swarmwright.simulations.loading import load
from swarmwright.testing import check_batch_simulation
from tests.python.records import same_record

pytest.importorskip("vmas", reason="VMAS is not installed")


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["navigation", "wheel", "simple_spread", "balance"])
def test_an_episode_does_not_depend_on_others(scenario: str) -> None:
    check_batch_simulation(attached.load_adapter(f"vmas:{scenario}"), {"max_steps": 5})  # type: ignore[arg-type]


@pytest.mark.slow
def test_agents_that_differ() -> None:
    with pytest.raises(InputError, match="simple_tag: its agents have different spaces"):
        Experiment.from_mapping({"simulation": "vmas:simple_tag"})


@pytest.mark.slow
def test_one_record_in_every_mode(tmp_path: Path) -> None:
    def experiment(mode: str) -> Experiment:
        return Experiment.from_mapping(
            {
                "simulation": "vmas:navigation?n_agents=3",
                "parameters": {"max_steps": 5},
                "controller": {"hidden": []},
                "method": {"population": 4, "generations": 1},
                "mode": mode,
            }
        )

    here = optimize(experiment("auto"), servers="in-process", out=tmp_path / "here")
    for mode in ("batched", "offloaded"):
        same_record(optimize(experiment(mode), servers=1, out=tmp_path / mode), here)


@pytest.mark.slow
def test_seeds_matter() -> None:
    one = Experiment.from_mapping(
        {"simulation": "vmas:navigation", "parameters": {"max_steps": 3, "seed": 1}}
    )
    genomes = np.ones((1, one.genome_size), np.float32)
    other = one.replace(parameters={"seed": 2})
    fitness = [evaluate(each, genomes, servers="in-process")[0] for each in (one, other, one)]
    assert fitness[0] == fitness[2] != fitness[1]


@pytest.mark.slow
def test_parameters_that_the_scenario_does_not_know() -> None:
    one = Experiment.from_mapping({"simulation": "vmas:navigation", "parameters": {"n_agent": 3}})
    with pytest.raises(InputError, match=r"n_agent: Vmas navigation: .* not used by the scenario"):
        evaluate(one, np.ones((1, one.genome_size), np.float32), servers="in-process")


@pytest.mark.slow
def test_ranges_are_those_of_the_action_spaces() -> None:
    made: Any = load("vmas:navigation")()
    limits = list(zip(made._env.action_space[0].low, made._env.action_space[0].high, strict=True))
    expected = [None if one == (-1, 1) else [*one, ""] for one in limits]
    found = catalogue.ranges("vmas:navigation", {"max_steps": 5})
    assert found.get("actuator_ranges", [None] * made.actuators) == expected
