"""E-pucks and Thymios in Enki, where Debian's package fits this Python."""

from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, evaluate, simulate
from tests.enki import needs_enki

pytestmark = needs_enki


def test_sensors_motors_and_noise() -> None:
    from swarmwright.simulations.enki import EPucks, Thymios

    for kind in (EPucks, Thymios):
        simulation = kind()
        seen = simulation.reset({"agents": 2, "size": 300.0, "pillars": 0, "steps": 30}, 1)
        assert seen.shape == (2, kind.sensors)
        robot, other = simulation.robots
        robot.pos, robot.angle = (150.0, 150.0), 0.0
        other.pos, other.angle = (150.0, 50.0), 0.0
        ahead, still = [1, 1], [0, 0]
        for _ in range(10):
            seen = simulation.step(np.array([ahead, still], np.float32))
        assert robot.pos[0] == pytest.approx(150 + kind.fastest, rel=0.15)
        assert seen.max() < 0.4  # nothing near, but for noise, which depends on what ran before
        robot.pos, robot.angle = (300.0 - kind.half - 4, 150.0), 0.0
        seen = simulation.step(np.array([still, still], np.float32))
        front = seen[0, [0, 7]] if kind is EPucks else seen[0, 2:3]
        assert (front > 0.3).all()
        assert seen[1].max() < 0.4
        assert 0 < simulation.fitness() < 0.5


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "servers"), [("stepwise", 1), ("batched", 1), ("offloaded", 2)])
def test_every_mode(mode: str, servers: Any) -> None:
    one = Experiment.from_mapping(
        {
            "simulation": "swarmwright.simulations.enki:EPucks",
            "parameters": {"steps": 10},
            "controller": {"hidden": []},
            "fitness": "fitness - touching",
            "mode": mode,
        }
    )
    genomes = np.random.default_rng(1).normal(size=(4, one.genome_size)).astype(np.float32)
    fitness = evaluate(one, genomes, servers=servers)
    assert ((fitness > -1) & (fitness < 1)).all()


def test_no_room() -> None:
    one = Experiment.from_mapping(
        {"simulation": "swarmwright.simulations.enki:Thymios", "parameters": {"agents": 200}}
    )
    with pytest.raises(InputError, match="agents: the arena is too small"):
        simulate(one, servers="in-process")
