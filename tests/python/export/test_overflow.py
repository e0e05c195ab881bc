"""Recurrent networks that overflow: where exported ones begin to refuse steps, and what self-tests take."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmwright.export import Exporter
from swarmwright.export.c import C
from swarmwright.export.cpp import Cpp
from swarmwright.export.exporting import write
from swarmwright.export.golden import Golden, find_steps_before_overflow, generate_walk
from swarmwright.export.python import Python
from swarmwright.export.sequences import Sequences
from tests.python.export.specifications import ALL, Specification, network, subject

STEPS = 100


def growing(seed: int, factor: float, iterations: int = 1) -> Specification:
    """A network whose outputs grow from step to step."""
    made = network("fully_meshed", "relu", [-1.0, 1.0], seed=seed, iterations=iterations)
    return {**made, "weights": [float(np.float32(one * factor)) for one in made["weights"]]}


def episode(specification: Specification, steps: int = STEPS) -> Sequences:
    sensors = np.random.default_rng(0).uniform(-1, 1, (steps, 3)).astype(np.float32)
    return Sequences.compute(specification, np.arange(steps) == 0, sensors)


def overflow_at(specification: Specification) -> int:
    kept = find_steps_before_overflow(specification, episode(specification))
    return int(np.argmin(kept)) if not kept.all() else STEPS


NETWORKS = [growing(seed, factor, 1 + seed % 2) for seed in range(12) for factor in (3, 30)]
OVERFLOWING = [one for one in NETWORKS if 0 < overflow_at(one) < STEPS - 1]


def test_networks_overflow_while_actuators_move_and_while_they_are_0() -> None:
    moving = {bool(episode(one).actuators[overflow_at(one)].any()) for one in OVERFLOWING}
    assert moving == {False, True}


@pytest.mark.slow
@pytest.mark.parametrize("after", [1, 2, 50])
def test_the_self_test_has_the_steps_before(after: int, tmp_path: Path) -> None:
    """Wherever the episode ends, and whether actuators move in its last step."""
    for number, specification in enumerate(OVERFLOWING):
        begun = overflow_at(specification)
        recorded = episode(specification, min(begun + after, STEPS))
        made = replace(subject(specification), episodes=recorded, episode_count=1)
        golden = Golden.from_subject(made)
        assert len(golden.sequences) == begun
        assert f"episodes of 1 agent, {begun} steps before a node overflows" in golden.words
        folder = tmp_path / str(number)
        write(Python().files(made, "robot"), folder)
        assert Python().self_test(folder, "robot") == "robot_test.py"


@pytest.mark.slow
@pytest.mark.parametrize("exporter", [C(), Cpp(), Python()], ids=lambda one: one.form)
def test_a_network_that_overflows_at_once_has_a_self_test_without_steps(
    exporter: Exporter, tmp_path: Path
) -> None:
    made = network("fully_meshed", "tanh", [-1.0, 1.0])
    weights = [3e38 if index % 2 else -3e38 for index in range(len(made["weights"]))]
    specification = {**made, "weights": weights}
    first = np.arange(40) == 0
    recorded = Sequences.compute(specification, first, np.full((40, 3), 2, np.float32))
    at_once = replace(subject(specification), episodes=recorded, episode_count=1)
    assert len(Golden.from_subject(at_once).sequences) == 0
    write(exporter.files(at_once, "robot"), tmp_path)
    assert exporter.self_test(tmp_path, "robot")


@pytest.mark.slow
def test_the_pseudo_random_steps_end_before_an_overflow(tmp_path: Path) -> None:
    made = subject(OVERFLOWING[0])
    walk = generate_walk(made)
    assert 0 < walk.steps < 256
    assert walk.words == f"{walk.steps} pseudo-random steps before a node overflows"
    write(C().files(made, "robot"), tmp_path)
    assert C().self_test(tmp_path, "robot") == "robot_test.c"


def test_others_keep_all_steps() -> None:
    for name in ("layered-relu-6", "fully_meshed-tanh-6", "hebbian", "mealy_fsm"):
        recorded = episode(ALL[name])
        assert find_steps_before_overflow(ALL[name], recorded).all(), name
